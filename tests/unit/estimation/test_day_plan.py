"""Sensitivities at the site of the paper, against numbers computed elsewhere."""

import numpy as np
import pytest

from fieldkit.estimation.day_plan import PlanSettings, expected_temperature, sensitivity
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.facet import normal
from tests.harness.papers_field import suns

TABLE_1 = SurfaceParameters()


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
    hourly = suns(f"{date}T03:00", 240, 60)
    found = sensitivity(normal([tilt], [180.0]), hourly, 800.0, kelvin, TABLE_1)
    np.testing.assert_allclose(1.0 / found.temperature_k[0], degrees, rtol=0.01, atol=0.05)


def test_sensitivity_is_the_derivative_of_the_expected_temperature():
    sun = suns("2017-12-11T03:00", 1)
    beds = normal([14.99, 15.0, 15.01], 180.0)
    warm = expected_temperature(beds, sun, 800.0, PlanSettings(air_k=283.0))
    found = sensitivity(beds, sun, 800.0, warm, TABLE_1).temperature_k
    assert (warm[2, 0] - warm[0, 0]) / 0.02 == pytest.approx(found[1, 0], rel=1e-4)
