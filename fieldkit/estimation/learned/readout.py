"""From what is known after a minute to numbers for people: slopes with regions, parameters, advice.

The posterior is a mixture: one normal distribution for each hypothesis and branch. It is represented by
points drawn evenly from each, so that the region of a slope is that of the mixture and not of its best part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fieldkit.estimation.distributions import normal_quantile
from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.learned.hypotheses import depths_m, even_points
from fieldkit.estimation.learned.inputs import MinuteInputs
from fieldkit.estimation.learned.learner import FAR, Learner, Posterior, mass
from fieldkit.estimation.learned.normals import UnitNormals, tangent_basis
from fieldkit.estimation.learned.prior_state import DRYING_MINUTES, prior_sds
from fieldkit.estimation.likelihood import LikelihoodRegion
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.confidence import interval_sds
from fieldkit.model.learnt import LearntParameter
from fieldkit.physics.facet import VERTICAL, angle_between_deg, normal, tilt_azimuth

POINTS = 32
"""Points for each hypothesis and branch.

Judged: because 64 hypotheses with as many points each give quantiles of the mixture to a hundredth.
"""
LEAST_SHARE = 0.05
"""Probability from which a second branch is reported.

Judged: because it is the share that a 90 % region leaves out on each side.
"""
MOST_MISFIT = 4.0
"""Misfit from which no slope is reported.

Judged: because the stated deviations are then half of the true ones.
"""
SURPRISING_SDS = 2.5
"""Prior deviations of a learnt parameter from which slopes are wide.

Judged: because of five parameters that are as stated, one is so far off in one session of sixteen.
"""
NIGHT_RISE_K = 3.0
"""Warming while the sun is down that only a wrong clock or place explains.

Judged: because no ground warms by as much before the sun is up.
"""
WORDS = {
    "gain": "absorbed light",
    "exchange": "heat exchange with the air",
    "thermal_inertia": "thermal inertia",
    "longwave": "longwave of the sky",
    "air": "air temperature",
}


@dataclass(frozen=True, slots=True)
class KnownSlope:
    """Slope of one target: mean normal (3,), likelihood region, second branch (3,) or None, and its share.

    `along_half_width_deg` is half the width of the tilt's interval along its azimuth before anything is cut;
    `half_width_deg` that of its region, where it is wider.
    A known azimuth excludes slopes that lean the other way; `away` is the probability that they had.
    """

    best: FloatArray
    region: LikelihoodRegion
    half_width_deg: float
    along_half_width_deg: float
    away: float
    second: FloatArray | None
    share: float


Points = tuple[FloatArray, FloatArray]
"""Unit normals (k, 3) drawn from a mixture, and their weights (k,)."""


Branch = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""A mixture of unit vectors (p, k): directions in which they may turn (p, k, k - 1), covariance of the turns
(p, k - 1, k - 1) in rad2, and logarithms of the weights (p,)."""


def known_slope(learner: Learner, target: int) -> KnownSlope:
    """Slope of a target of the learner's layout."""
    posterior = learner.posterior
    branches = [(posterior.normals, posterior.log_weights), *filter(None, [posterior.others.get(target)])]
    turns = [(*turns_of(normals, target), log_weights) for normals, log_weights in branches]
    return slope_of(turns, learner.layout.facing[target], learner.settings)


