"""A key of a table set in a file whose comments and other lines stay."""

import pytest

from fieldkit.config.edit import editing, set_key
from fieldkit.model.errors import ConfigError
from tests.harness.next_steps import at

BEFORE = """schema = 1
# where we are
[site]
latitude_deg = 35.5   # by GPS
longitude_deg = 139.4

# camera
[camera]
driver = "purethermal"
"""


SEVERAL_LINES = "horizon = [\n  [0, 1],\n  [90, 20],\n]\n\n# camera"


@pytest.mark.parametrize(
    ("before", "place"),
    [(BEFORE, "[site]\n"), (BEFORE.replace("\n# camera", SEVERAL_LINES), SEVERAL_LINES.rpartition("\n#")[0])],
    ids=["below the header", "for a value of several lines"],
)
def test_a_key_is_set_in_its_place(tmp_path, before, place):
    file = tmp_path / "fieldkit.toml"
    file.write_text(before)
    with editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    header = place if place.startswith("[") else ""
    assert file.read_text() == before.replace(place, f'{header}horizon = "horizon.csv"\n')


def test_a_site_without_a_table_is_left_to_its_owner(tmp_path):
    file = tmp_path / "fieldkit.toml"
    text = "schema = 1\nsite = { latitude_deg = 35.5, longitude_deg = 139.4 }\n"
    file.write_text(text)
    with pytest.raises(ConfigError, check=at(file)), editing(file) as draft:
        set_key(draft, "site", "horizon", "horizon.csv")
    assert file.read_text() == text
