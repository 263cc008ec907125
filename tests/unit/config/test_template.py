import re
import tomllib

import pytest

from fieldkit.config import load_config, mistakes_in
from fieldkit.config.template import PAPER_SITE, SIMULATED, campaign_toml
from fieldkit.config.toml_schema import known_keys


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


def test_every_key_of_every_table_stands_in_the_template():
    text = re.sub(r"(?m)^#(?=[a-z\[])", "", campaign_toml({"site": PAPER_SITE}))
    written = tomllib.loads(text)
    assert set(written) == set(known_keys(()))
    inside = {"region": 0, "device": "second-light-meter"}
    for name in set(written) - {"schema"}:
        path = (name, inside[name]) if name in inside else (name,)
        table = written[name][inside[name]] if name in inside else written[name]
        assert set(table) == set(known_keys(path)), name


def test_a_commented_default_is_the_default(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    file = tmp_path / "fieldkit.toml"
    text = campaign_toml({"site": PAPER_SITE})
    file.write_text(text, encoding="utf-8")
    as_written = load_config(file, environment={}).tables
    always_there = "\n\n".join(block for block in text.split("\n\n") if not re.search(r"(?m)^#\[", block))
    without_default = (
        "factor|range_max_lx|contour_tolerance_w_m2|emissivity_broadband|temperature_|tilt_m|tilt_p"
        r"|\w+ = \[.*least and greatest"
    )
    file.write_text(re.sub(rf"(?m)^#(?!{without_default})(?=[a-z])", "", always_there), encoding="utf-8")
    assert re.search(r"(?m)^albedo = 0.2 ", file.read_text())
    assert load_config(file, environment={}).tables == as_written
