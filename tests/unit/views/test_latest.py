import io
import math
from dataclasses import replace

import pytest
from rich.console import Console

from fieldkit.model.alarm import Alarm, Phase
from fieldkit.model.samples import Event, EventKind, Health, Reading, Severity, StreamHealth
from fieldkit.views.latest import Latest
from fieldkit.views.screen import THEMES, regions_table

SECOND_NS = 10**9


@pytest.fixture
def latest(site, regions, streams):
    return Latest(site, regions, streams, "three-beds")


def health(second: int, received: int) -> Health:
    return Health(second * SECOND_NS, second * SECOND_NS, (StreamHealth("camera", received, 0, 0),), 10**9)


def event(kind: EventKind, severity: Severity = Severity.INFO, text: str = "something") -> Event:
    return Event(kind, 5, 5, text, "camera", severity)


def test_rate_is_over_the_last_minute_and_unknown_at_first(latest):
    for second in range(120):
        assert math.isnan(latest.rate_hz("camera")) == (second < 2)
        latest.update(health(second, 9 * min(second, 89)))  # silent for the last half minute
    assert latest.rate_hz("camera") == pytest.approx(9 * 30 / 60)


def test_age_is_that_of_the_last_sample_of_each_instrument(latest, frame):
    assert latest.age_s("lux") == 0.0
    latest.update(Reading("lux", 0, frame.time_ns - 14 * SECOND_NS, (1.0,)))
    latest.update(frame)
    assert (latest.age_s("lux"), latest.age_s("camera")) == (pytest.approx(14.0), 0.0)
    latest.update(frame._replace(stream="cam2", time_ns=frame.time_ns + 120 * SECOND_NS))
    assert (latest.age_s("camera"), latest.age_s("cam2")) == (pytest.approx(120.0), 0.0)


def test_only_the_latest_of_a_kind_is_kept(latest, frame):
    latest.update(frame)
    for value in (1.0, 2.0):
        latest.update(Reading("lux", 1, 1, (value,)))
    assert latest.frame is frame
    assert [reading.values for _, reading in latest.of_quantity("illuminance")] == [(2.0,)]


def test_alarms_are_present_until_they_are_over_and_counted_by_severity(latest):
    lost = Alarm("lost", "camera", Severity.ERROR, 5, "camera does not respond")
    cloud = Alarm("cloud", "", Severity.INFO, 7, "the light is unsteady: clouds")
    for alarm in (lost, cloud):
        latest.update(alarm.event(Phase.RAISED, 9, 9))
    latest.update(lost.event(Phase.ACKNOWLEDGED, 10, 10))
    assert latest.alarms == (replace(lost, acknowledged=True), cloud)
    latest.update(lost.event(Phase.CLEARED, 11, 11))
    latest.update(event(EventKind.LOST, Severity.WARNING))  # an event, but no alarm
    assert latest.alarms == (cloud,)
    assert latest.raised == {Severity.ERROR: 1, Severity.INFO: 1}


def test_gaps_are_counted_by_stream(latest):
    latest.update(event(EventKind.GAP))
    latest.update(event(EventKind.GAP))
    assert latest.gaps == {"camera": 2}


@pytest.mark.parametrize("kind", [EventKind.CLOCK_STEP, EventKind.SLEPT])
def test_a_step_of_the_clock_is_remembered(latest, kind):
    assert latest.clock_event is None
    latest.update(event(kind, text="a step"))
    latest.update(event(EventKind.SHUTTER))
    assert latest.clock_event.text == "a step"


def test_a_long_recording_does_not_pile_up_events(latest):
    for _ in range(500):
        latest.update(event(EventKind.SHUTTER))
    assert len(latest.events) == 50


def test_time_never_runs_backwards(latest):
    latest.update(Reading("lux", 9, 9, (1.0,)))
    latest.update(Reading("lux", 7, 7, (1.0,)))
    assert latest.time_ns == 9
    assert latest.start_ns == 9


def test_a_regions_cells_are_temperature_spread_tilt_azimuth_and_state(latest, make_minute):
    latest.update(make_minute(0))
    console = Console(file=io.StringIO(), width=120, theme=THEMES["dark"])
    console.print(regions_table(latest, 120, 20))
    line = next(line for line in console.file.getvalue().splitlines() if line.startswith("b15"))
    # 310 K, spread 0.2 K
    assert line.split()[1:8] == ["36.85", "0.20", "15.5", "±1.5", "178", "±10", "0.33"]
