"""Hypotheses about exchange, layer and gusts: drawn, weighed by the data, and drawn again where they count.

What does not enter the temperatures linearly cannot be a state of a Kalman filter. Five numbers of this kind
are left: exchange, thermal inertia, depth and the strengths of gusts and of
slow changes. They are drawn from their prior on a
Sobol sequence, which covers it more evenly than chance would, and weighed by the probability of the data
(importance sampling). As minutes add up, few hypotheses keep the weight; then all are drawn anew from a
normal distribution fitted to the posterior density where they lie, a part of them always from the prior, so
that none is lost.

The sequence is a fixed table: equal minutes give equal hypotheses.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from importlib import resources

import numpy as np

from fieldkit.estimation.distributions import normal_cdf, normal_quantile
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray

UNKNOWNS = 5
MOST_SDS = 5.0
"""Farthest from the prior's centre.

Judged: because beyond it fluxes of any size explain anything, and numbers overflow.
"""
FROM_PRIOR, DEPTH_FROM_PRIOR = 15, 5
"""One hypothesis in so many is of the prior, and one in so many has a depth of the prior.

Judged: because the first keep a truth that early minutes misjudged within reach; and as minutes hardly tell
a deep layer from a deeper one, a fitted normal distribution may miss the shallow ones, or the deep. Both are
odd, because every second or fourth point of the sequence lies in one part of its space.
"""
WIDER = 1.2
"""Width of the proposal over that of the fitted distribution.

Judged: because importance sampling needs tails at least as wide as the posterior's.
"""
DEEP_M = (0.08, 0.40)
"""Depths of a layer that has no bottom for a day's heat, evenly in their logarithm. [m]

Judged: because a day's wave reaches some 7 cm into dry sand, and below 40 cm more depth changes nothing.
"""
DEPTH_QUANTILES = (0.1587, 0.8413)
"""Between these lie two standard deviations of a normal distribution."""
LEAST_EFFECTIVE = 30.0
"""Hypotheses that a fitted distribution rests on at least; weights are tempered until it does.

Judged: because its polynomial has 21 coefficients.
"""
CURVATURES = (0.3, 400.0)
"""Curvatures of the fitted density, least and most, over those of the tempered hypotheses' distribution.

Judged: because the tempered distribution is wider, so up to twenty times narrower is believed; a ridge or a
saddle is not.
"""
FARTHEST = 2.5
"""Farthest that its centre lies from theirs, in their standard deviations.

Judged: because a polynomial says nothing beyond the points that it was fitted to.
"""
_PAIRS = np.triu_indices(UNKNOWNS)
_BITS = 30
"""The points are whole multiples of two to the power of minus this."""


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """Parameters in which the filters differ, (p,) each.

    `exchange` and `gust` [W m-2 K-1], `inertia` [J m-2 K-1 s-1/2], `depth_m` [m]; `unrest` scales all slow
    processes.
    """

    exchange: FloatArray
    inertia: FloatArray
    depth_m: FloatArray
    gust: FloatArray
    unrest: FloatArray


@dataclass(frozen=True, slots=True)
class Proposal:
    """Distribution that hypotheses are drawn from, in coordinates in which the prior is standard normal.

    A mixture of one normal distribution, `centre` (5,) and `root` (5, 5) lower triangular, of the same with
    the prior's depth, the first coordinate, and of the prior.
    """

    centre: FloatArray
    root: FloatArray

    @classmethod
    def prior(cls) -> Proposal:
        """The prior itself."""
        return cls(np.zeros(UNKNOWNS), np.eye(UNKNOWNS))

    @classmethod
    def fit(cls, points: FloatArray, log_density: FloatArray) -> Proposal:
        """Fitted to the logarithm of the posterior density at points (p, 5), (p,) up to a constant.

        Its second-order polynomial by least squares, where the density is high: the mean and covariance of
        few points say less than the density that is known at each of them.
        """
        weights = temper(log_density)
        centre = weights @ points
        away = points - centre
        covariance = (weights[:, np.newaxis] * away).T @ away
        # a few heavy points may lie in a plane
        root = np.linalg.cholesky(covariance + 0.02**2 * np.eye(UNKNOWNS))
        # in the points' own scale, where all coefficients are of like size
        slope, curvature = _polynomial(np.linalg.solve(root, away.T).T, log_density, weights)
        sizes, axes = np.linalg.eigh(curvature)
        # a saddle or a ridge of few points would send the next draw anywhere
        sizes = np.clip(sizes, *CURVATURES)
        step = axes @ (slope @ axes / sizes)
        step *= min(1.0, FARTHEST / max(float(np.linalg.norm(step)), 1e-9))
        # a normal density's covariance is the inverse of its curvature; back in the prior's coordinates
        narrowed = root @ axes / np.sqrt(sizes)
        return cls(centre + root @ step, np.asarray(WIDER * np.linalg.cholesky(narrowed @ narrowed.T)))

    def draw(self, count: int) -> FloatArray:
        """Points (count, 5), at most 256."""
        standard = normal_quantile(np.clip(even_points("sobol-5")[:count], 1e-9, 1.0 - 1e-9))
        inside = standard.copy()
        # with the first coordinate of the prior, the others follow as they do in the fitted distribution
        inside[1::DEPTH_FROM_PRIOR, 0] = (inside[1::DEPTH_FROM_PRIOR, 0] - self.centre[0]) / self.root[0, 0]
        points = self.centre + inside @ self.root.T
        points[::FROM_PRIOR] = standard[::FROM_PRIOR]
        return np.asarray(np.clip(points, -MOST_SDS, MOST_SDS))

    def distance(self, point: FloatArray) -> float:
        """Distance of a point (5,) from the centre, in deviations of the fitted distribution."""
        return float(np.linalg.norm(np.linalg.solve(self.root, point - self.centre)))

    def log_density(self, points: FloatArray) -> FloatArray:
        """Logarithm of the density at points (p, 5), (p,) up to that of a standard normal at its centre."""
        inside = np.linalg.solve(self.root, (points - self.centre).T)
        each = -0.5 * inside**2 - np.log(np.diagonal(self.root))[:, np.newaxis]
        fitted, beyond_depth = each.sum(axis=0), each[1:].sum(axis=0) + log_prior(points[:, :1])
        parts = [fitted, beyond_depth, log_prior(points)]
        shares = np.array([0.0, 1.0 / DEPTH_FROM_PRIOR, 1.0 / FROM_PRIOR])
        shares[0] = 1.0 - shares.sum()
        return np.asarray(np.logaddexp.reduce(np.log(shares)[:, np.newaxis] + parts))


def log_prior(points: FloatArray) -> FloatArray:
    """Logarithm of the prior's density at points (p, k), (p,) up to its value at the centre."""
    return np.asarray(-0.5 * (points**2).sum(axis=1))


