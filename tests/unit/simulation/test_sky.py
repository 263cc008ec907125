import numpy as np
import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.simulation import ClearSky, MeasuredSky
from fieldkit.simulation.sky import SkyState
from fieldkit.weather import packaged_day

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
PAPER_NOON_NS = np.array([np.datetime64("2017-08-30T03:00", "ns").astype(np.int64)])


@pytest.fixture(scope="module")
def weather():
    return packaged_day()


def test_measured_sky_goes_through_the_middle_of_the_minutes(weather):
    sky_state = MeasuredSky(weather).sky_state(weather.time_ns, np.ones(1440), weather.site)
    np.testing.assert_array_equal(sky_state.dni_w_m2, np.maximum(weather.dni_w_m2, 0.0))
    np.testing.assert_array_equal(sky_state.air_temperature_k, weather.air_temperature_k)


def test_measured_sky_draws_straight_lines_between_minutes(weather):
    between = weather.time_ns[1200:1201] + 15_000_000_000
    sky_state = MeasuredSky(weather).sky_state(between, np.ones(1), weather.site)
    assert sky_state.dni_w_m2[0] == pytest.approx(
        0.75 * weather.dni_w_m2[1200] + 0.25 * weather.dni_w_m2[1201]
    )


def test_another_day_than_the_measured_one_is_refused(weather):
    with pytest.raises(ConfigError, match="2016-01-01"):
        MeasuredSky(weather).sky_state(PAPER_NOON_NS, np.ones(1), weather.site)


def test_clear_sky_gives_the_long_wave_the_paper_assumes():
    """Some 400 W/m² at 303.15 K of air in the simulation study; Swinbank gives 412."""
    sky_state = ClearSky(air_temperature_k=303.15, swing_k=0.0).sky_state(
        PAPER_NOON_NS, np.array([0.892]), PAPER_SITE
    )
    assert sky_state.longwave_down_w_m2[0] == pytest.approx(412.0, abs=1.0)
    assert 700.0 < sky_state.dni_w_m2[0] < 1000.0


def test_clear_sky_is_warmest_in_the_solar_afternoon():
    day_ns = PAPER_NOON_NS[0] + np.arange(-720, 720, 10) * 60_000_000_000
    sky_state = ClearSky(air_temperature_k=300.0, swing_k=4.0).sky_state(
        day_ns, np.full(day_ns.size, 0.5), PAPER_SITE
    )
    warmest = np.datetime64(int(day_ns[sky_state.air_temperature_k.argmax()]), "ns") + np.timedelta64(9, "h")
    assert warmest.astype(object) % 86_400_000_000_000 / 3.6e12 == pytest.approx(14.7, abs=0.2), "15 h solar"
    assert np.ptp(sky_state.air_temperature_k) == pytest.approx(8.0, abs=0.1)


def test_clear_sky_is_cold_in_the_camera_band_and_an_overcast_is_not(weather):
    """Window-band sky of -20 to -60 °C when clear and humid to dry."""
    noon = MeasuredSky(weather).sky_state(weather.time_ns[1140:1320], np.ones(180), weather.site)
    assert -60.0 < noon.window_temperature_k().mean() - 273.15 < -20.0
    air = np.array([280.0])
    overcast = SkyState(air, air, STEFAN_BOLTZMANN * air**4, air, air)
    assert overcast.window_temperature_k()[0] == pytest.approx(280.0)
