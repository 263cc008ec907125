from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.likelihood import ProfileMisfit, regions
from fieldkit.estimation.normal import Misfit, choose, solve
from fieldkit.estimation.pixel_slopes import MapSums, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.confidence import misfit_drop
from fieldkit.model.slope import SlopeState
from fieldkit.physics.energy_balance import irradiance_difference, irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, angle_between_deg, normal
from tests.harness.papers_field import SURFACE as PAPER
from tests.harness.papers_field import suns
from tests.harness.papers_field import temperatures_k as temperatures
from tests.harness.pixels import sums_of_slopes

SHAPE = (20, 30)
NOISE_ALONE = EstimatorSettings(model="paper", scale_sd=0.0, offset_sd_k=0.0, drift_sd_k_per_h=0.0)


@pytest.fixture
def scene():
    random = np.random.default_rng(1)
    return suns("2017-08-30T00:30", 60, 3), normal(
        random.uniform(0, 28, SHAPE), random.uniform(0, 360, SHAPE)
    )


def summed(sun, normals, noise_k=0.0, stated_k=0.05, error_k=0.0, seed=2) -> MapSums:
    """Frames of facets (rows, cols, 3), with noise and an error of their own."""
    noise = np.random.default_rng(seed).standard_normal((len(sun), *normals.shape[:2]))
    return sums_of_slopes(normals, sun, stated_k, noise_k * noise + error_k)


def mapped(sun, normals, noise_k=0.0, error_k=0.0, settings=NOISE_ALONE):
    return summed(sun, normals, noise_k, error_k=error_k).solve(settings)


def test_more_pixels_have_a_second_slope_the_more_confidence_is_asked_for(scene):
    sun, normals = scene
    sums = summed(sun, normals, stated_k=0.003)
    maps = (sums.solve(replace(NOISE_ALONE, confidence=one)) for one in (0.5, 0.9, 0.99))
    counts = [np.count_nonzero(found.state == SlopeState.NOT_RESOLVED) for found in maps]
    assert counts[0] < counts[1] < counts[2]


def bounded(sums, settings):
    slopes = sums.solve(settings)
    return with_bounds(slopes, posterior(slopes, sums, VERTICAL, settings), settings)


def test_every_pixel_gets_its_slope_or_says_that_two_fit(scene):
    sun, truth = scene
    found = mapped(sun, truth)
    error = angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), truth)
    sure = found.state == SlopeState.OK
    assert sure.mean() > 0.7
    assert error[sure].max() < 0.05
    unresolved = found.state == SlopeState.NOT_RESOLVED
    assert np.isfinite(found.second_tilt_deg[unresolved]).all()
    assert np.isnan(found.second_tilt_deg[sure]).all()


def test_map_agrees_with_the_regions_least_squares(scene):
    sun, truth = scene
    found = mapped(sun, truth, noise_k=0.02)
    random = np.random.default_rng(2)
    frames_k = [temperatures(truth, ray) + 0.02 * random.standard_normal(SHAPE) for ray in sun]
    flat = [float(temperatures(VERTICAL, ray)) for ray in sun]
    for pixel in ((3, 4), (11, 22), (19, 29)):
        y = [irradiance_difference(p[pixel], f, PAPER) / 800.0 for p, f in zip(frames_k, flat, strict=True)]
        misfit = Misfit.of_rows(sun, np.array(y) + sun[:, 2])
        best = choose(misfit, solve(misfit), 45.0).best
        assert angle_between_deg(normal(found.tilt_deg[pixel], found.azimuth_deg[pixel]), best) < 0.1


def test_gusts_widen_the_pixels_of_a_region_that_has_a_slope_and_refuse_others():
    """Exchange that changes by a tenth from minute to minute: more than noise, the more the warmer."""
    sun, truth = suns("2017-08-30T01:30", 90), normal(25.0, 180.0)
    random, warmer_k = np.random.default_rng(4), temperatures(truth, sun) - temperatures(VERTICAL, sun)
    gusts_k = 0.1 * random.standard_normal(len(sun)) * warmer_k
    errors_k = gusts_k[:, np.newaxis, np.newaxis] + 0.05 * random.standard_normal((len(sun), *SHAPE))
    sums = sums_of_slopes(truth, sun, 0.05, errors_k)
    explained = np.zeros(SHAPE, np.bool_)
    explained[:10] = True
    slopes = sums.solve(NOISE_ALONE, explained)
    assert (slopes.state[10:] == SlopeState.NO_INTERSECTION).all()
    assert (slopes.state[:10] != SlopeState.NO_INTERSECTION).all()
    likelihood = posterior(slopes, sums, VERTICAL, EstimatorSettings(surface=PAPER))
    _, bounds = with_bounds(slopes, likelihood, EstimatorSettings(surface=PAPER))
    inside = (bounds.tilt_low_deg[:10] < 25.0) & (bounds.tilt_high_deg[:10] > 25.0)
    assert inside.all()


