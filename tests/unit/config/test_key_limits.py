"""Every number of a configuration has limits, and what lies beyond is refused with the unit it may be in."""

from pathlib import Path

import pytest

from fieldkit.config import ConfigMistakesError, config_from_text
from fieldkit.config.files import table_in
from fieldkit.config.load import _Document
from fieldkit.config.toml_schema import json_schema, resolve

SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"


def places(node, path=()):
    """Every place that the schema describes, with its schema; "x" is any key of a table without names."""
    node = resolve(node)
    yield path, node
    for branch in node.get("anyOf", ()):
        yield from places(branch, path)
    tables = [node.get("additionalProperties"), *node.get("patternProperties", {}).values()]
    below = [
        *node.get("properties", {}).items(),
        *(("x", table) for table in tables if isinstance(table, dict)),
    ]
    items = node.get("prefixItems") or [node["items"]] if "items" in node else node.get("prefixItems", [])
    for key, inner in (*below, *enumerate(items)):
        yield from places(inner, (*path, key))


PLACES = [(path, node) for path, node in places(json_schema()) if path]


def test_every_number_has_two_limits():
    numbers = {path: {*node} for path, node in PLACES if node.get("type") in ("number", "integer")}
    del numbers["schema",]
    assert len(numbers) > 100
    for path, names in numbers.items():
        assert names & {"minimum", "exclusiveMinimum"}, path
        assert names & {"maximum", "exclusiveMaximum"}, path


@pytest.mark.parametrize(
    ("setting", "limits", "instead"),
    [
        ("slab.heat_capacity_j_m3_k=1.3", "100000 to 5000000", "1.3e+06 if it is in MJ/(m³ K)"),
        ("slab.heat_capacity_j_m3_k=1300", "100000 to 5000000", "1.3e+06 if it is in kJ/(m³ K)"),
        ("slab.depth_m=3", "0.001 to 2", "0.03 if it is in cm"),
        ("estimator.longwave_down_w_m2=1e9", "0 to 700", ""),
        ("estimator.longwave_down_w_m2=0.3", "40 to 700", "300 if it is in kW/m²"),
        ("estimator.longwave_down_w_m2=30", "40 to 700", "300 if it is in mW/cm²"),
        ("estimator.confidence=0.49", "0.5 to 0.99", ""),
        ("estimator.confidence=90", "0.5 to 0.99", "0.9 if it is in %"),
        ("estimator.window_s=20", "60 to 86400", "1200 if it is in minutes"),
        ("air.density_kg_m3=0.00121", "0.3 to 2", "1.21 if it is in g/cm³"),
        ("air.heat_capacity_j_kg_k=1.005", "500 to 2500", "1005 if it is in kJ/(kg K)"),
        ("air.exchange_m_s=-1", "0 to 1", ""),
        ("surface.emissivity=1e-12", "0.01 to 1", ""),
        ("surface.emissivity=95", "0.01 to 1", "0.95 if it is in %"),
        ("surface.albedo=20", "below 1", "0.2 if it is in %"),
        ("surface.reflected_temperature_c=253.15", "-120 to 100", "-20 if it is in K"),
        ("limits.surface_temperature_c=[-500,50]", "-273.15 to", ""),
        ("irradiance.measures={sun='gni'}", '"ghi"', ""),
        ("prior.gain_sd=9", "0.0001 to 1", "0.09 if it is in %"),
        ('site.body=["mars"]', '"mars"', ""),
    ],
)
def test_a_value_beyond_its_limits_names_them_and_the_likely_unit(setting, limits, instead):
    with pytest.raises(ConfigMistakesError) as caught:
        config_from_text(SITE, Path("x.h5"), settings=[setting])
    (mistake,) = caught.value.mistakes
    assert setting.partition("=")[0] in mistake
    assert limits in mistake
    assert instead in mistake
    assert bool(instead) == ("if it is in" in mistake)


def test_other_worlds_have_wider_limits():
    settings = ("estimator.longwave_down_w_m2=5", "air.density_kg_m3=0.02")
    config_from_text(SITE + 'body = "mars"\n', Path("x.h5"), settings=settings)


WRONG = (["mars"], {"a": 1}, {}, [], "", True, -1, 1e300, 10**400, float("nan"), [1], [{}], [["a"]], [None])


@pytest.mark.parametrize("table", list(resolve(json_schema())["properties"]))
def test_a_value_of_any_kind_at_any_place_is_accepted_or_a_mistake(table):
    for path in {path for path, _ in PLACES if path[0] == table}:
        for value in WRONG:
            wrong = value
            for key in reversed(path[1:]):
                wrong = [wrong] if isinstance(key, int) else {key: wrong}
            document = _Document({"site": {"latitude_deg": 35.5, "longitude_deg": 139.4}})
            own = table_in(document.values, table)
            document.values[table] = own | wrong if isinstance(wrong, dict) else wrong
            document.check(Path("nowhere") / "fieldkit.toml", of_campaign=True)
