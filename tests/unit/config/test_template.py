import re
import tomllib

import pytest

from fieldkit.config import load_config, mistakes_in
from fieldkit.config.template import PAPER_SITE, SIMULATED, campaign_toml


@pytest.mark.parametrize("given", [{"site": PAPER_SITE}, SIMULATED])
def test_the_template_passes_its_own_check_and_says_what_was_given(given, tmp_path):
    text = campaign_toml(given)
    assert mistakes_in(text, tmp_path / "fieldkit.toml") == []
    values = tomllib.loads(text)
    assert {name: values[name] for name in given} == given


def test_the_template_is_valid_with_every_line_uncommented(tmp_path):
    text = re.sub(r"(?m)^#(?=[a-z\[])", "", campaign_toml({"site": PAPER_SITE}))
    text += '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
    assert mistakes_in(text, tmp_path / "fieldkit.toml") == []


def test_a_new_file_is_short_and_has_the_keys_that_decide():
    text = campaign_toml({"site": PAPER_SITE})
    assert len(text.splitlines()) <= 60
    written = tomllib.loads(re.sub(r"(?m)^#(?=[a-z\[])", "", text))
    assert written["region"][0].keys() >= {"kind", "tilt_deg", "level_sd_deg"}
    for table, key in (("surface", "same"), ("irradiance", "measures"), ("prior", "air_sd_k")):
        assert key in written[table]


def test_a_commented_default_is_the_default(tmp_path):
    file = tmp_path / "fieldkit.toml"
    text = campaign_toml({"site": PAPER_SITE})
    file.write_text(text, encoding="utf-8")
    as_written = load_config(file, environment={}).tables
    without_region = text.partition("# A region")[0]
    file.write_text(re.sub(r"(?m)^#(?=[a-z\[])", "", without_region), encoding="utf-8")
    assert re.search(r"(?m)^albedo = 0.2 ", file.read_text())
    assert load_config(file, environment={}).tables == as_written
