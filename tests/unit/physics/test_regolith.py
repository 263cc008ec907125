"""Ground temperatures against heat1d 0.3.2 (P. O. Hayne, MIT), run once; its numbers stand here.

Equator, no eccentricity or obliquity, noon first, every two hours; 40 days of settling. With 20 layers in
the first skin depth, each 1/40 thicker than the one above (its default is 1/5): heat1d's flux through the
surface takes the first two layers as equally thick, at 1/5 that is a tenth too little.
"""

import numpy as np
import pytest

from fieldkit.physics.regolith import Regolith, day_temperatures

HOURS_FROM_NOON = np.arange(0.0, 24.0, 2.0)
# planets.Moon with 1361 W/m2 at 1 au, a day of 29.53059 d
MOON_K = (385.23, 370.15, 310.39, 130.83, 110.06, 103.78, 99.94, 97.22, 95.14, 93.47, 307.57, 369.27)
# planets.Mars, 589.2 W/m2, albedo 0.25, emissivity 0.98, a day of 24.6597 h, k = 0.0625 W/(m K), 1 MJ/(m3 K)
MARS_K = (268.06, 269.85, 254.26, 219.97, 201.93, 193.33, 187.56, 183.25, 179.82, 176.99, 211.80, 248.44)
MARS = Regolith(
    0.0625, 0.0625, 1300.0, 1300.0, heat_capacity=(1.0e6 / 1300.0,), emissivity=0.98, flux_from_below_w_m2=0.0
)
STEPS = 480


def lunar_albedo(cosine):
    """Keihm, Icarus 60, 1984, with the coefficients of Hayne et al. 2017."""
    incidence = np.arccos(cosine) / np.pi * 2.0  # 1: the sun on the horizon
    return 0.12 + 0.06 * (2.0 * incidence) ** 3 + 0.25 * incidence**8


def every_two_hours(regolith, light_w_m2, albedo, day_s, start_k):
    cosine = np.maximum(np.cos(2.0 * np.pi * np.arange(1, STEPS + 1) / STEPS), 0.0)
    absorbed = light_w_m2 * cosine * (1.0 - albedo(cosine))
    found = day_temperatures(regolith, absorbed, day_s, days=12, start_k=start_k)
    return np.interp(HOURS_FROM_NOON, 24.0 * np.arange(1, STEPS + 1) / STEPS, found, period=24.0)


def test_the_moons_equator_is_as_warm_as_in_heat1d():
    found = every_two_hours(Regolith(), 1361.0, lunar_albedo, 29.53059 * 86_400.0, 250.0)
    assert found == pytest.approx(MOON_K, abs=2.0)


def test_the_equator_of_mars_is_as_warm_as_in_heat1d():
    found = every_two_hours(MARS, 589.2, lambda _: 0.25, 24.6597 * 3600.0, 215.0)
    assert found == pytest.approx(MARS_K, abs=2.0)


def test_exchange_with_air_pulls_towards_its_temperature():
    dark = np.zeros(48)
    found = day_temperatures(
        MARS, dark, 88_775.0, exchange_w_m2_k=50.0, air_temperature_k=220.0, days=3, start_k=220.0
    )
    assert 210.0 < found[-1] < 220.0
