"""Golden numbers: independent SPA sun, Table 1 parameters, S = 800, Ta = 303.15, L = 400.

They were computed outside the project with the solar position algorithm of Reda and Andreas; the sun
here is astropy's, 0.0015 degrees away, which sets the tolerances.
"""

import numpy as np
import pytest

from fieldkit.estimation.normal import (
    Branches,
    Choice,
    Misfit,
    choose,
    cramer_rao,
    mirror,
    solve,
    solve_known_azimuth,
)
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_difference
from fieldkit.physics.facet import VERTICAL, angle_between_deg, normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors
from tests.harness.papers_field import SITE, suns, utc_ns

CASE_1 = (
    ["2017-08-30T03:00", "2017-08-30T04:00", "2017-08-30T05:00", "2017-08-30T06:00"],
    [325.23205, 324.02574, 321.34508, 317.34486],
    [323.60330, 322.50984, 320.08268, 316.46441],
)
CASE_2 = (
    ["2017-08-30T00:00", "2017-08-30T01:00", "2017-08-30T02:00", "2017-08-30T03:00"],
    [321.86850, 324.24478, 325.14110, 324.50615],
    [318.65543, 321.61792, 323.30003, 323.60330],
)


def misfit_of(case, scale: float = 1.0) -> tuple[Misfit, np.ndarray]:
    times, target, reference = case
    sun = sun_vectors(np.array([utc_ns(t) for t in times]), SITE)
    difference = irradiance_difference(target, reference, SurfaceParameters())
    return Misfit.of_rows(sun, scale * difference / 800.0 + sun[:, 2]), difference


@pytest.mark.parametrize(
    ("case", "differences", "b", "slope"),
    [
        (CASE_1, [51.14274, 47.45937, 39.26679, 27.12540], [-1.2973231, -1.2462472, 2.6296975], (10, 180)),
        (CASE_2, [99.82860, 82.17046, 57.78046, 28.32291], [1.0341381, -1.4415853, 2.9886734], (12, 135)),
    ],
)
def test_temperatures_of_a_known_bed_give_its_slope_back(case, differences, b, slope):
    misfit, found = misfit_of(case)
    # the golden temperatures are printed to 1e-5 K: 3e-4 W/m2
    np.testing.assert_allclose(found, differences, atol=5e-4)
    np.testing.assert_allclose(misfit.b, b, atol=1e-4)
    tilt, azimuth = tilt_azimuth(solve(misfit).first)
    assert tilt == pytest.approx(slope[0], abs=0.001)
    assert azimuth == pytest.approx(slope[1], abs=0.005)


def test_sum_of_sun_products_is_the_golden_matrix():
    H = misfit_of(CASE_1)[0].H
    expected = [0.9799023, 0.5479405, -1.2207197, 0.5556927, -1.1674889, 2.4644050]
    np.testing.assert_allclose(H[np.triu_indices(3)], expected, atol=1e-4)


@pytest.mark.parametrize(
    ("case", "vector", "length", "slope"),
    [
        (CASE_1, (0.0, -0.191013, 0.983289), 1.001670, (11.3254, 180.1277)),
        (CASE_2, (0.161717, -0.161717, 0.975962), 1.002401, (13.5607, 136.2429)),
    ],
)
def test_ten_percent_scale_error_tilts_as_published(case, vector, length, slope):
    misfit, _ = misfit_of(case, scale=1.1)
    three = np.linalg.solve(misfit.H, misfit.b)
    # the three-vector solution is ill-conditioned: the two suns, 0.0015 degrees apart, show
    np.testing.assert_allclose(three, vector, atol=5e-5)
    assert np.linalg.norm(three) == pytest.approx(length, abs=5e-5)
    tilt, azimuth = tilt_azimuth(solve(misfit).first)
    assert tilt == pytest.approx(slope[0], abs=0.002)
    assert azimuth == pytest.approx(slope[1], abs=0.01)


@pytest.mark.parametrize(
    ("start", "minutes", "tilt_sd", "direction_sd", "correlation", "other"),
    [
        ("2017-08-30T00:00", 21, 4.6437, 1.4669, 0.9976, (46.780, 175.139)),
        ("2017-08-30T03:00", 21, 0.9912, 2.3635, -0.9748, (43.299, 180.825)),
        ("2017-08-30T06:00", 21, 5.4823, 0.8794, -0.9958, (49.554, 186.190)),
        ("2017-08-30T00:00", 181, 0.1254, 0.0870, 0.7467, None),
    ],
)
def test_cramer_rao_bound_and_mirror_are_the_golden_ones(
    start, minutes, tilt_sd, direction_sd, correlation, other
):
    sun = suns(start, minutes)
    H = sun.T @ sun / 0.005**2
    covariance = cramer_rao(H, normal(10.0, 180.0))
    tilt, direction = np.degrees(np.sqrt(np.diagonal(covariance)))
    assert tilt == pytest.approx(tilt_sd, rel=1e-3)
    assert direction == pytest.approx(direction_sd, rel=1e-3)
    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) == pytest.approx(
        correlation, abs=1e-4
    )
    if other is not None:
        assert tilt_azimuth(mirror(normal(10.0, 180.0), H)) == pytest.approx(other, abs=0.005)


