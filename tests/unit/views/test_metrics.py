"""OpenMetrics text as an independent parser reads it (prometheus_client, the reference implementation)."""

import math

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from fieldkit.model.alarm import Alarm, Phase
from fieldkit.model.samples import Health, Quality, Reading, Severity, StreamHealth
from fieldkit.views.latest import Latest
from fieldkit.views.metrics import MetricsFile, metrics
from tests.harness.waiting import wait_until
from tests.unit.views.conftest import START_NS

NAME = 'three "beds"\\n'


@pytest.fixture
def latest(site, regions, streams, frame, make_minute):
    latest = Latest(site, regions, streams, NAME)
    latest.update(frame)
    latest.update(Reading("lux", 0, START_NS, (98_760.0,)))
    latest.update(Reading("thermometer", 0, START_NS, (300.15, 290.0), quality=Quality.NO_VALUE))
    latest.update(make_minute())
    for second in (0, 10):
        camera = StreamHealth("camera", 90 * second, 3, 0, rejected=2)
        latest.update(Health(second * 10**9, START_NS, (camera,), 5_000_000, 7_000_000, lag_ms=40.0))
    alarm = Alarm("lost", "camera", Severity.ERROR, START_NS, "camera does not respond")
    latest.update(alarm.event(Phase.RAISED, 0, START_NS))
    return latest


def values(text: str) -> dict[tuple[str, ...], float]:
    """Every value by its name and the texts of its labels."""
    families = text_string_to_metric_families(text)
    return {
        (sample.name.removeprefix("fieldkit_"), *sample.labels.values()): sample.value
        for family in families
        for sample in family.samples
    }


def test_a_parser_finds_every_number(latest):
    found = values(metrics(latest, is_recording=True))
    expected = {
        ("recording",): 1.0,
        ("samples_total", "camera"): 900.0,
        ("samples_lost_total", "camera"): 3.0,
        ("samples_garbled_total", "camera"): 2.0,
        ("sample_rate_hertz", "camera"): 90.0,
        ("channel_value", "lux", "lux", "lx"): 98_760.0,
        ("region_tilt_degrees", "b15"): 15.5,
        ("disk_free_bytes",): 5e6,
        ("written_bytes_total",): 7e6,
        ("lag_seconds",): pytest.approx(0.04),
        ("alarm", "lost:camera"): 1.0,
        ("alarms_raised_total", "error"): 1.0,
        ("clock_steady",): 1.0,
        ("last_second_timestamp_seconds",): START_NS / 1e9,
    }
    assert {key: found[key] for key in expected} == expected
    assert math.isnan(found["channel_value", "thermometer", "flat", "°C"])
    assert {key[1] for key in found if key[0] == "build_info"} == {NAME}


def test_nothing_known_yet_is_text_too(site):
    assert values(metrics(Latest(site, (), ()), is_recording=False))["recording",] == 0.0


def test_a_file_has_the_last_state_and_says_at_the_end_that_nothing_is_recorded(
    tmp_path, latest, monkeypatch
):
    monkeypatch.setattr("fieldkit.views.metrics.FILE_EVERY_S", 0.01)
    path = tmp_path / "fieldkit.prom"
    view = MetricsFile(path, latest)
    wait_until(path.exists, "no file is written", every_s=0.01)
    view.show(Reading("lux", 1, START_NS, (5.0,)))
    wait_until(
        lambda: values(path.read_text())["channel_value", "lux", "lux", "lx"] == 5.0, "it is not written anew"
    )
    view.close()
    assert values(path.read_text())["recording",] == 0.0
    assert [file.name for file in tmp_path.iterdir()] == ["fieldkit.prom"]


def test_a_folder_that_is_gone_costs_the_file_alone(tmp_path, latest, monkeypatch, caplog):
    monkeypatch.setattr("fieldkit.views.metrics.FILE_EVERY_S", 0.01)
    view = MetricsFile(tmp_path / "gone" / "fieldkit.prom", latest)
    wait_until(lambda: caplog.records, "nothing is reported", every_s=0.01)
    view.close()
