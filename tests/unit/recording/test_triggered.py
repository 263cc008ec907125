"""A recording that a threshold of the light starts, with the two minutes before it, and another one stops."""

import threading

import pytest

from fieldkit.config.load import ConfigMistakesError
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, DeviceAccessError
from fieldkit.model.samples import EventKind
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.last_samples import reach_s
from fieldkit.recording.preview import await_begin
from fieldkit.recording.record import prepare
from fieldkit.sessions.reader import open_session
from tests.harness.simulated import simulated_config
from tests.harness.waiting import wait_until

START = 'do = "start", channel = "lux", above = 1000.0, hold_s = 121.0'


def config_with(folder, triggers: str, *settings: str):
    fast = ("simulation.speed=max", 'estimator.model="paper"')
    return simulated_config(folder, *fast, f"trigger={{{triggers}}}", *settings)


def test_a_light_threshold_starts_a_recording_that_includes_the_two_minutes_before(tmp_path):
    config = config_with(tmp_path / "field", f"bright = {{{START}}}")
    options, warnings = RecordOptions(on_trigger=True, duration_s=5.0), []
    with prepare(config, options, warnings.append) as prepared:
        begun = await_begin(prepared, [], threading.Event())
        done = begun.run()
    assert warnings == []
    assert not done.was_stopped
    with open_session(done.path) as session:
        (mark,) = [event for event in session.events() if event.kind is EventKind.MARK]
        assert (mark.data["trigger"], mark.data["act"]) == ("bright", "start")
        times = {name: session.times_ns(name) / 1e9 - mark.time_ns / 1e9 for name in session.streams}
        assert not any(event.kind is EventKind.LOST for event in session.events())
    for name, every_s in (("camera", 1 / 8.7), ("lux", 1.0), ("thermometer", 1.0)):
        before = times[name][times[name] <= 0.0]
        assert before[0] == pytest.approx(-120.0, abs=2.0 * every_s)
        assert len(before) == pytest.approx(120.0 / every_s, rel=0.02)
    assert times["lux"][-1] == pytest.approx(5.0, abs=2.0)
    assert max(b - a for a, b in zip(times["lux"], times["lux"][1:], strict=False)) < 2.5  # nothing between


def test_another_threshold_stops_it(tmp_path):
    """A cloud over the light meter ends it before its planned end."""
    stop = 'do = "stop", channel = "lux", below = 60000.0'
    config = config_with(tmp_path / "field", f"dark = {{{stop}}}", 'simulation.faults=["cloud"]')
    with prepare(config, RecordOptions(duration_s=240.0)) as prepared:
        done = prepared.run()
    with open_session(done.path) as session:
        (mark,) = [event for event in session.events() if event.kind is EventKind.MARK]
        lasted_s = (session.end_ns - session.start_ns) / 1e9
    assert (mark.data["trigger"], mark.data["act"]) == ("dark", "stop")
    assert lasted_s < 200.0
    assert not done.was_stopped


def test_a_wait_that_is_called_off_closes_the_instruments(tmp_path):
    stopping = threading.Event()
    stopping.set()
    config = config_with(tmp_path / "field", f"bright = {{{START}}}")
    with prepare(config, RecordOptions(on_trigger=True)) as prepared:
        assert await_begin(prepared, [], stopping) is None
    wait_until(
        lambda: not any(thread.name.startswith("read-") for thread in threading.enumerate()), "they read"
    )


def test_a_trigger_without_its_channel_is_a_warning_and_none_at_all_an_error(tmp_path):
    config = config_with(tmp_path / "field", 'x = {do = "start", channel = "lux:none", above = 1.0}')
    warnings: list[str] = []
    with (
        pytest.raises(ConfigError) as refused,
        prepare(config, RecordOptions(on_trigger=True), warnings.append),
    ):
        pass
    assert str(refused.value.place) == "trigger"
    assert "[trigger." in str(refused.value.fix)
    assert any("trigger.x" in str(warning) for warning in warnings)


def test_a_trigger_needs_a_threshold(tmp_path):
    with pytest.raises(ConfigMistakesError) as refused:
        config_with(tmp_path / "field", 'x = {do = "start", channel = "lux"}')
    assert "trigger.x" in str(refused.value)


def test_a_fail_safe_line_that_is_none_is_found_before_the_recording(tmp_path):
    config = config_with(tmp_path / "field", "", "fail_safe.line=/nonexistent")
    with pytest.raises(DeviceAccessError) as refused, prepare(config, RecordOptions()):
        pass
    assert refused.value.place == "fail_safe.line"


def test_memory_reaches_minutes_of_a_small_camera_and_seconds_of_a_large_one():
    small, large = (
        StreamInfo("camera", "brightness_temperature", "K", shape, 0.01, rate_hz=rate_hz)
        for shape, rate_hz in (((120, 160), 9.0), ((512, 640), 30.0))
    )
    assert reach_s([small]) >= 120.0
    assert 3.0 < reach_s([large]) < 10.0