def test_a_hot_stone_is_no_slope(scene):
    assert (mapped(*scene, error_k=15.0).state == SlopeState.NO_INTERSECTION).mean() > 0.9


@pytest.mark.parametrize("hour_utc", [0, 3, 6])
def test_winter_sun_lights_what_faces_it_and_shades_the_steep_north_side(hour_utc):
    sun = suns(f"2017-12-11T{hour_utc:02d}:30", 20)
    away = np.degrees(np.arctan2(*-sun[10, :2]))
    truth = np.broadcast_to(normal(10.0, away + 180.0), (*SHAPE, 3)).copy()
    truth[:5] = normal(80.0, away)
    found = mapped(sun, truth)
    assert (found.state[5:] != SlopeState.SHADED).all()
    assert (found.state[:5] == SlopeState.SHADED).all()


@pytest.mark.parametrize(("start", "minutes"), [("01:30", 180), ("00:00", 360)])
def test_hours_tell_a_steep_slope_from_its_flat_mirror(start, minutes):
    sun = suns(f"2017-08-30T{start}", minutes)
    steep = np.broadcast_to(normal(40.0, 180.0), (*SHAPE, 3)).copy()
    steep[10:] = normal(12.0, 180.0)
    found = mapped(sun, steep, noise_k=0.05)
    assert (found.state == SlopeState.OK).all()
    assert angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), steep).max() < 0.5
    assert np.isnan(found.second_tilt_deg).all()
    assert found.chi_square.mean() == pytest.approx(0.5, abs=0.05)


def test_hours_rule_out_a_slope_steeper_than_the_limit_whose_mirror_is_flat():
    sun = suns("2017-08-30T01:30", 180)
    found = mapped(sun, np.broadcast_to(normal(48.0, 180.0), (*SHAPE, 3)), noise_k=0.05)
    assert (found.state == SlopeState.NO_INTERSECTION).all()


def test_two_slopes_that_fit_alike_are_told_the_flatter_first():
    sun = suns("2017-08-30T03:00", 20)
    found = mapped(sun, np.broadcast_to(normal(35.0, 180.0), (*SHAPE, 3)))
    assert (found.state == SlopeState.NOT_RESOLVED).all()
    assert (found.tilt_deg < found.second_tilt_deg).all()
    assert found.second_tilt_deg == pytest.approx(35.0, abs=0.1)


def test_two_frames_are_too_few(scene):
    sun, truth = scene
    assert (mapped(sun[:2], truth).state == SlopeState.TOO_FEW).all()


# --- uncertainty of a pixel, against the likelihood of a region and against many draws of noise

NOISE_K = 0.05
MORNING = "2017-08-30T00:30"


@pytest.fixture(autouse=True)
def _the_papers_model_is_whole(monkeypatch):
    """The scene of these tests is made by the paper's model: nothing is missing, which no setting can say."""
    monkeypatch.setattr("fieldkit.estimation.pixel_slopes.PAPER_SCALE_SD", 0.0)


def noisy(shape, slope, sun, seed: int = 1) -> MapSums:
    """Frames of one slope, noisy to the stated noise of a difference."""
    facets = np.broadcast_to(normal(*slope), (*shape, 3))
    return summed(sun, facets, np.sqrt(2.0) * NOISE_K, NOISE_K, seed=seed)


@pytest.mark.parametrize("minutes", [25, 90, 240])
@pytest.mark.parametrize(("tilt", "azimuth"), [(4.0, 180.0), (12.0, 120.0), (20.0, 90.0)])
def test_nine_of_ten_pixels_hold_their_true_slope(minutes, tilt, azimuth):
    sums = noisy((40, 50), (tilt, azimuth), suns(MORNING, minutes))
    slopes, bounds = bounded(sums, NOISE_ALONE)
    known = np.isfinite(slopes.tilt_deg)
    holds = (bounds.tilt_low_deg[known] <= tilt) & (tilt <= bounds.tilt_high_deg[known])
    assert known.mean() > 0.95  # noise shows a few as what no slope explains
    assert holds.mean() >= 0.90  # a projection of a 90 % region of two angles holds one of them more often
    # and is no wider than it need be: 2.15 standard deviations, where the branches are apart
    half = np.median((bounds.tilt_high_deg - bounds.tilt_low_deg)[known]) / 2.0
    if (slopes.state[known] == SlopeState.OK).all():
        assert half < 1.3 * 2.15 * slopes.tilt_deg[known].std()


