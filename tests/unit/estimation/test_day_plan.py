"""Bounds and sensitivities at the site of the paper, against numbers computed elsewhere."""

import numpy as np
import pytest

from fieldkit.estimation.day_plan import PlanSettings, bound, cosine_noise, expected_temperature, sensitivity
from fieldkit.model.site import Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.facet import normal
from fieldkit.physics.sun import sun_vectors

PAPER = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
TABLE_1 = SurfaceParameters()
TEN_SOUTH = normal([10.0], [180.0])


def suns(start_utc: str, minutes: int) -> np.ndarray:
    start = np.datetime64(start_utc, "ns").astype(np.int64)
    return sun_vectors(start + np.arange(minutes, dtype=np.int64) * 60_000_000_000, PAPER)


# sigma of the cosine 0.005, equal weights, one row a minute: tilt, direction, correlation
@pytest.mark.parametrize(
    ("start", "rows", "tilt", "direction", "correlation", "mirror"),
    [
        ("2017-08-30T00:00", 21, 4.6437, 1.4669, 0.9976, (46.780, 175.139)),
        ("2017-08-30T03:00", 21, 0.9912, 2.3635, -0.9748, (43.299, 180.825)),
        ("2017-08-30T06:00", 21, 5.4823, 0.8794, -0.9958, (49.554, 186.190)),
        ("2017-08-30T00:00", 181, 0.1254, 0.0870, 0.7467, None),
    ],
)
def test_golden_bounds(start, rows, tilt, direction, correlation, mirror):
    found = bound(TEN_SOUTH, suns(start, rows), 0.005)
    # the sun of those numbers is SPA's, 0.0015 degrees from astropy's: about 0.03 % of a 20 minutes' bound
    assert found.tilt_deg[0] == pytest.approx(tilt, rel=1e-3)
    assert found.direction_deg[0] == pytest.approx(direction, rel=1e-3)
    assert found.correlation[0] == pytest.approx(correlation, abs=1e-3)
    if mirror:
        assert (found.mirror_tilt_deg[0], found.mirror_azimuth_deg[0]) == pytest.approx(mirror, abs=0.05)


# degrees of tilt per kelvin between bed and reference: S 800 W/m2, 315 K in August, 295 K in December
@pytest.mark.parametrize(
    ("date", "kelvin", "tilt", "degrees"),
    [
        ("2017-08-30", 315.0, 10.0, (7.7, 8.4, 10.3, 15.9)),
        ("2017-08-30", 315.0, 20.0, (19.2, 21.9, 31.6, 92.5)),
        ("2017-12-11", 295.0, 5.0, (2.6, 2.7, 2.9, 3.3)),
        ("2017-12-11", 295.0, 15.0, (3.0, 3.1, 3.3, 3.7)),
        ("2017-12-11", 295.0, 25.0, (3.8, 3.9, 4.0, 4.3)),
    ],
)
def test_degrees_per_kelvin_over_the_papers_afternoons(date, kelvin, tilt, degrees):
    hourly = np.vstack([suns(f"{date}T{hour:02d}:00", 1) for hour in (3, 4, 5, 6)])
    found = sensitivity(normal([tilt], [180.0]), hourly, 800.0, kelvin, TABLE_1)
    np.testing.assert_allclose(1.0 / found.temperature_k[0], degrees, rtol=0.01, atol=0.05)


def test_watts_per_degree_on_a_winter_day():
    # 2026-12-11, S 800 W/m2, beds of 5, 15 and 25 degrees at 10, 12 and 15 h JST
    hourly = np.vstack([suns(f"2026-12-11T{hour:02d}:00", 1) for hour in (1, 3, 6)])
    found = sensitivity(normal([5.0, 15.0, 25.0], 180.0), hourly, 800.0, 295.0, TABLE_1)
    expected = [[10.7, 11.2, 8.8], [9.2, 9.6, 7.9], [7.5, 7.7, 6.8]]
    np.testing.assert_allclose(found.irradiance_w_m2, expected, atol=0.06)


def test_sensitivity_is_the_derivative_of_the_expected_temperature():
    sun = suns("2017-12-11T03:00", 1)
    beds = normal([14.99, 15.0, 15.01], 180.0)
    warm = expected_temperature(beds, sun, 800.0, PlanSettings(air_k=283.0))
    found = sensitivity(beds, sun, 800.0, warm, TABLE_1).temperature_k
    assert (warm[2, 0] - warm[0, 0]) / 0.02 == pytest.approx(found[1, 0], rel=1e-4)


def test_noise_of_the_cosine():
    # sqrt(2) x 30.7 W/m2/K x 0.1 K / 800 W/m2 at 315 K
    assert cosine_noise(800.0, 315.0, 0.1, TABLE_1) == pytest.approx(0.00543, rel=2e-3)
    assert np.isinf(cosine_noise(0.0, 300.0, 0.1, TABLE_1))


def test_facet_in_its_own_shade_has_no_bound():
    found = bound(normal([60.0, 10.0], [0.0, 180.0]), suns("2017-12-11T06:00", 21), 0.005)
    assert np.isnan(found.tilt_deg[0])
    assert np.isnan(found.mirror_tilt_deg[0])
    assert np.isfinite(found.tilt_deg[1])


def test_longer_windows_are_never_worse():
    sun = suns("2017-08-30T00:00", 361)
    sigma = np.full((1, 361), 0.005)
    bounds = [bound(TEN_SOUTH, sun[: minutes + 1], sigma[:, : minutes + 1]) for minutes in (20, 60, 360)]
    spans = [np.hypot(one.tilt_deg, one.direction_deg)[0] for one in bounds]
    assert spans[0] > spans[1] > spans[2]
