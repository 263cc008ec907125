"""The campaigns under ``examples/`` run as they stand."""

import json
import re
import shutil
from pathlib import Path

import pytest

from fieldkit.config import load_config
from fieldkit.drivers import registry
from fieldkit.model.samples import Health, Reading, StreamHealth
from fieldkit.views.latest import Latest
from fieldkit.views.metrics import metrics
from tests.harness.command_line import document
from tests.harness.seldom import SET_SELDOM
from tests.unit.views.conftest import frame, make_minute, regions, site, streams  # noqa: F401 - fixtures

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*/fieldkit.toml"))
SIMULATED = [file for file in EXAMPLES if 'port = "simulated"' in file.read_text(encoding="utf-8")]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.parent.name)
def test_an_example_is_valid_and_its_drivers_exist(file):
    config = load_config(file, environment={})
    assert {device.name for device in config.devices} == {"camera", "lux", "thermometer"}
    assert {device.driver for device in config.devices} <= set(registry.names())


@pytest.mark.parametrize("file", SIMULATED, ids=lambda file: file.parent.name)
def test_a_simulated_example_records_and_gives_a_slope_for_every_bed(file, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(file.parent, folder, ignore=shutil.ignore_patterns("recordings", "reports"))
    words = ("record", "-C", folder, "--for", "12m", "--set", "simulation.speed=max", *SET_SELDOM)
    slopes = {slope["region"]: slope for slope in document(*words)["estimates"]}
    beds = [region for region in load_config(file, environment={}).regions if region.tilt_deg > 0]
    assert set(slopes) == {bed.name for bed in beds}
    assert all(abs(slopes[bed.name]["tilt_deg"] - bed.tilt_deg) < 10 for bed in beds)


def test_the_dashboard_asks_for_numbers_that_there_are(site, regions, streams, frame, make_minute):  # noqa: F811
    """Grafana's JSON: every metric of its queries is one of a recording with an alarm."""
    latest = Latest(site, regions, streams)
    for item in (frame, make_minute(), Health(0, 0, (StreamHealth("camera", 1, 0, 0),), 1)):
        latest.update(item)
    latest.update(Reading("lux", 0, 0, (1.0,)))
    text = metrics(latest, is_recording=True)
    dashboard = json.loads((Path(__file__).parents[2] / "examples/grafana-dashboard.json").read_text())
    queries = " ".join(target["expr"] for panel in dashboard["panels"] for target in panel["targets"])
    names = set(re.findall(r"fieldkit_\w+", queries))
    assert len(names) > 10
    assert {name for name in names if f"# TYPE {name.removesuffix('_total')} " not in text} == set()