@pytest.mark.parametrize(("tilt", "azimuth"), [(8.0, 150.0), (15.0, 180.0), (20.0, 100.0)])
def test_bounds_are_those_of_a_region_with_the_same_misfit(tilt, azimuth):
    sun = suns(MORNING, 60)
    sums = noisy((1, 1), (tilt, azimuth), sun, seed=4)
    slopes, bounds = bounded(sums, NOISE_ALONE)
    best = normal(float(slopes.tilt_deg[0, 0]), float(slopes.azimuth_deg[0, 0]))
    flat = [float(temperatures(VERTICAL, ray)) for ray in sun]
    weights = np.array(
        [(800.0 / (np.sqrt(2) * irradiance_per_kelvin(one, PAPER) * NOISE_K)) ** 2 for one in flat]
    )
    misfit = Misfit.of_rows(sun, (sun @ best)[np.newaxis], weights[np.newaxis])
    drop = misfit_drop(0.90, 2) * max(1.0, float(slopes.chi_square[0, 0]))
    (exact,) = regions(ProfileMisfit.of(misfit, VERTICAL, 0.0), misfit.H, best[np.newaxis], drop, 45.0)
    found = [float(one[0, 0]) for one in (bounds.tilt_low_deg, bounds.tilt_high_deg)]
    width = exact.tilt_high_deg - exact.tilt_low_deg
    assert found == pytest.approx([exact.tilt_low_deg, exact.tilt_high_deg], abs=0.15 * width + 0.02)
    azimuths = [float(one[0, 0]) for one in (bounds.azimuth_low_deg, bounds.azimuth_high_deg)]
    around = exact.azimuth_high_deg - exact.azimuth_low_deg
    assert azimuths == pytest.approx([exact.azimuth_low_deg, exact.azimuth_high_deg], abs=0.15 * around + 0.1)


def test_flat_pixels_are_flat_and_face_nowhere():
    sums = noisy((20, 30), (0.0, 0.0), suns(MORNING, 90))
    slopes, bounds = bounded(sums, NOISE_ALONE)
    assert (slopes.state == SlopeState.FLAT).mean() > 0.85
    assert (slopes.state == SlopeState.OK).mean() < 0.15
    is_flat = slopes.state == SlopeState.FLAT
    assert (bounds.tilt_low_deg[is_flat] == 0.0).all()
    width = bounds.azimuth_high_deg[is_flat] - bounds.azimuth_low_deg[is_flat]
    assert width == pytest.approx(np.full(width.size, 360.0), abs=1e-3)


def test_a_wide_region_is_uncertain_and_systematics_widen_it():
    sums = noisy((10, 10), (15.0, 90.0), suns(MORNING, 180))
    uncertain = ({}, {"scale_sd": 0.2}, {"offset_sd_k": 0.5}, {"drift_sd_k_per_h": 0.5})
    found = [bounded(sums, replace(NOISE_ALONE, **more)) for more in uncertain]
    widths = [float(np.median(bounds.tilt_high_deg - bounds.tilt_low_deg)) for _, bounds in found]
    assert (found[0][0].state == SlopeState.OK).all()
    assert all(width > 1.2 * widths[0] for width in widths[1:])
    # a scale known to a fifth moves a tilt of 15 degrees by three, 2.15 of them either way
    assert widths[1] == pytest.approx(2 * 2.15 * 3.0, rel=0.25)
    assert (found[1][0].state == SlopeState.WIDE).all()


def test_pixels_without_a_slope_have_no_bounds():
    error_k = np.array([[np.nan], [np.nan], [0.0], [0.0]])
    facets = np.broadcast_to(normal(10.0, 150.0), (4, 5, 3))
    slopes, bounds = bounded(summed(suns(MORNING, 30), facets, error_k=error_k), NOISE_ALONE)
    for plane in (bounds.tilt_low_deg, bounds.tilt_high_deg, bounds.azimuth_low_deg, bounds.azimuth_high_deg):
        assert np.isnan(plane[:2]).all()
        assert np.isfinite(plane[2:]).all()
    assert (slopes.state[:2] == SlopeState.NO_DATA).all()
    assert (bounds.tilt_low_deg[2:] <= slopes.tilt_deg[2:]).all()
    assert (bounds.tilt_high_deg[2:] >= slopes.tilt_deg[2:]).all()
