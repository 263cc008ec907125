"""Slopes of drawn worlds against the truths that made them; normals, advice and what was learnt."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR
from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.filters import Filters, Start
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, minutes_between
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.learner import Learner, Recorded
from fieldkit.estimation.learned.normals import FreeNormals, unit_normals
from fieldkit.estimation.learned.readout import learnt_parameters, moments
from fieldkit.physics.facet import angle_between_deg, normal
from tests.harness.drawn import drawn_world

ONE = Hypotheses(*(np.array([value]) for value in (16.0, 570.0, 0.03, 0.5, 1.0)))

LOGGED = Logged(True, True, 0.0, True, 0.0, 1.0, np.zeros(()))


@lru_cache
def world(seed, day, **options):
    drawn = drawn_world(seed, day, **options)
    return replace(drawn, settings=replace(drawn.settings, model="learned"))


def inputs(drawn, regions, settings):
    columns = RegionColumns(regions)
    layout = Layout.of(columns, columns.targets, settings)
    return layout, minutes_between(drawn.history, 0, len(drawn.history), layout, settings)


@pytest.mark.parametrize("seeds", [(1,), pytest.param((1, 3), marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("day", "as_configured", "within_deg"), [(CLEAR, True, 2.0), (BROKEN_CLOUD, False, 5.0)]
)
def test_drawn_worlds_give_their_slopes_back(day, as_configured, within_deg, seeds):
    """Mean errors after 40 min; where it is as configured every region holds the truth."""
    errors = []
    for seed in seeds:
        drawn = world(seed, day, as_configured=as_configured, minutes=40)
        for found, bed in zip(
            SlopeChain(drawn.regions, drawn.settings).at(drawn.history).slopes, drawn.regions[1:], strict=True
        ):
            errors.append(abs(found.tilt_deg - bed.tilt_deg))
            if as_configured:
                assert found.tilt_low_deg < bed.tilt_deg < found.tilt_high_deg
    assert np.mean(errors) < within_deg


def filtered(azimuth, hypotheses=ONE, minutes=25):
    """Filters after some minutes over one bed."""
    drawn = world(2, CLEAR, minutes=minutes)
    settings = replace(drawn.settings, azimuth=azimuth)
    layout, made = inputs(drawn, drawn.regions[:2], settings)
    filters = Filters(layout, hypotheses, settings, Start(made[0], LOGGED))
    for minute in made:
        filters.step(minute)
    return filters


@pytest.mark.parametrize("azimuth", ["known", "free"])
def test_unit_normals_are_the_mean_and_evidence_of_the_normal_distribution_on_the_sphere(azimuth):
    """Sums over a grid of the density times the area of a sphere of that gain, gain**(k - 1).

    What the bed absorbs more or less than the reference is one more number, of its own prior.
    """
    filters = filtered(azimuth)
    filters.mean *= 1.5  # a gain so far from 1 that the area counts
    filters.covariance *= 1.5**2
    layout, places = filters.layout, filters.layout.gain_and_normals
    mean, covariance = filters.mean[0, places], filters.covariance[0][np.ix_(places, places)]
    start = filters.mean[:, layout.normal(0)]
    free = FreeNormals.of(filters)
    found = unit_normals(free, free.guess((start / np.linalg.norm(start, axis=1, keepdims=True),)), 40)
    unit, tangent = found.mode.units[0][0], found.tangents[0][0]
    sds = np.sqrt(np.diagonal(found.covariance[0]))
    grids = [np.linspace(-5.0, 5.0, 27) * sd for sd in sds]
    gain, *turns, own = np.meshgrid(*grids, indexing="ij")
    turned = unit + np.stack([one.ravel() for one in turns], axis=1) @ tangent.T
    length = np.linalg.norm(turned, axis=1)
    units, gains = turned / length[:, np.newaxis], found.mode.gain[0] + gain.ravel()
    longer = 1.0 + own.ravel()
    away = np.column_stack([gains, (gains * longer)[:, np.newaxis] * units]) - mean
    own_sd = filters.model.settings.prior.own_gain_sd * filters.noise.unlike(filters.hypotheses.unrest)[0]
    misfit = np.sum(away @ np.linalg.inv(covariance) * away, axis=1) + (own.ravel() / own_sd) ** 2
    density = np.exp(-0.5 * misfit)
    # of the plane that touches the sphere only a part is the sphere: cos(angle)**k, k its dimensions
    cell = np.prod([grid[1] - grid[0] for grid in grids])
    k = unit.size
    whole = density * gains ** (k - 1) * length**-k * cell
    _, log_size = np.linalg.slogdet(2.0 * np.pi * covariance)
    expected = np.log(whole.sum()) - 0.5 * log_size - 0.5 * np.log(2.0 * np.pi * own_sd**2)
    # without the constants that all hypotheses share
    q = found.covariance.shape[1]
    found_log = found.log_evidence[0] + 0.5 * (q - mean.size - 1) * np.log(2.0 * np.pi)
    assert found_log == pytest.approx(expected, abs=0.06)  # Laplace's is the leading term
    centre = whole @ units
    centre = centre / np.linalg.norm(centre)
    apart = angle_between_deg(layout.facing[0] @ centre, layout.facing[0] @ unit)
    assert apart < 0.3 * np.degrees(sds[1:-1].max())
    variance = whole @ (gains - whole @ gains / whole.sum()) ** 2 / whole.sum()
    assert np.sqrt(variance) == pytest.approx(sds[0], rel=0.05)


def test_unit_normals_have_unit_length_and_any_start_leads_to_them():
    filters = filtered("free")
    starts = [normal(tilt, azimuth) for tilt, azimuth in ((5.0, 180.0), (25.0, 90.0), (15.0, 200.0))]
    free = FreeNormals.of(filters)
    ends = [unit_normals(free, free.guess((start[np.newaxis],)), 60).mode.units[0][0] for start in starts]
    for end in ends:
        assert np.linalg.norm(end) == pytest.approx(1.0)
        assert angle_between_deg(end, ends[0]) < 1e-4


def learner(minutes, settings=None, drawn=None):
    drawn = drawn or world(2, CLEAR, minutes=30)
    settings = settings or drawn.settings
    layout, made = inputs(drawn, drawn.regions, settings)
    learnt = Learner(layout, settings, [Recorded(LOGGED, made[:1])])
    for minute in made[1:minutes]:
        learnt.add(minute)
    return learnt


def test_shares_of_the_prior_lie_between_zero_and_one_and_shrink():
    shares = []
    for minutes in (1, 30):
        learnt = learner(minutes)
        parameters = learnt_parameters(learnt, moments(learnt))
        assert all(0.0 <= one.share_of_prior <= 1.0 for one in parameters)
        assert all(one.low <= one.value <= one.high for one in parameters)
        shares.append({one.name: one.share_of_prior for one in parameters})
    assert shares[1]["exchange"] < shares[0]["exchange"]
    assert shares[1]["gusts"] < shares[0]["gusts"]


def test_without_data_the_posterior_is_the_prior():
    """Noise of 10 MK says nothing; hypotheses are a sample, so their moments are near the prior only."""
    drawn = world(2, CLEAR, minutes=30)
    learnt = learner(3, replace(drawn.settings, noise_k=1e7))
    for one in learnt_parameters(learnt, moments(learnt)):
        width, prior_width = one.high - one.low, one.prior_high - one.prior_low
        if one.name in ("exchange", "thermal_inertia", "gusts"):
            assert one.share_of_prior == pytest.approx(1.0, abs=0.15)
            assert np.log(one.value / one.prior) == pytest.approx(0.0, abs=0.15)
        elif one.name in ("diffuse", "circumsolar", "longwave", "air"):
            assert one.value == pytest.approx(one.prior, abs=1e-3 * prior_width)
            assert width == pytest.approx(prior_width, rel=0.02)


def test_a_state_known_better_narrows_a_tilt_as_the_joint_distribution_says():
    """Given one more reading of a state, by Gaussian conditioning on the whole covariance."""
    learnt = learner(20)
    found = moments(learnt)
    for other, sd in (("air", 0.5), ("longwave", 10.0), ("exchange", 0.1)):
        place, known = found.names.index("tilt1"), found.names.index(other)
        information = np.linalg.inv(found.covariance)
        information[known, known] += sd**-2
        expected = np.sqrt(np.linalg.inv(information)[place, place])
        assert found.sd_if_known("tilt1", {other: sd}) == pytest.approx(expected, rel=1e-6)


def test_what_a_reading_would_bring_is_what_it_brings():
    """One hypothesis, estimated again with longwave and air measured: the spread that was promised."""
    drawn = world(2, CLEAR, minutes=30)
    layout, made = inputs(drawn, drawn.regions, drawn.settings)

    def spread(settings):
        """Moments of a learner with one hypothesis."""
        filters = Filters(layout, ONE, settings, Start(made[0], LOGGED))
        for minute in made:
            filters.step(minute)
        starts = tuple(filters.mean[:, layout.normal(i)] for i in range(layout.targets))
        starts = tuple(one / np.linalg.norm(one, axis=1, keepdims=True) for one in starts)
        free = FreeNormals.of(filters)
        normals = unit_normals(free, free.guess(starts), 60)
        posterior = SimpleNamespace(filters=filters, normals=normals, weights=np.ones(1))
        return moments(SimpleNamespace(layout=layout, settings=settings, posterior=posterior))

    before = spread(drawn.settings)
    prior, sd = drawn.settings.prior, 5.0
    # a prior and a reading together: variances add by their inverses
    measured_sd = (prior.longwave_sd_w_m2**-2 + sd**-2) ** -0.5
    measured = replace(drawn.settings, prior=replace(prior, longwave_sd_w_m2=measured_sd))
    after = spread(measured)
    for target in range(3):
        promised = before.sd_if_known(f"tilt{target}", {"longwave": sd})
        assert after.sd(f"tilt{target}") == pytest.approx(promised, rel=0.03)


@pytest.mark.parametrize("height_deg", [2.0, 20.0, 60.0])
def test_light_near_grazing_is_the_best_line_through_what_may_be_lit(height_deg):
    """Against a million draws: mean, slope of the regression, and what it leaves of max(0, x)."""
    filters = filtered("free", minutes=2)
    height = np.radians(height_deg)
    sun = np.array([0.0, np.cos(height), np.sin(height)])  # from the north, low over the bed
    drawn = world(2, CLEAR, minutes=2)
    _, made = inputs(drawn, drawn.regions[:2], replace(drawn.settings, azimuth="free"))
    found = filters.model.light(replace(made[0], sun=sun), filters.mean, filters.covariance)
    place, random = filters.layout.normal(0), np.random.default_rng(1)
    mean, spread = filters.mean[0, place] @ sun, sun @ filters.covariance[0, place, place] @ sun
    x = mean + np.sqrt(spread) * random.standard_normal(1_000_000)
    lit = np.maximum(x, 0.0)
    slope = np.cov(x, lit)[0, 1] / np.var(x)
    left = np.std(lit - slope * x)
    assert found.mean[0, 1] == pytest.approx(lit.mean(), abs=2e-3)
    assert found.share[0, 1] == pytest.approx(slope, abs=5e-3)
    assert found.left[0, 1] == pytest.approx(lit.mean() - slope * mean, abs=2e-3)
    assert found.sd[0, 1] == pytest.approx(left, abs=2e-3)
