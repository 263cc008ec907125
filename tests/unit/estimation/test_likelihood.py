import numpy as np
import pytest

from fieldkit.estimation.likelihood import (
    Grid,
    LikelihoodRegion,
    ProfileMisfit,
    patches,
    profiled_gram,
    regions,
    regions_known_azimuth,
    with_systematics,
)
from fieldkit.estimation.normal import Misfit, choose, cramer_rao, solve
from fieldkit.model.confidence import misfit_drop
from fieldkit.physics.facet import VERTICAL, normal
from tests.harness.papers_field import suns

DROP, DROP_ONE = misfit_drop(0.90, 2), misfit_drop(0.90, 1)


def of_one(misfit: Misfit) -> ProfileMisfit:
    """The misfit of a single slope, noise alone, as that of many."""
    H, b, c = misfit.H[np.newaxis], misfit.b[np.newaxis], np.array([misfit.c])
    return ProfileMisfit.of(Misfit(H, b, c, np.array([misfit.count])), VERTICAL, 0.0)


def region(misfit: Misfit, best: np.ndarray, drop: float, limit_deg: float) -> LikelihoodRegion:
    return regions(of_one(misfit), misfit.H[np.newaxis], best[np.newaxis], drop, limit_deg)[0]


def region_known_azimuth(
    misfit: Misfit, azimuth_deg: float, best: np.ndarray, drop: float, limit_deg: float
) -> LikelihoodRegion:
    azimuths = np.array([azimuth_deg])
    return regions_known_azimuth(of_one(misfit), azimuths, best[np.newaxis], drop, limit_deg)[0]


def test_region_of_a_long_window_is_the_cramer_rao_ellipse():
    sun, truth = suns("2017-08-30T00:00", 181), normal(10.0, 180.0)
    misfit = Misfit.of_rows(sun, sun @ truth, 1 / 0.005**2)
    found = region(misfit, truth, DROP, 45.0)
    covariance = cramer_rao(misfit.H, truth)
    tilt = np.degrees(np.sqrt(DROP * covariance[0, 0]))
    azimuth = np.degrees(np.sqrt(DROP * covariance[1, 1])) / np.sin(np.radians(10.0))
    assert 10.0 - found.tilt_low_deg == pytest.approx(tilt, rel=0.08)
    assert found.tilt_high_deg - 10.0 == pytest.approx(tilt, rel=0.08)
    assert found.azimuth_high_deg - 180.0 == pytest.approx(azimuth, rel=0.08)


@pytest.mark.parametrize("azimuth", [0.2, 359.8])
def test_region_across_north_is_unwrapped(azimuth):
    sun, truth = suns("2017-08-30T03:00", 61), normal(15.0, azimuth)
    misfit = Misfit.of_rows(sun, sun @ truth, 1 / 0.005**2)
    found = region(misfit, truth, DROP, 45.0)
    assert found.azimuth_low_deg < azimuth < found.azimuth_high_deg
    assert found.azimuth_high_deg - found.azimuth_low_deg < 30.0


def test_every_normal_outside_the_projections_is_outside_the_region():
    sun, truth = suns("2017-08-30T03:00", 21), normal(9.3, 77.0)
    misfit = Misfit.of_rows(sun, sun @ truth, 1 / 0.006**2)
    found = region(misfit, truth, DROP, 45.0)
    tilts, azimuths = np.meshgrid(np.linspace(0, 45, 900), np.linspace(-100, 250, 1400))
    inside = misfit(normal(tilts, azimuths)) <= DROP
    # the strip is thinner than this raster, so the raster can only find less
    assert tilts[inside].min() >= found.tilt_low_deg - 0.2
    assert tilts[inside].max() <= found.tilt_high_deg + 0.2
    assert tilts[inside].max() == pytest.approx(found.tilt_high_deg, abs=0.6)


def test_patch_mass_is_the_gaussian_integral():
    sun, truth = suns("2017-08-30T00:00", 181), normal(12.0, 135.0)
    misfit = Misfit.of_rows(sun, sun @ truth, 1 / 0.005**2)
    one, at = of_one(misfit), truth[np.newaxis]
    found = patches(one.on_grid, misfit.H[np.newaxis], at, one(at) + 18.0, 18.0, heights=41, turns=121)
    mass = np.exp(-0.5 * found.misfit[0]).sum() * found.solid_angle[0]
    expected = 2.0 * np.pi * np.sqrt(np.linalg.det(cramer_rao(misfit.H, truth)))
    assert mass == pytest.approx(expected, rel=0.02)


def test_misfits_of_a_grid_are_those_of_its_normals():
    random = np.random.default_rng(8)
    sun, truths = suns("2017-08-30T03:00", 61), normal([8.0, 21.0], [90.0, 200.0])
    effects = random.uniform(-0.01, 0.01, (3, 2, 61))
    summed = with_systematics(sun, truths @ sun.T, random.uniform(1e4, 4e4, (2, 61)), effects)
    axes = np.linalg.qr(random.standard_normal((2, 3, 3)))[0]
    grid = Grid(axes, random.uniform(-1.0, 1.0, (2, 5)), random.uniform(-np.pi, np.pi, (2, 7)))
    for scale_sd in (0.0, 0.1):
        profiled = ProfileMisfit.of(summed, normal(3.0, 40.0), scale_sd)
        expected = [[profiled(grid.normals()[:, k, i]) for i in range(7)] for k in range(5)]
        np.testing.assert_allclose(profiled.on_grid(grid), np.moveaxis(expected, 2, 0), rtol=1e-9)