def test_both_branches_fit_and_are_mirrors_of_each_other():
    sun = suns("2017-08-30T03:00", 21)
    misfit = Misfit.of_rows(sun, sun @ normal(20.0, 180.0), 1 / 0.005**2)
    both = solve(misfit)
    tilts, _ = tilt_azimuth(np.stack([both.first, both.second]))
    # the mirror of 20 degrees south at noon is 33 degrees (independent simulation)
    assert sorted(tilts) == pytest.approx([20.0, 33.0], abs=0.7)
    assert both.second_misfit - both.first_misfit < 4.61


def test_two_slopes_sharing_the_sun_solve_as_each_alone():
    sun = suns("2017-08-30T00:00", 30)
    truths = normal([3.0, 22.0, 14.0], [10.0, 250.0, 359.5])
    together = solve(Misfit.of_rows(sun, truths @ sun.T, 4e4))
    for row, truth in enumerate(truths):
        alone = solve(Misfit.of_rows(sun, sun @ truth, 4e4))
        assert angle_between_deg(together.first[row], alone.first) < 1e-7


def test_rows_without_a_value_are_dropped():
    sun = suns("2017-08-30T00:00", 30)
    y = sun @ normal(12.0, 135.0)
    gappy = y.copy()
    gappy[[3, 17]] = np.nan
    kept = np.isfinite(gappy)
    whole, part = Misfit.of_rows(sun, gappy), Misfit.of_rows(sun[kept], y[kept])
    assert whole.count == 28
    np.testing.assert_allclose(whole.H, part.H)
    np.testing.assert_allclose(whole.b, part.b)


def test_unknown_slopes_stay_unknown_among_known_ones():
    sun = suns("2017-08-30T00:00", 30)
    y = np.stack([sun @ normal(12.0, 135.0), np.full(30, np.nan)])
    found = solve(Misfit.of_rows(sun, y)).first
    assert np.isnan(found[1]).all()
    assert angle_between_deg(found[0], normal(12.0, 135.0)) < 1e-5


def test_known_azimuth_gives_the_tilt_and_the_other_root():
    sun = suns("2017-08-30T03:00", 21)
    y = np.stack([normal(10.0, 180.0), VERTICAL]) @ sun.T
    tilts, others = solve_known_azimuth(Misfit.of_rows(sun, y), np.array([180.0, 180.0]), 45.0)
    assert tilts == pytest.approx([10.0, 0.0], abs=1e-6)
    assert 40.0 < others[0] < 45.0


# --- the more probable of two slopes that fit; the prior is uniform in tilt, 1 / sin(tilt) per solid angle

FLAT_DEG, STEEP_DEG = 10.0, 30.0
NO_MISFIT = Misfit(np.eye(3), np.zeros(3), np.zeros(()), np.asarray(20))


def chosen(first: tuple[float, float], second: tuple[float, float], limit_deg: float = 45.0) -> Choice:
    """Choice between two branches given as tilt and misfit, both towards the south."""
    branches = Branches(
        normal(first[0], 180.0), normal(second[0], 180.0), np.asarray(first[1]), np.asarray(second[1]),
        np.asarray(False),
    )  # fmt: skip
    return choose(NO_MISFIT, branches, limit_deg)


def tilt_of(choice: Choice) -> float:
    return float(tilt_azimuth(choice.best)[0])


@pytest.mark.parametrize(
    ("advantage", "preferred"),
    # the price of the steeper one is 2 ln(sin 30° / sin 10°) = 2.115
    [(0.0, FLAT_DEG), (1.5, FLAT_DEG), (2.05, FLAT_DEG), (2.2, STEEP_DEG), (6.0, STEEP_DEG)],
)
def test_a_steeper_slope_is_preferred_only_for_a_clearly_better_fit(advantage, preferred):
    found = chosen((STEEP_DEG, 5.0 - advantage), (FLAT_DEG, 5.0))
    assert tilt_of(found) == pytest.approx(preferred)
    other = STEEP_DEG if preferred == FLAT_DEG else FLAT_DEG
    assert float(tilt_azimuth(found.other)[0]) == pytest.approx(other)


def test_where_the_limit_stands_for_a_steeper_branch_the_flatter_one_stays_the_other():
    sun = suns("2017-08-30T03:00", 91)
    misfit = Misfit.of_rows(sun, sun @ normal(35.0, 180.0), 1 / 0.001**2)
    both = solve(misfit)
    flatter, steeper = sorted(tilt_azimuth(np.stack([both.first, both.second]))[0])
    limit = steeper - 0.2
    found = choose(misfit, both, limit, at_limit=True)
    alone = choose(misfit, both, limit)
    assert tilt_of(alone) == pytest.approx(flatter)
    assert np.isnan(alone.other).all()
    assert tilt_of(found) == pytest.approx(limit)
    assert found.misfit < found.other_misfit
    assert float(tilt_azimuth(found.other)[0]) == pytest.approx(flatter)
    assert found.other_misfit == pytest.approx(misfit(found.other))


def test_a_slope_beyond_the_limit_is_not_believed_however_well_it_fits():
    found = chosen((50.0, 0.0), (20.0, 30.0))
    assert tilt_of(found) == pytest.approx(20.0)
    assert np.isnan(found.other).all()
    assert tilt_of(chosen((45.0, 0.0), (20.0, 30.0))) == pytest.approx(45.0)
