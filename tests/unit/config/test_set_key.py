"""A key of a table set in a file whose comments and other lines stay."""

import pytest

from fieldkit.config.edit import editing, set_key
from fieldkit.model.errors import ConfigError

BEFORE = """schema = 1
# where we are
[site]
latitude_deg = 35.5   # by GPS
longitude_deg = 139.4

# the camera
[camera]
driver = "purethermal"
"""


def test_a_new_key_stands_below_the_header(tmp_path):
    file = tmp_path / "fieldkit.toml"
    file.write_text(BEFORE)
    with editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    assert file.read_text() == BEFORE.replace("[site]\n", '[site]\nhorizon = "horizon.csv"\n')


def test_a_value_of_several_lines_is_replaced(tmp_path):
    file = tmp_path / "fieldkit.toml"
    file.write_text(
        BEFORE.replace("\n# the camera", "horizon = [\n  [0, 1],\n  [90, 20],\n]\n\n# the camera")
    )
    with editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    assert file.read_text() == BEFORE.replace("\n# the camera", 'horizon = "horizon.csv"\n\n# the camera')


def test_a_site_without_a_table_is_left_to_its_owner(tmp_path):
    file = tmp_path / "fieldkit.toml"
    text = "schema = 1\nsite = { latitude_deg = 35.5, longitude_deg = 139.4 }\n"
    file.write_text(text)
    with pytest.raises(ConfigError, match="of its own to set horizon in"), editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    assert file.read_text() == text
