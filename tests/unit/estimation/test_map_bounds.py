"""How sure a pixel of a slope map is, against the regions' own likelihood and against many draws of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.likelihood import NINETY_PERCENT, region
from fieldkit.estimation.normal import Misfit
from fieldkit.estimation.pixel_slopes import MapSums, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Site
from fieldkit.model.slope import SlopeState
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_per_kelvin, surface_temperature
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.sun import sun_vectors

SITE = Site(35.558675, 139.395232, 9.0)
PAPER = SurfaceParameters()
NOISE_K = 0.05
NOISE_ALONE = EstimatorSettings(scale_sd=0.0, offset_sd_k=0.0, drift_sd_k_per_h=0.0)
MORNING = int(np.datetime64("2017-08-30T00:30", "ns").astype(np.int64))


@pytest.fixture(autouse=True)
def _the_papers_model_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene of these tests is made by the paper's model: nothing is missing from it."""
    monkeypatch.setattr("fieldkit.estimation.pixel_slopes.PAPER_SCALE_SD", 0.0)


def suns(minutes: int):
    return sun_vectors(MORNING + np.arange(minutes) * 60_000_000_000, SITE)


def temperatures(normals, ray):
    return surface_temperature(800.0 * np.maximum(normals @ ray, 0.0), 400.0, 303.15, PAPER)


def summed(normals, sun, seed: int = 1) -> MapSums:
    """Frames of facets (rows, cols, 3), noisy to the stated noise of a difference."""
    random = np.random.default_rng(seed)
    sums = MapSums(normals.shape[:2], PAPER, NOISE_K)
    for ray in sun:
        noise = np.sqrt(2.0) * NOISE_K * random.standard_normal(normals.shape[:2])
        sums.add(temperatures(normals, ray) + noise, float(temperatures(VERTICAL, ray)), ray, 800.0, VERTICAL)
    return sums


@pytest.mark.parametrize("minutes", [25, 90, 240])
@pytest.mark.parametrize(("tilt", "azimuth"), [(4.0, 180.0), (12.0, 120.0), (20.0, 90.0)])
def test_nine_of_ten_pixels_hold_their_true_slope(minutes: int, tilt: float, azimuth: float) -> None:
    sums = summed(np.broadcast_to(normal(tilt, azimuth), (40, 50, 3)), suns(minutes))
    slopes, bounds = with_bounds(sums.solve(), sums, VERTICAL, NOISE_ALONE)
    known = np.isfinite(slopes.tilt_deg)
    holds = (bounds.tilt_low_deg[known] <= tilt) & (tilt <= bounds.tilt_high_deg[known])
    assert known.mean() > 0.95  # noise shows a few as what no slope explains
    assert holds.mean() >= 0.90  # a projection of a 90 % region of two angles holds one of them more often
    # and is no wider than it need be: 2.15 standard deviations, where the branches are apart
    half = np.median((bounds.tilt_high_deg - bounds.tilt_low_deg)[known]) / 2.0
    if (slopes.state[known] == SlopeState.OK).all():
        assert half < 1.3 * 2.15 * slopes.tilt_deg[known].std()