def turns_of(normals: UnitNormals, target: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vectors of a target, directions in which they may turn, and the covariance of the turns."""
    turn = normals.turn(target)
    return normals.mode.units[target], normals.tangents[target], normals.covariance[:, turn, turn]


def slope_of(branches: Sequence[Branch], axes: FloatArray, settings: EstimatorSettings) -> KnownSlope:
    """Slope of one branch or two, in the axes of a target's normal (3, k)."""
    total = np.logaddexp.reduce([mass(log_weights) for *_, log_weights in branches])
    # a branch that is far worse has weights which round to nothing
    drawn = [_points(branch, total, axes) for branch in branches if mass(branch[-1]) > total - FAR]
    # what a region's neighbours learn is not bent by this: its azimuth may be the one that is wrong
    facing = [_facing(points, axes) for points in drawn]
    shares = np.array([weights.sum() for _, weights in facing])
    first = int(np.argmax(shares))
    best, second = _mean(*facing[first]), None
    share = float(shares[first] / shares.sum())
    if 1.0 - share >= LEAST_SHARE and angle_between_deg(other := _mean(*facing[1 - first]), best) > 1.0:
        second = other
    along = axes[:, 0] if axes.shape[1] == 2 else np.append(best[:2], 0.0) / max(np.hypot(*best[:2]), 1e-9)
    points, weights = drawn[first]
    leans = np.degrees(np.arctan2(points @ along, points[:, 2]))
    low, high = quantiles(leans, weights, _ends(settings))
    if axes.shape[1] == 2:
        is_flat, azimuth = low <= 0.0, float(tilt_azimuth(along)[1])
    else:
        is_flat, azimuth = _holds_upright(points, weights, settings.confidence), math.nan
    region = _region(facing[first], is_flat, azimuth, settings)
    # a tilt holds what turns across its azimuth too, which a free one does at noon
    along_deg = 0.5 * (high - low)
    half_deg = max(along_deg, 0.5 * (region.tilt_high_deg - region.tilt_low_deg))
    return KnownSlope(best, region, half_deg, along_deg, 1.0 - float(shares.sum()), second, share)


def _facing(drawn: Points, axes: FloatArray) -> Points:
    """Those that lean to the side of a known azimuth; upright, with hardly any weight, if none does."""
    points, weights = drawn
    if axes.shape[1] == 3:
        return drawn
    leans = points @ axes[:, 0] > 0.0
    return (points[leans], weights[leans]) if leans.any() else (VERTICAL[np.newaxis], np.array([1e-9]))


def _points(branch: Branch, total: float, axes: FloatArray) -> Points:
    """Points of a branch, which weigh its probability; `total` is the log-weight of all branches."""
    units, tangents, covariance, log_weights = branch
    standard = _standard(tangents.shape[2])
    weights = np.exp(log_weights - total)
    used = weights > 1e-6 * weights.sum()
    turned = np.matmul(standard, np.linalg.cholesky(covariance[used]).transpose(0, 2, 1))
    drawn = units[used][:, np.newaxis] + np.matmul(turned, tangents[used].transpose(0, 2, 1))
    drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
    each = weights[used] * (weights.sum() / weights[used].sum() / POINTS)
    return (drawn @ axes.T).reshape(-1, 3), np.repeat(each, POINTS)


@cache
def _standard(dimensions: int) -> FloatArray:
    """Points (k, dimensions) that stand for a standard normal distribution."""
    if dimensions == 1:
        return normal_quantile((np.arange(POINTS) + 0.5) / POINTS)[:, np.newaxis]
    # Sobol points begin at 0, whose quantile is infinite
    return normal_quantile(np.clip(even_points("sobol-2"), 1e-3, 1 - 1e-3))


def _mean(points: FloatArray, weights: FloatArray) -> FloatArray:
    mean = weights @ points
    return np.asarray(mean / np.linalg.norm(mean))


def _ends(settings: EstimatorSettings) -> tuple[float, float]:
    """Shares below both ends of an interval."""
    return 0.5 * (1.0 - settings.confidence), 0.5 * (1.0 + settings.confidence)


def _holds_upright(points: FloatArray, weights: FloatArray, confidence: float) -> bool:
    """True if the ellipse around the mean normal that holds the wanted share contains the vertical."""
    plane = tangent_basis(_mean(points, weights)[np.newaxis])[0]
    shares = weights / weights.sum()
    away, upright = ((normals - shares @ points) @ plane for normals in (points, VERTICAL))
    inverse = np.linalg.inv((shares[:, np.newaxis] * away).T @ away)
    # of the mixture's own distances: its tails are not those of a normal distribution
    nearer = (away @ inverse * away).sum(axis=1) < upright @ inverse @ upright
    return bool(shares[nearer].sum() <= confidence)


def _region(drawn: Points, is_flat: bool, azimuth: float, settings: EstimatorSettings) -> LikelihoodRegion:
    """Intervals of tilt and azimuth, each of the wanted share; `azimuth` is NaN where it is not known."""
    points, weights = drawn
    tilts, azimuths = tilt_azimuth(points)
    low, high = quantiles(tilts, weights, _ends(settings))
    if math.isfinite(azimuth):
        left, right = azimuth, azimuth
    else:
        azimuth = float(tilt_azimuth(_mean(points, weights))[1])
        turned = (azimuths - azimuth + 180.0) % 360.0 - 180.0
        ends = (-180.0, 180.0) if is_flat else quantiles(turned, weights, _ends(settings))
        left, right = (azimuth + end for end in ends)
    return LikelihoodRegion(0.0 if is_flat else low, high, left, right, is_flat)


def quantiles(values: FloatArray, weights: FloatArray, shares: tuple[float, ...]) -> list[float]:
    """Weighted quantiles of values (k,)."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return [float(np.interp(share, below / weights.sum(), values[order])) for share in shares]


@dataclass(frozen=True, slots=True)
class Moments:
    """Mean (m,) and covariance (m, m) of named quantities over the whole mixture; tilts in degrees."""

    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray

    def sd(self, name: str) -> float:
        """Standard deviation of one quantity."""
        place = self.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))

    def sd_if_known(self, name: str, readings: Mapping[str, float]) -> float:
        """Standard deviation of one quantity if others were read with these standard uncertainties."""
        place, others = self.names.index(name), [self.names.index(other) for other in readings]
        shared = self.covariance[place, others]
        measured = self.covariance[np.ix_(others, others)] + np.diag(np.square(list(readings.values())))
        explained = shared @ np.linalg.solve(measured, shared)
        return float(np.sqrt(max(self.covariance[place, place] - explained, 0.0)))


STATES = ("diffuse", "circumsolar", "longwave", "air")
LEVEL = ("level to the east", "level to the north")
"""Lean of the first reference against what is stated, in degrees; east and north are those of a level one."""
LOGARITHMS = ("exchange", "thermal_inertia", "depth", "gusts")


def moments(learner: Learner) -> Moments:
    """Joint mean and covariance of gain, tilts, what else is shared, and logarithms of the hypotheses."""
    posterior, layout = learner.posterior, learner.layout
    means, covariances = _within(posterior, learner)
    drawn, exchange = posterior.filters.hypotheses, posterior.filters.exchange
    logs = np.log(np.column_stack([exchange, drawn.inertia, drawn.depth_m, drawn.gust]))
    means = np.column_stack([means, logs])
    weights = posterior.weights
    mean = weights @ means
    away = means - mean
    covariance = (weights[:, np.newaxis] * away).T @ away
    inner = covariances.shape[1]
    # law of total variance: the spread of the means, and the mean of the spreads
    covariance[:inner, :inner] += np.tensordot(weights, covariances, axes=1)
    further = layout.place("session_exchange")
    own = posterior.filters.covariance[:, further, further] / exchange**2
    covariance[inner, inner] += weights @ own  # of the first of LOGARITHMS
    tilts, offsets, drying = (
        [f"{name}{target}" for target in range(layout.targets)] for name in ("tilt", "offset", "drying")
    )
    names = ("gain", *tilts, *STATES, *offsets, *drying, *LEVEL, *LOGARITHMS)
    return Moments(names, mean, covariance)


def _within(posterior: Posterior, learner: Learner) -> tuple[FloatArray, FloatArray]:
    """Means (p, m) and covariances (p, m, m) of what `moments` is of before the logarithms, by hypothesis."""
    layout, normals, filters = learner.layout, posterior.normals, posterior.filters
    others = [layout.place(name) for name in STATES]
    others += [layout.offset(layout.region(target)) for target in range(layout.targets)]
    others += [layout.drying(target) for target in range(layout.targets)]
    others += range(layout.level.start, layout.level.stop)
    steps, tilts = by_tilt(learner)
    turned = np.matmul(steps, np.matmul(normals.covariance, steps.transpose(0, 2, 1)))
    states, own, response = known_states(filters, normals, others)
    # the level is a state in radians times the gain
    units = np.append(np.ones(len(others) - len(LEVEL)), [math.degrees(1.0 / learner.settings.scale)] * 2)
    states, own, response = states * units, own * np.outer(units, units), response * units[:, np.newaxis]
    crossed = np.matmul(response, steps.transpose(0, 2, 1))
    means = np.column_stack([normals.mode.gain, tilts, states])
    upper = np.concatenate([turned, crossed.transpose(0, 2, 1)], axis=2)
    return means, np.concatenate([upper, np.concatenate([crossed, own], axis=2)], axis=1)


def known_states(
    filters: Filters, normals: UnitNormals, places: Sequence[int] | IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (p, m) and covariances (p, m, m) of states by unit normals, and by gain and turns (p, m, q)."""
    rows = np.asarray(places)[:, np.newaxis]
    shared = filters.covariance[:, rows, filters.layout.gain_and_normals]
    # what the unit lengths teach of the rest: the regression on gain and normals
    by_turns = np.matmul(normals.jacobian, normals.covariance)
    taught = normals.free - np.matmul(by_turns, normals.jacobian.transpose(0, 2, 1))
    own = filters.covariance[:, rows, places]
    own -= np.matmul(np.matmul(shared, taught), shared.transpose(0, 2, 1))
    means = filters.mean[:, places] + np.matmul(shared, normals.pull[..., np.newaxis])[..., 0]
    return means, own, np.matmul(shared, by_turns)


def by_tilt(learner: Learner) -> tuple[FloatArray, FloatArray]:
    """Derivatives (p, 1 + targets, q) of gain and tilts in degrees by gain and turns; tilts (p, targets)."""
    normals, layout = learner.posterior.normals, learner.layout
    count, turns = normals.covariance.shape[:2]
    steps = np.zeros((count, 1 + layout.targets, turns))
    steps[:, 0, 0] = 1.0
    tilts = np.zeros((count, layout.targets))
    for target, (unit, tangent) in enumerate(zip(normals.mode.units, normals.tangents, strict=True)):
        best = unit @ layout.facing[target].T
        tilts[:, target], azimuth = tilt_azimuth(best)
        steeper = normal(tilts[:, target] + 90.0, azimuth)
        turn = np.matmul((steeper @ layout.facing[target])[:, np.newaxis], tangent)[:, 0]
        steps[:, 1 + target, normals.turn(target)] = np.degrees(turn)
    return steps, tilts


def drying_w_m2(joint: Moments, target: int, hours: float) -> tuple[float, float]:
    """Flux that only fades into one target alone, in the first minute, and its standard deviation, W/m2.

    A bed that dries loses heat by it, below zero; `hours` after the first minute.
    """
    name, faded = f"drying{target}", math.exp(-60.0 * hours / DRYING_MINUTES)
    return float(joint.mean[joint.names.index(name)]) / faded, joint.sd(name) / faded


def prior_places(settings: EstimatorSettings, sds: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Prior mean and standard deviation of what is in `Moments`, of `LOGARITHMS` of the logarithm."""
    prior, slab = settings.prior, settings.slab
    return {
        "gain": (settings.scale, sds["gain"]),
        "exchange": (float(np.log(prior.exchange_w_m2_k)), prior.exchange_log_sd),
        "thermal_inertia": (float(np.log(slab.thermal_inertia)), prior.inertia_log_sd),
        "gusts": (float(np.log(prior.gust_sd_w_m2_k)), prior.gust_log_sd),
        "diffuse": (0.0, sds["diffuse"]),
        "circumsolar": (prior.circumsolar_share, sds["circumsolar"]),
        "longwave": (0.0, sds["longwave"]),
        "air": (0.0, sds["air"]),
    }


def learnt_parameters(learner: Learner, joint: Moments) -> tuple[LearntParameter, ...]:
    """The shared parameters as learnt, with their priors."""
    settings, logged = learner.settings, learner.logged_inputs
    places = prior_places(settings, prior_sds(settings, logged))
    places["air"] = (logged.camera_k, places["air"][1])

    def of(name: str, unit: str) -> LearntParameter:
        shown = np.exp if name in LOGARITHMS else float
        return _learnt(settings, joint, name, unit, *places[name], of=shown)

    return (
        of("gain", ""),
        of("exchange", "W m⁻² K⁻¹"),
        of("thermal_inertia", "J m⁻² K⁻¹ s⁻½"),
        _depth(settings, joint),
        of("gusts", "W m⁻² K⁻¹"),
        of("diffuse", ""),
        of("circumsolar", ""),
        of("longwave", "W/m²"),
        of("air", "K"),
    )


def _depth(settings: EstimatorSettings, joint: Moments) -> LearntParameter:
    """Depth, whose prior is a layer with a bottom or one without."""
    least, most = _ends(settings)
    low, median, high = depths_m(np.array([least, 0.5, most]), settings)
    spread = float(np.log(high / low)) / (2.0 * interval_sds(settings.confidence))
    plain = _learnt(
        settings, joint, "depth", "cm", np.log(median), spread, of=lambda log_m: 100.0 * math.exp(log_m)
    )
    # a prior with a part without bottom has other bounds than a normal distribution
    return replace(plain, prior_low=100.0 * float(low), prior_high=100.0 * float(high))


def _learnt(
    settings: EstimatorSettings,
    joint: Moments,
    name: str,
    unit: str,
    prior: float,
    prior_sd: float,
    of: Callable[[float], float] = float,
) -> LearntParameter:
    """A parameter with its prior; `of` makes numbers to show of those in `found`, prior and sd included."""
    value, sd, sds = joint.mean[joint.names.index(name)], joint.sd(name), interval_sds(settings.confidence)
    return LearntParameter(
        name=name,
        unit=unit,
        prior=float(of(prior)),
        prior_low=float(of(prior - sds * prior_sd)),
        prior_high=float(of(prior + sds * prior_sd)),
        value=float(of(value)),
        low=float(of(value - sds * sd)),
        high=float(of(value + sds * sd)),
        share_of_prior=min(sd / prior_sd, 1.0),
        confidence=settings.confidence,
    )


# --- whether the minutes contradict the model, and what is the likeliest cause


@dataclass(frozen=True, slots=True)
class Surprise:
    """A learnt parameter against its prior: its name, and by how many prior standard deviations it is off."""

    name: str
    sds: float

    def __str__(self) -> str:
        side = "above" if self.sds > 0.0 else "below"
        return f"{WORDS[self.name]} {abs(self.sds):.1f} standard deviations {side} what is usual"


def surprise(joint: Moments, settings: EstimatorSettings, prior_sds: dict[str, float]) -> Surprise | None:
    """The learnt parameter that is farthest from its prior, if by more than `SURPRISING_SDS`."""
    worst = Surprise("", 0.0)
    for name, (prior, sd) in prior_places(settings, prior_sds).items():
        off = float((joint.mean[joint.names.index(name)] - prior) / sd)
        if name in WORDS and abs(off) > abs(worst.sds):
            worst = Surprise(name, off)
    return worst if abs(worst.sds) > SURPRISING_SDS else None


def unlikeness(learner: Learner) -> float:
    """How much beds do alone for minutes and hours, over the usual, as learnt from them."""
    filters = learner.posterior.filters
    return float(learner.posterior.weights @ filters.noise.unlike(filters.hypotheses.unrest))


def cause(minutes: Sequence[MinuteInputs], unusual: Surprise | None) -> str:
    """The likeliest reason of a misfit, as a question to whoever measured."""
    dark = [minute for minute in minutes if minute.sun[2] <= 0.0]
    kelvin = np.array([minute.temperature_k[0] for minute in dark])
    if kelvin.size and kelvin.max() - kelvin[: int(kelvin.argmax()) + 1].min() > NIGHT_RISE_K:
        return "the ground warms while the sun is down: are clock, time zone and site right?"
    if unusual is None:
        return "is one bed unlike the others, or does a reading jump?"
    if unusual.name == "thermal_inertia" and unusual.sds > 0.0:
        return "are clock and site right, and is the ground dry and bare?"
    if unusual.name == "exchange" and unusual.sds > 0.0:
        return "is it snow, vegetation or a plate, or a windy day? See surface.kind"
    if unusual.name == "gain":
        return "is the light meter's factor right, or the surface brighter or darker than configured?"
    return "are clock, site and instruments right?"
