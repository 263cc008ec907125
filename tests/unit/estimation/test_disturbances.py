import numpy as np
import pytest

from fieldkit.estimation.disturbances import CloudMonitor, Cusum, ShadeMonitor

SECOND_NS = 10**9


def changes(levels, every_s=5):
    """Seconds, kinds and reasons of the changes, and the monitor."""
    monitor = CloudMonitor()
    found = ((i * every_s, monitor.update(i * every_s * SECOND_NS, level)) for i, level in enumerate(levels))
    return [(second, *change) for second, change in found if change is not None], monitor


def test_cloud_begins_at_the_reading_that_shows_it_and_ends_when_the_light_is_steady():
    levels = [100.0] * 60 + [60.0] * 40 + [99.0] * 40
    (begin, end), monitor = changes(levels)
    assert begin[:2] == (60 * 5, "begin")
    assert end[:2] == ((100 + 12) * 5, "end")  # one minute after the light came back
    assert not monitor.cloudy


def test_light_that_stays_away_is_the_new_weather_after_twenty_minutes():
    (begin, end), _ = changes([100.0] * 60 + [40.0] * 300)
    assert end[0] - begin[0] == pytest.approx(1200.0, abs=5.0)
    assert "40%" in end[2]


def test_slow_change_and_noise_are_no_cloud():
    random = np.random.default_rng(0)
    found, _ = changes(np.linspace(100, 40, 2000) * (1 + 0.02 * random.standard_normal(2000)))
    assert found == []


def test_flicker_ends_only_when_it_ends():
    found, _ = changes([100.0] * 30 + [60.0, 100.0] * 50 + [100.0] * 30)
    assert [kind for _, kind, _ in found] == ["begin", "end"]


def test_readings_without_value_are_passed_over():
    found, monitor = changes([100.0] * 30 + [float("nan"), 0.0, -3.0] + [100.0] * 30)
    assert found == []
    assert not monitor.cloudy


def test_cusum_stays_quiet_through_clear_hours_and_sees_a_loss_at_once():
    random = np.random.default_rng(5)
    quiet = 0
    for _ in range(20):
        monitor = Cusum()
        curve = 310.0 + 12.0 * np.sin(np.arange(420) / 420 * np.pi) + 0.05 * random.standard_normal(420)
        quiet += sum(monitor.update(minute, value) is not None for minute, value in enumerate(curve))
    # 20 sessions of seven hours: the published rate at h = 8 is none; allowed is one each
    assert quiet < 20
    monitor = Cusum()
    for minute in range(60):
        assert monitor.update(minute, 310.0 + 0.02 * minute + 0.05 * random.standard_normal()) is None
    # 20 % of the light lost over ground of 13 kJ/(m2 K): -5 K with a time constant of 9 minutes
    falls = [monitor.update(60 + m, 311.2 - 5.0 * (1 - np.exp(-(m + 1) / 9.0))) for m in range(3)]
    jump = next(jump for jump in falls[:2] if jump is not None)
    assert jump.found < jump.expected


def test_shade_ends_when_half_of_the_fall_is_made_good():
    monitor = ShadeMonitor()
    values = [3.0] * 30 + [1.0] * 5 + [2.6] * 20
    shaded = [monitor.update(minute, value) for minute, value in enumerate(values)]
    assert shaded == [False] * 30 + [True] * 5 + [False] * 20