@pytest.mark.parametrize(("tilt", "azimuth"), [(8.0, 150.0), (15.0, 180.0), (20.0, 100.0)])
def test_bounds_are_those_of_a_region_with_the_same_misfit(tilt: float, azimuth: float) -> None:
    sun = suns(60)
    sums = summed(np.broadcast_to(normal(tilt, azimuth), (1, 1, 3)), sun, seed=4)
    slopes, bounds = with_bounds(sums.solve(), sums, VERTICAL, NOISE_ALONE)
    best = normal(float(slopes.tilt_deg[0, 0]), float(slopes.azimuth_deg[0, 0]))
    flat = [float(temperatures(VERTICAL, ray)) for ray in sun]
    weights = np.array(
        [(800.0 / (np.sqrt(2) * irradiance_per_kelvin(one, PAPER) * NOISE_K)) ** 2 for one in flat]
    )
    misfit = Misfit.of_rows(sun * np.sqrt(weights)[:, np.newaxis], sun @ best * np.sqrt(weights))
    exact = region(misfit, misfit.H, best, NINETY_PERCENT * max(1.0, float(slopes.chi_square[0, 0])), 45.0)
    found = [float(one[0, 0]) for one in (bounds.tilt_low_deg, bounds.tilt_high_deg)]
    width = exact.tilt_high_deg - exact.tilt_low_deg
    assert found == pytest.approx([exact.tilt_low_deg, exact.tilt_high_deg], abs=0.15 * width + 0.02)
    azimuths = [float(one[0, 0]) for one in (bounds.azimuth_low_deg, bounds.azimuth_high_deg)]
    around = exact.azimuth_high_deg - exact.azimuth_low_deg
    assert azimuths == pytest.approx([exact.azimuth_low_deg, exact.azimuth_high_deg], abs=0.15 * around + 0.1)


def test_flat_pixels_are_flat_and_face_nowhere() -> None:
    sums = summed(np.broadcast_to(VERTICAL, (20, 30, 3)), suns(90))
    slopes, bounds = with_bounds(sums.solve(), sums, VERTICAL, NOISE_ALONE)
    assert (slopes.state == SlopeState.FLAT).mean() > 0.85
    assert (slopes.state == SlopeState.OK).mean() < 0.15
    is_flat = slopes.state == SlopeState.FLAT
    assert (bounds.tilt_low_deg[is_flat] == 0.0).all()
    width = bounds.azimuth_high_deg[is_flat] - bounds.azimuth_low_deg[is_flat]
    assert width == pytest.approx(np.full(width.size, 360.0), abs=1e-3)


def test_a_wide_region_is_uncertain_and_systematics_widen_it() -> None:
    sums = summed(np.broadcast_to(normal(15.0, 90.0), (10, 10, 3)), suns(180))
    settings = (
        NOISE_ALONE,
        replace(NOISE_ALONE, scale_sd=0.2),
        replace(NOISE_ALONE, offset_sd_k=0.5),
        replace(NOISE_ALONE, drift_sd_k_per_h=0.5),
    )
    found = [with_bounds(sums.solve(), sums, VERTICAL, one) for one in settings]
    widths = [float(np.median(bounds.tilt_high_deg - bounds.tilt_low_deg)) for _, bounds in found]
    assert (found[0][0].state == SlopeState.OK).all()
    assert all(width > 1.2 * widths[0] for width in widths[1:])
    # a scale known to a fifth moves a tilt of 15 degrees by three, 2.15 of them either way
    assert widths[1] == pytest.approx(2 * 2.15 * 3.0, rel=0.25)
    assert (found[1][0].state == SlopeState.UNCERTAIN).all()


def test_pixels_without_a_slope_have_no_bounds() -> None:
    sun = suns(30)
    sums = MapSums((4, 5), PAPER, NOISE_K)
    for ray in sun:
        frame_k = np.broadcast_to(temperatures(normal(10.0, 150.0), ray), (4, 5)).copy()
        frame_k[:2] = np.nan
        sums.add(frame_k, float(temperatures(VERTICAL, ray)), ray, 800.0, VERTICAL)
    slopes, bounds = with_bounds(sums.solve(), sums, VERTICAL, NOISE_ALONE)
    for plane in (bounds.tilt_low_deg, bounds.tilt_high_deg, bounds.azimuth_low_deg, bounds.azimuth_high_deg):
        assert np.isnan(plane[:2]).all()
        assert np.isfinite(plane[2:]).all()
    assert (slopes.state[:2] == SlopeState.NO_DATA).all()
    assert (bounds.tilt_low_deg[2:] <= slopes.tilt_deg[2:]).all()
    assert (bounds.tilt_high_deg[2:] >= slopes.tilt_deg[2:]).all()
