"""Expected: Pearson's data with York's weights, slope -0.4805, intercept 5.4799 (York et al. 2004)."""

import numpy as np
import pytest

from fieldkit.calibration.line import Points, fit_line

X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])
WX = np.array([1000.0, 1000, 500, 800, 200, 80, 60, 20, 1.8, 1])
WY = np.array([1.0, 1.8, 4, 8, 20, 20, 70, 70, 100, 500])


def test_pearsons_data_with_yorks_weights():
    line = fit_line(Points(X, Y, WX**-0.5, WY**-0.5), origin=False)
    assert line.slope == pytest.approx(-0.48053340745, abs=1e-6)
    assert line.intercept == pytest.approx(5.47991022, abs=1e-5)
    assert line.chi_square == pytest.approx(11.8663531941, abs=1e-5)
    assert line.slope_sd == pytest.approx(0.0579850, rel=0.03)
    assert line.freedom == 8


def test_without_errors_in_x_it_is_ordinary_least_squares():
    random = np.random.default_rng(1)
    x = random.uniform(100, 300, 30)
    y = 0.9 * x + random.standard_normal(30)
    line = fit_line(Points(x, y, np.zeros(30), np.ones(30)), origin=True)
    assert line.slope == pytest.approx(x @ y / (x @ x), rel=1e-9)
    assert line.slope_sd == pytest.approx((x @ x) ** -0.5, rel=1e-5)


def test_errors_in_x_do_not_pull_the_slope_down():
    random = np.random.default_rng(2)
    slopes = []
    for _ in range(200):
        true = random.uniform(0, 10, 20)
        noisy = Points(true + random.standard_normal(20), 0.9 * true + 0.1 * random.standard_normal(20),
                       np.ones(20), np.full(20, 0.1))  # fmt: skip
        slopes.append(fit_line(noisy, origin=False).slope)
    assert np.median(slopes) == pytest.approx(0.9, abs=0.02)