def _polynomial(points: FloatArray, values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope (5,) and curvature (5, 5) at the origin of ``s'x - x'Cx/2``, fitted to weighted values (p,)."""
    first, second = _PAIRS
    terms = np.column_stack([np.ones(len(points)), points, points[:, first] * points[:, second]])
    by = np.sqrt(weights)
    coefficients = np.linalg.lstsq(by[:, np.newaxis] * terms, by * values, rcond=None)[0]
    curvature = np.zeros((UNKNOWNS, UNKNOWNS))
    curvature[_PAIRS] = -coefficients[1 + UNKNOWNS :]
    return coefficients[1 : 1 + UNKNOWNS], curvature + curvature.T


def effective(log_weights: FloatArray) -> float:
    """Effective number of weighted hypotheses."""
    weights = normalise(log_weights)
    return float(1.0 / (weights**2).sum())


def normalise(log_weights: FloatArray) -> FloatArray:
    """Weights that add up to one."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def temper(log_weights: FloatArray) -> FloatArray:
    """Weights flattened until `LEAST_EFFECTIVE` hypotheses carry them."""
    power = 1.0
    while effective(power * log_weights) < LEAST_EFFECTIVE and power > 1e-6:
        power *= 0.8
    return normalise(power * log_weights)


def hypotheses(points: FloatArray, settings: EstimatorSettings) -> Hypotheses:
    """Hypotheses at points (p, 5) of coordinates in which the prior is standard normal."""
    prior = settings.prior
    depth, exchange, inertia, gust, unrest = points.T  # depth first: see `Proposal`
    return Hypotheses(
        prior.exchange_w_m2_k * np.exp(prior.exchange_log_sd * exchange),
        settings.slab.thermal_inertia * np.exp(prior.inertia_log_sd * inertia),
        depths_m(normal_cdf(depth), settings),
        prior.gust_sd_w_m2_k * np.exp(prior.gust_log_sd * gust),
        np.exp(prior.unrest_log_sd * unrest),
    )


def depths_m(share: FloatArray, settings: EstimatorSettings) -> FloatArray:
    """Depths below which these shares of the prior lie: around the slab's, or practically bottomless."""
    prior = settings.prior
    # quantiles of a mixture have no closed form: read off its distribution on a grid
    depths = np.geomspace(0.004, 0.6, 400)
    body = normal_cdf(np.log(depths / settings.slab.depth_m) / prior.depth_log_sd)
    deep = np.clip(np.log(depths / DEEP_M[0]) / np.log(DEEP_M[1] / DEEP_M[0]), 0.0, 1.0)
    below = (1.0 - prior.deep_share) * body + prior.deep_share * deep
    return np.asarray(np.exp(np.interp(share, below, np.log(depths))))


def even_points(table: str) -> FloatArray:
    """Points (count, dimensions) within [0, 1), any first power of two of them evenly spread.

    They are the same numbers in every run. `scipy.stats.qmc` makes them, and takes half a second to import,
    as long as everything else that an estimate needs.

    ``"sobol-5"`` are 256 points of ``scipy.stats.qmc.Sobol(5, rng=numpy.random.default_rng(20170830))``,
    ``"sobol-2"`` 32 of ``Sobol(2, rng=default_rng(1))``. S. Joe and F. Y. Kuo, "Constructing Sobol sequences
    with better two-dimensional projections", SIAM Journal on Scientific Computing 30, 2008.
    """
    text = (resources.files("fieldkit") / "data" / f"{table}.csv").read_text(encoding="ascii")
    return np.loadtxt(io.StringIO(text), delimiter=",") / 2.0**_BITS
