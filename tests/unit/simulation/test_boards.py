import numpy as np
import pytest
from scipy.special import erfcx

from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.simulation import Exchange, MeasuredSky
from fieldkit.simulation.boards import HIDDEN_SKY, Board
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from fieldkit.simulation.scene_series import SceneModel
from fieldkit.simulation.sky import SkyState
from fieldkit.weather import packaged_day

BOARD = Board("b15", 600.0, 900.0)


def test_a_board_takes_the_beam_and_most_of_the_sky_while_it_lies_there():
    time_s = np.array([0.0, 601.0, 900.0, 901.0])
    one = np.ones(4)
    sky = BOARD.over(SkyState(800.0 * one, 100.0 * one, 250.0 * one, 290.0 * one, one), time_s)
    assert sky.dni_w_m2.tolist() == [800.0, 0.0, 0.0, 800.0]
    assert sky.dhi_w_m2 == pytest.approx([100.0, 20.0, 20.0, 100.0])
    under = (1 - HIDDEN_SKY) * 250.0 + HIDDEN_SKY * STEFAN_BOLTZMANN * 290.0**4
    assert sky.longwave_down_w_m2 == pytest.approx([250.0, under, under, 250.0])


def test_a_board_cools_its_bed_alone_as_a_half_space_cools_at_first():
    """A lost flux q that the bed regains H per kelvin: dT = q/H (1 - exp(b²) erfc b), b = H sqrt(t) / Gamma.

    Carslaw and Jaeger, "Conduction of Heat in Solids", 1959, 2.8. At noon of that day the sun stands at 29.3
    degrees (NOAA's calculator), 45.7 degrees from the normal of a bed of 15 degrees to the south.
    """
    weather = packaged_day()
    beds = tuple(Facet(name, (), 15.0, 180.0, depth_m=0.06) for name in ("b15", "b16"))
    sky = MeasuredSky(weather)
    model = SceneModel(weather.site, sky, beds, GROUND, Exchange(19.0, 0.0), (), 3.0, boards=(BOARD,))
    series = model.series(ALAMOSA_NOON_NS, 1200.0)
    shaded, lit = series.rows[6:8]
    before, after = series.time_s <= 600.0, int(np.searchsorted(series.time_s, 630.0))
    np.testing.assert_array_equal(shaded[before], lit[before])
    dni, dhi, longwave, air_k = series.rows[:4, after]
    beam, light = 0.8 * dni * np.cos(np.radians(45.7)), 0.8 * HIDDEN_SKY * dhi
    lost = beam + light - 0.9 * HIDDEN_SKY * (STEFAN_BOLTZMANN * air_k**4 - longwave)
    loss_w_m2_k = 19.0 + 4 * 0.9 * STEFAN_BOLTZMANN * lit[after] ** 3
    b = loss_w_m2_k * np.sqrt(30.0) / beds[0].stack[0].thermal_inertia
    assert (lit - shaded)[after] == pytest.approx(lost / loss_w_m2_k * (1.0 - erfcx(b)), rel=0.05)
