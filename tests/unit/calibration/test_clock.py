"""The light is the simulated field's meter under the sky measured at Alamosa on 2016-01-01."""

import numpy as np
import pytest

from fieldkit.calibration.clock import offset_from_sun, offset_from_times
from fieldkit.errors import CalibrationError
from fieldkit.scene.sand_slopes import sand_slopes

MINUTE = 60_000_000_000


@pytest.fixture(scope="module")
def light():
    """Times, light and site of three hours from noon."""
    scene = sand_slopes()
    times = scene.start_ns + np.arange(180) * MINUTE
    return times, np.array([scene.lux_reading(int(time)) for time in times]), scene.site


@pytest.mark.parametrize("wrong_s", [0, -3600, 3600, 32_400])
def test_a_wrong_zone_is_found_within_the_stated_minutes(light, wrong_s):
    times, lux, site = light
    found = offset_from_sun(times + wrong_s * 1_000_000_000, lux, site)
    assert found.offset_s == pytest.approx(-wrong_s, abs=found.expanded_s)
    assert found.expanded_s < 600.0


def test_clouds_are_left_out(light):
    times, lux, site = light
    clouded = lux.copy()
    clouded[60:75] *= 0.4
    found = offset_from_sun(times + 60 * MINUTE, clouded, site)
    assert found.offset_s == pytest.approx(-3600.0, abs=found.expanded_s)
    assert found.readings <= 165


def test_light_that_tells_no_time_is_refused(light):
    times, lux, site = light
    with pytest.raises(CalibrationError, match="less than an hour"):
        offset_from_sun(times[:30], lux[:30], site)
    broken = lux * np.random.default_rng(1).uniform(0.4, 1.0, lux.size)
    with pytest.raises(CalibrationError, match="scatters by"):
        offset_from_sun(times, broken, site)


def test_a_receivers_times_give_their_median_and_its_own_doubt():
    own = np.arange(100) * 1_000_000_000
    late = 0.2 * np.random.default_rng(2).standard_normal(100)
    found = offset_from_times(own, own + np.round((27.5 + late) * 1e9).astype(np.int64), 0.4, "receiver")
    assert found.offset_s == pytest.approx(27.5, abs=0.06)
    assert found.standard_uncertainty_s == pytest.approx(0.4, abs=0.01)


def test_a_clock_that_was_stepped_in_between_and_no_moment_at_all_are_refused():
    own = np.arange(100) * 1_000_000_000
    with pytest.raises(CalibrationError, match="one was stepped"):
        offset_from_times(own, own + np.where(own > own[50], 3_600_000_000_000, 0), 0.4, "receiver")
    with pytest.raises(CalibrationError, match="no moment"):
        offset_from_times(own[:0], own[:0], 0.4, "receiver")
