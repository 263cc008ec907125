import numpy as np
import pytest

from fieldkit.model.site import Region, RegionKind
from fieldkit.simulation import Correction, sand_slopes
from fieldkit.simulation.facets import FRAME_SHAPE, pixel_shares

NETD_K = 0.050  # the maker's figure for the Lepton 3.5: below 50 mK


@pytest.fixture(scope="module")
def scene():
    return sand_slopes(duration_s=600.0)


def test_each_pixel_is_shared_out_completely(scene):
    shares = pixel_shares(scene.facets)
    assert shares.shape == (len(scene.facets) + 1, 120 * 160)
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, atol=1e-6)
    assert (shares >= 0).all()


def test_regions_see_nothing_but_their_bed(scene):
    shares = pixel_shares(scene.facets).reshape(-1, *FRAME_SHAPE)
    for share, region in zip(shares, scene.regions, strict=False):
        assert share[region.mask(FRAME_SHAPE)].min() > 0.999


def test_edges_of_beds_are_as_soft_as_a_lens_makes_them(scene):
    share = pixel_shares(scene.facets)[0]
    assert ((share > 0.05) & (share < 0.95)).sum() > 100


def test_noise_between_pictures_is_that_of_the_sensor(scene):
    first, second = scene.frame(scene.start_ns, 0), scene.frame(scene.start_ns, 1)
    noise_k = (second - first).std() / np.sqrt(2)
    assert 0.6 * NETD_K < noise_k < NETD_K


def test_picture_is_the_beds_plus_errors_of_a_tenth_of_a_kelvin(scene):
    frame = scene.frame(scene.start_ns, 0)
    assert frame.shape == FRAME_SHAPE
    assert frame.dtype == np.float32
    for facet, truth_k in zip(scene.facets, scene.at(scene.start_ns).brightness_k, strict=False):
        mask = Region(facet.name, RegionKind.TARGET, facet.region().points_px).mask(FRAME_SHAPE)
        assert frame[mask].mean() == pytest.approx(truth_k, abs=0.35)


def test_level_drifts_after_a_correction_and_alike_everywhere(scene):
    ended = scene.start_ns
    fresh = scene.frame(scene.start_ns, 5, Correction(3, ended))
    aged = scene.frame(scene.start_ns, 5, Correction(3, ended - 180_000_000_000))
    change = aged - fresh
    assert 0.005 < np.abs(change.mean()) < 0.5
    assert np.ptp(change) < 1e-3


def test_each_correction_leaves_another_level_and_pattern(scene):
    pictures = [scene.frame(scene.start_ns, 5, Correction(n, scene.start_ns)) for n in range(8)]
    levels = np.array([frame.mean() for frame in pictures])
    assert 0.02 < levels.std() < 0.3
    patterns = np.array([frame - frame.mean() for frame in pictures])
    assert patterns.std(axis=0).mean() == pytest.approx(0.04, rel=0.15)
    wrong = scene.frame(scene.start_ns, 5, Correction(0, scene.start_ns, 0.8))
    assert (wrong - pictures[0]).mean() == pytest.approx(0.8, abs=1e-4)
