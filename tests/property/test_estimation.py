"""What holds for every slope, sun and order of minutes."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from fieldkit.estimation.bins import RegionPixels
from fieldkit.estimation.likelihood import ProfileMisfit, with_systematics
from fieldkit.estimation.normal import Misfit, choose, mirror, solve
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.physics.facet import VERTICAL, angle_between_deg, normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors

tilts = st.floats(0.0, 30.0)
azimuths = st.floats(0.0, 359.99)
days = st.integers(0, 364)
latitudes = st.sampled_from([-45.0, -20.0, 0.0, 15.0, 35.5, 52.0])
seeds = st.integers(0, 2**32 - 1)
SIGMA = 0.0055


def sun_of(latitude: float, day: int, minutes: int = 61) -> np.ndarray:
    noon = int(np.datetime64("2017-01-01T10:30", "ns").astype(np.int64)) + day * 86_400 * 10**9
    return sun_vectors(noon + np.arange(minutes) * 60_000_000_000, Site(latitude, 0.0))


def noisy(sun: np.ndarray, truth: np.ndarray, seed: int) -> np.ndarray:
    return sun @ truth + SIGMA * np.random.default_rng(seed).standard_normal(len(sun))


ROUNDING_DEG = 1e-4
"""On the equator around the equinoxes the suns lie almost in a plane, which amplifies rounding."""


def best_of(sun: np.ndarray, y: np.ndarray) -> np.ndarray:
    misfit = Misfit.of_rows(sun, y, 1 / SIGMA**2)
    return choose(misfit, solve(misfit), 45.0).best


@given(latitudes, days, tilts, azimuths)
def test_without_noise_one_branch_is_the_truth(latitude, day, tilt, azimuth):
    sun, truth = sun_of(latitude, day), normal(tilt, azimuth)
    both = solve(Misfit.of_rows(sun, sun @ truth, 1 / SIGMA**2))
    nearest = min(angle_between_deg(both.first, truth), angle_between_deg(both.second, truth))
    assert nearest < 0.01


@given(latitudes, days, tilts, azimuths, seeds, st.floats(0.0, 360.0))
def test_turning_the_compass_turns_the_answer(latitude, day, tilt, azimuth, seed, turn):
    sun = sun_of(latitude, day)
    y = noisy(sun, normal(tilt, azimuth), seed)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turning = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    # on the limit the answer is one of a grid of azimuths, which does not turn with it
    found = best_of(sun, y)
    assume(tilt_azimuth(found)[0] < 44.9)
    assert angle_between_deg(best_of(sun @ turning.T, y), turning @ found) < ROUNDING_DEG


@given(latitudes, days, tilts, azimuths, seeds)
def test_order_of_minutes_does_not_matter(latitude, day, tilt, azimuth, seed):
    sun = sun_of(latitude, day)
    y = noisy(sun, normal(tilt, azimuth), seed)
    order = np.random.default_rng(seed).permutation(len(y))
    assert angle_between_deg(best_of(sun[order], y[order]), best_of(sun, y)) < ROUNDING_DEG


@given(latitudes, days, tilts, azimuths)
def test_mirror_of_the_mirror_is_the_original(latitude, day, tilt, azimuth):
    sun, truth = sun_of(latitude, day), normal(tilt, azimuth)
    H = sun.T @ sun
    assert angle_between_deg(mirror(mirror(truth, H), H), truth) < 1e-6
    # what the mirror costs is only what the sun showed of the missing direction
    least = float(np.linalg.eigvalsh(H)[0])
    assert Misfit.of_rows(sun, sun @ truth)(mirror(truth, H)) <= 4.0 * least + 1e-9


@given(latitudes, days, tilts, azimuths, st.floats(0.8, 1.25))
def test_three_vector_solution_of_a_wrong_scale_is_a_blend_with_the_vertical(
    latitude, day, tilt, azimuth, kappa
):
    sun, truth = sun_of(latitude, day, 361), normal(tilt, azimuth)
    y = kappa * (sun @ (truth - VERTICAL)) + sun[:, 2]
    expected = kappa * truth + (1.0 - kappa) * VERTICAL
    # misfit zero at a vector means the least-squares vector is that one, however ill-conditioned H
    misfit = Misfit.of_rows(sun, y)
    assert abs(float(misfit(expected))) < 1e-9
    left = misfit.H @ expected - misfit.b
    assert np.abs(left).max() < 1e-9


@given(latitudes, days, tilts, azimuths, seeds)
def test_doubts_never_raise_the_misfit(latitude, day, tilt, azimuth, seed):
    sun, random = sun_of(latitude, day), np.random.default_rng(seed)
    y, weights = noisy(sun, normal(tilt, azimuth), seed), np.full(len(sun), 1 / SIGMA**2)
    plain = Misfit.of_rows(sun, y, weights)
    doubts = 0.01 * random.standard_normal((2, len(sun)))
    doubtful = ProfileMisfit.of(with_systematics(sun, y, weights, doubts), VERTICAL, 0.1)
    tried = normal(random.uniform(0, 45, 20), random.uniform(0, 360, 20))
    assert (doubtful(tried) <= plain(tried) * (1 + 1e-9) + 1e-6).all()


@given(st.integers(1, 12), st.integers(1, 12), seeds)
def test_region_sums_equal_those_of_the_mask(width, height, seed):
    counts = np.random.default_rng(seed).integers(0, 2**16, (15, 17), dtype=np.uint16)
    corners = ((1.0, 1.0), (1.0 + width, 1.0), (1.0 + width, 1.0 + height), (1.0, 1.0 + height))
    outside = ((-9.0, -9.0), (-8.0, -9.0), (-8.0, -8.0))
    regions = [Region("in", RegionKind.TARGET, corners), Region("out", RegionKind.TARGET, outside)]
    totals, squares, _ = RegionPixels(regions, counts.shape).sums(counts)
    inside = counts[regions[0].mask(counts.shape)].astype(object)
    assert totals == [int(inside.sum()), 0]
    assert squares == [int((inside**2).sum()), 0]
