"""Expected sizes of uncertainty are those of an independent simulation (20 min and 3 h, 0.1 K)."""

import numpy as np
import pytest

from fieldkit.estimation.scale import identify, offsets_from_uniform, scale_from_known_bed
from fieldkit.model.errors import CalibrationError
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, normal
from tests.harness.papers_field import SURFACE as PAPER
from tests.harness.papers_field import suns, temperatures_k

SIGMA = np.sqrt(2.0) * 31.0 * 0.1 / 800.0


def sun(minutes: int) -> np.ndarray:
    return suns("2017-08-30T03:00", minutes)


@pytest.mark.parametrize(("minutes", "sd"), [(21, 0.02), (181, 0.006)])
def test_one_known_bed_tells_the_scale(minutes, sd):
    rays, bed = sun(minutes), normal(17.0, 180.0)
    noise = SIGMA * np.random.default_rng(1).standard_normal(minutes)
    y = 1.13 * (rays @ (bed - VERTICAL)) + rays[:, 2] + noise
    found = scale_from_known_bed(rays, y, np.full(minutes, SIGMA), VERTICAL, bed)
    assert found.kappa_sd < sd
    assert found.kappa == pytest.approx(1.13, abs=3 * found.kappa_sd)


def test_stated_uncertainty_of_the_scale_is_its_scatter():
    rays, bed, random = sun(60), normal(17.0, 180.0), np.random.default_rng(2)
    clean = rays @ (bed - VERTICAL) + rays[:, 2]
    sigma = np.full(60, SIGMA)
    noisy = clean + SIGMA * random.standard_normal((300, 60))
    fits = [scale_from_known_bed(rays, measured, sigma, VERTICAL, bed) for measured in noisy]
    assert np.mean([fit.kappa for fit in fits]) == pytest.approx(1.0, abs=0.002)
    assert np.std([fit.kappa for fit in fits]) == pytest.approx(fits[0].kappa_sd, rel=0.25)


def test_offset_of_the_known_bed_is_told_from_scale_only_as_far_as_it_can_be():
    rays, bed = sun(181), normal(17.0, 180.0)
    offset = np.full((1, 181), 0.25 * 31.0 / 800.0)
    y = 1.1 * (rays @ (bed - VERTICAL)) + rays[:, 2] + offset[0]
    sigma = np.full(181, SIGMA)
    naive = scale_from_known_bed(rays, y, sigma, VERTICAL, bed)
    careful = scale_from_known_bed(rays, y, sigma, VERTICAL, bed, systematics=offset)
    assert abs(naive.kappa - 1.1) > 3 * naive.kappa_sd
    assert abs(careful.kappa - 1.1) < 2 * careful.kappa_sd
    assert careful.kappa_sd > 2 * naive.kappa_sd


@pytest.mark.parametrize(("bed", "reference"), [((25, 90), (0, 0)), ((10, 180), (25, 90))])
def test_minutes_in_own_shade_do_not_bend_the_scale(bed, reference):
    rays = sun(330)
    rays, bed, reference = rays[rays[:, 2] > 0.14], normal(*bed), normal(*reference)
    assert (np.minimum(rays @ bed, rays @ reference) < 0).sum() > 60
    warmer = np.maximum(rays @ bed, 0.0) - np.maximum(rays @ reference, 0.0)
    y = 1.1 * warmer + rays @ reference
    found = scale_from_known_bed(rays, y, np.full(len(rays), SIGMA), reference, bed)
    assert found.kappa == pytest.approx(1.1, rel=1e-6)


def test_a_nearly_flat_bed_cannot_tell_the_scale():
    rays, bed = sun(21), normal(0.2, 180.0)
    with pytest.raises(CalibrationError, match="10 to 25 degrees"):
        scale_from_known_bed(rays, rays[:, 2], np.full(21, SIGMA), VERTICAL, bed)


def test_uniform_target_gives_offsets_with_honest_errors():
    random = np.random.default_rng(3)
    noise = 0.05 * random.standard_normal((30, 2))
    found = offsets_from_uniform(300.0 + np.array([0.3, -0.2]) + noise, np.full(30, 300.0))
    assert found.offset_k == pytest.approx([0.3, -0.2], abs=0.03)
    assert found.offset_sd_k == pytest.approx([0.05 / np.sqrt(30)] * 2, rel=0.5)
    drifting = 300.0 + np.linspace(0, 0.4, 30)[:, np.newaxis] + noise
    assert (offsets_from_uniform(drifting, np.full(30, 300.0)).offset_sd_k > found.offset_sd_k).all()
    with pytest.raises(CalibrationError, match="three minutes"):
        offsets_from_uniform(np.full((2, 1), 300.0), np.full(2, 300.0))


def test_known_beds_determine_steepness_but_not_its_split():
    rays, random = sun(181), np.random.default_rng(4)
    beds = normal([10.0, 20.0, 25.0], [180.0, 180.0, 90.0])
    target, flat = temperatures_k(beds, rays), np.tile(temperatures_k(VERTICAL, rays), (3, 1))
    sunlight = 800.0 * ((beds - VERTICAL) @ rays.T)
    warm, base = (t + 0.1 * random.standard_normal(t.shape) for t in (target, flat))
    found = identify(
        warm.ravel(), base.ravel(), sunlight.ravel(), 0.1, (1.15 * PAPER.alpha, 0.85 * PAPER.beta)
    )
    true = float(irradiance_per_kelvin(flat.mean(), PAPER))
    # published: the common effect to 0.2-0.6 %, the contrast to 37-86 %
    assert found.steepness_w_m2_k == pytest.approx(true, rel=0.006)
    assert found.steepness_sd / true < 0.006
    # on the split the data contain less than an independent thermometer would: a third of the prior is left
    assert found.share_sd > 0.03
    assert not found.share_is_prior


def test_split_that_data_do_not_tell_is_called_the_priors():
    rays, bed = sun(30), normal(20.0, 180.0)
    target, flat = (temperatures_k(one, rays) for one in (bed, VERTICAL))
    found = identify(target, flat, 800.0 * (rays @ (bed - VERTICAL)), 0.1, (PAPER.alpha, PAPER.beta))
    assert found.share_is_prior


def test_identification_refuses_beds_like_the_reference():
    with pytest.raises(CalibrationError, match="exchange"):
        identify(np.full(9, 300.1), np.full(9, 300.0), np.full(9, 3.0), 0.1, (PAPER.alpha, PAPER.beta))


def test_offsets_whose_minutes_are_alike_are_known_less_well_by_what_statistics_says():
    """Autoregressive noise: the mean's variance grows by (1 + r) / (1 - r) (Bartlett 1935)."""
    random, r, count, trials = np.random.default_rng(6), 0.6, 400, 300
    noise = np.zeros((count, trials))
    for row in range(1, count):
        noise[row] = r * noise[row - 1] + random.standard_normal(trials)
    found = offsets_from_uniform(300.0 + noise[100:], np.full(count - 100, 300.0))
    assert found.offset_sd_k.mean() == pytest.approx(found.offset_k.std(), rel=0.15)