@pytest.mark.parametrize("scale_sd", [0.0, 0.1])
def test_uncertain_light_equals_fitting_it_with_its_price(scale_sd):
    """Against numpy's least squares with a row for each prior, at slopes anywhere and on a grid."""
    random = np.random.default_rng(5)
    rays, truth, reference = suns("2017-08-30T03:00", 50), normal(14.0, 70.0), normal(2.0, 10.0)
    weights, own = random.uniform(1e3, 4e3, 50), random.uniform(-0.02, 0.02, (2, 50))
    light = random.uniform(-0.1, 0.1, (3, 4, 50))
    y = rays @ truth + 0.02 * random.standard_normal(50)
    gram = profiled_gram([*rays.T, y, *light.reshape(-1, 50)], weights, own)
    found = ProfileMisfit(gram, reference, scale_sd)
    for candidate in (truth, normal(35.0, 200.0), reference):
        away = np.append(candidate - reference, 1.0)
        effects = [scale_sd * rays @ away[:3], *(away @ one for one in light), *own]
        left = np.append((y - rays @ candidate) * np.sqrt(weights), np.zeros(len(effects)))
        table = np.vstack([np.sqrt(weights)[:, np.newaxis] * np.transpose(effects), np.eye(len(effects))])
        fit = np.linalg.lstsq(table, left)[0]
        assert float(found(candidate)) == pytest.approx(np.sum((left - table @ fit) ** 2), rel=1e-8)
    grid = Grid(np.eye(3)[np.newaxis], np.array([[0.9]]), np.array([[0.4]]))
    many = ProfileMisfit(gram[np.newaxis], reference, scale_sd)
    assert many.on_grid(grid).item() == pytest.approx(found(grid.normals()[0, 0, 0]), rel=1e-8)


@pytest.mark.parametrize("sd", [0.0004, 0.002, 0.01])
@pytest.mark.parametrize("tilt", [14.9916, 22.5])
def test_known_azimuth_region_has_the_width_the_noise_gives_it(sd, tilt):
    """Also where that is less than a step between the tilts tried."""
    sun, truth = suns("2017-12-11T01:30", 180), normal(tilt, 180.0)
    misfit = Misfit.of_rows(sun, sun @ truth, 1 / sd**2)
    found = region_known_azimuth(misfit, 180.0, truth, DROP_ONE, 45.0)
    steeper = normal(tilt + 90.0, 180.0)
    half = np.degrees(np.sqrt(DROP_ONE / (steeper @ misfit.H @ steeper)))
    assert (found.azimuth_low_deg, found.azimuth_high_deg) == (180.0, 180.0)
    assert tilt - found.tilt_low_deg == pytest.approx(half, rel=0.01)
    assert found.tilt_high_deg - tilt == pytest.approx(half, rel=0.01)


def test_known_azimuth_region_ends_at_flat_and_at_the_limit():
    sun = suns("2017-12-11T01:30", 180)
    flat, steep = (
        region_known_azimuth(
            Misfit.of_rows(sun, sun @ normal(tilt, 180.0), 1e4), 180.0, normal(tilt, 180.0), 2.706, 45.0
        )
        for tilt in (0.01, 44.99)
    )
    assert (flat.tilt_low_deg, flat.vertical) == (0.0, True)
    assert (steep.tilt_high_deg, steep.vertical) == (45.0, False)


@pytest.mark.slow
@pytest.mark.parametrize("minutes", [21, 61])
@pytest.mark.parametrize("start", ["2017-08-30T00:00", "2017-08-30T03:00", "2017-08-30T06:00"])
def test_likelihood_region_holds_the_truth_nine_times_in_ten(start, minutes):
    sun, random = suns(start, minutes), np.random.default_rng(7)
    truths = normal(random.uniform(0, 30, 6000), random.uniform(0, 360, 6000))
    y = truths @ sun.T + 0.0055 * random.standard_normal((6000, minutes))
    misfit = Misfit.of_rows(sun, y, 1 / 0.0055**2)
    choice = choose(misfit, solve(misfit), 45.0)
    least = np.fmin(choice.misfit, choice.other_misfit)
    assert np.mean(misfit(truths) - least <= DROP) == pytest.approx(0.90, abs=0.03)


def test_a_doubtful_scale_is_a_gaussian_of_its_standard_deviation():
    """The least of misfit + ((kappa - 1) / sd)² over kappa, tried out one by one."""
    sun, truth = suns("2017-08-30T03:00", 21), normal(15.0, 100.0)
    misfit = Misfit.of_rows(sun, 1.05 * (sun @ (truth - VERTICAL)) + sun[:, 2], 1 / 0.01**2)
    kappas = np.linspace(-1.0, 3.0, 400_001)
    for tilt, azimuth in ((15.0, 100.0), (20.0, 90.0), (8.0, 130.0)):
        bed = normal(tilt, azimuth)
        tried = misfit(VERTICAL + kappas[:, np.newaxis] * (bed - VERTICAL)) + ((kappas - 1.0) / 0.08) ** 2
        found = ProfileMisfit.of(misfit, VERTICAL, 0.08)(bed[np.newaxis])
        assert float(found[0]) == pytest.approx(float(tried.min()), rel=1e-6)


def test_a_doubt_of_one_standard_deviation_costs_one():
    """Rows that are off by just one standard deviation of a known effect: its square is what is left."""
    sun, truth = suns("2017-08-30T03:00", 60), normal(12.0, 200.0)
    effect = 0.02 * np.sin(np.linspace(0.0, 25.0, 60))
    summed = with_systematics(sun, sun @ truth + effect, np.full(60, 1e8), effect[np.newaxis])
    assert float(summed(truth)) == pytest.approx(1.0, rel=1e-3)
