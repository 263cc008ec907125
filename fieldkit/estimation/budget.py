"""The uncertainty budget of a slope by any model, as the GUM tabulates it.

To first order a tilt is ``y = sum c_i x_i + rest``: the sensitivities c are the regression of the tilt on the
parameters over the posterior, so inputs that the data have tied to each other count once. The share of an
input is ``c_i cov(x_i, y) / var(y)``, the terms of JCGM 100:2008, eq. (13), gathered by input; one that
compensates another is negative. With the rest, which is noise and what passes, the shares add up to one. The
posterior is that of the learned model, or that of rows with their inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.balance import LIGHT, Rows, light_sds
from fieldkit.estimation.bins import History
from fieldkit.estimation.learned.hypotheses import DEPTH_QUANTILES, depths_m
from fieldkit.estimation.learned.learner import Learner
from fieldkit.estimation.learned.prior_state import prior_sds
from fieldkit.estimation.learned.readout import LEVEL, LOGARITHMS, STATES, Moments, by_tilt, prior_places
from fieldkit.estimation.normal import tangents
from fieldkit.estimation.region_temperatures import uncertain_inputs
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region

REST = "noise, drift and passing fluxes"
NUMERICAL = "numerical error of the draw"
UNITS: Mapping[str, str] = {
    "longwave": "W/m²",
    "air": "K",
    "offset": "K",
    "drift": "K/h",
    **dict.fromkeys((*LEVEL, REST), "°"),
}
LEARNT_SHARE = 0.5
"""Posterior over prior standard deviation below which the session's own minutes determine an input."""


@dataclass(frozen=True, slots=True)
class BudgetTerm:
    """One input of a slope.

    `name` is what is uncertain, such as ``longwave``, with its `uncertainty` after the data in `unit`, W/m2;
    "" for a ratio, a relative uncertainty for exchange, inertia, depth and gusts. `kind` is the type of
    evaluation (JCGM 100:2008, 0.7): A where the session's minutes at least halve the prior's standard
    uncertainty, B where it rests on the prior. `sensitivity` is the change of the tilt in degrees with the
    input, `share` that of the variance of the tilt.
    """

    name: str
    unit: str
    kind: str
    uncertainty: float
    sensitivity: float
    share: float


def slope_budget(learner: Learner, joint: Moments, target: int) -> tuple[BudgetTerm, ...]:
    """Budget of a target of the learner's layout, the largest share first.

    With a numerical error beside the posterior: the standard error of a mean of so many weighted hypotheses
    (J. S. Liu, Monte Carlo Strategies in Scientific Computing, Springer, 2001, section 2.5). Points drawn by
    chance would have it; evenly drawn ones have less.
    """
    tilt, weights = f"tilt{target}", learner.posterior.weights
    tilts = by_tilt(learner)[1][:, target]
    sd = float(np.linalg.norm(weights * (tilts - weights @ tilts)))
    both = 1.0 + (sd / joint.sd(tilt)) ** 2
    terms = budget_of(joint, tilt, f"offset{target}", _priors(learner))
    numerical = BudgetTerm(NUMERICAL, "°", "A", sd, 1.0, both - 1.0)
    shared = (replace(term, share=term.share / both) for term in (*terms, numerical))
    return tuple(sorted(shared, key=lambda term: -term.share))


def budget_of(joint: Moments, tilt: str, offset: str, priors: Mapping[str, float]) -> tuple[BudgetTerm, ...]:
    """Budget of the tilt named `tilt` by the inputs of `priors`, of which ``offset`` is that named `offset`.

    `found` are the joint moments after the data, `priors` standard deviations before.
    """
    inputs = {name: joint.names.index(offset if name == "offset" else name) for name in priors}
    places, row = list(inputs.values()), joint.names.index(tilt)
    own, shared = joint.covariance[np.ix_(places, places)], joint.covariance[places, row]
    # inputs may be all but a combination of others
    sensitivity = np.linalg.pinv(own, hermitian=True) @ shared
    variance, sds = joint.covariance[row, row], np.sqrt(np.diagonal(own))
    shares = sensitivity * shared / variance
    kinds = [
        "A" if sd < LEARNT_SHARE * prior else "B" for sd, prior in zip(sds, priors.values(), strict=True)
    ]
    rows = zip(inputs, kinds, sds.tolist(), sensitivity.tolist(), shares.tolist(), strict=True)
    units = {name: UNITS.get(name.partition(" of ")[0], "") for name in priors}
    terms = [BudgetTerm(name, units[name], *numbers) for name, *numbers in rows]
    remainder = max(1.0 - float(shares.sum()), 0.0)
    rest = BudgetTerm(REST, UNITS[REST], "A", float(np.sqrt(remainder * variance)), 1.0, remainder)
    return tuple(sorted([*terms, rest], key=lambda one: -one.share))


def _priors(learner: Learner) -> dict[str, float]:
    """Standard deviations of all inputs before the data; of `LOGARITHMS` relative."""
    settings = learner.settings
    low, high = np.log(depths_m(np.array(DEPTH_QUANTILES), settings))
    places = prior_places(settings, prior_sds(settings, learner.logged_inputs))
    sds = {name: sd for name, (_, sd) in places.items()}
    sds |= {"offset": settings.offset_sd_k, "depth": float(high - low) / 2.0}
    sds |= dict.fromkeys(LEVEL, math.degrees(learner.layout.level_sds[0]))
    return {name: sds[name] for name in ("gain", *STATES, "offset", *LEVEL, *LOGARITHMS)}


# --- by the models of rows, paper and full

ASSUMED = ("exchange", "conductivity", "heat capacity", "emissivity")
"""Inputs whose effect on a row is that of a higher assumption, not of a higher true value."""


@dataclass(frozen=True, slots=True)
class RowBudget:
    """The slope of one target by the model paper or full, to first order about the one that was found.

    `target` is its column in the `rows`, `weights` (n,) are inverse variances, zero for an excluded row,
    `slope` is the unit normal (3,). `history`, `regions` and `settings`: the minutes and their columns,
    standard uncertainties before the data, and whether azimuths are known.
    """

    rows: Rows
    target: int
    weights: FloatArray
    slope: FloatArray
    history: History
    regions: Sequence[Region]
    settings: EstimatorSettings

    def terms(self) -> tuple[BudgetTerm, ...]:
        """Budget of the tilt, the largest share first."""
        rows, sds, light = self.rows, self._input_sds(), self.rows.light_effects(self.slope[np.newaxis])[:, 0]
        # as the estimate weights them: what is uncertain of the light passes with the clouds
        weights = self.weights / (1.0 + self.weights * np.sum(light**2, axis=0))
        used = weights > 0.0
        effects = np.stack(
            [
                rows.design @ (self.slope - rows.reference) * sds["gain"],
                *light,
                *rows.systematics[:, :, self.target],
            ]
        )
        signs = [0.0 if not sd else -1.0 if name.startswith(ASSUMED) else 1.0 for name, sd in sds.items()]
        angles = np.radians(tangents(self.slope)[: 1 if self.settings.azimuth == "known" else 2])
        columns = np.vstack([angles @ rows.design.T, np.array(signs)[:, np.newaxis] * effects])[:, used]
        information = columns * weights[used] @ columns.T
        # few rows may leave an angle open: a prior so wide that it never counts keeps the matrix regular
        information += np.diag([*np.full(len(angles), 1e-9), *np.ones(len(effects))])
        units = np.array([*np.ones(len(angles)), *sds.values()])
        names = ("tilt", "direction")[: len(angles)] + tuple(sds)
        covariance = np.linalg.inv(information) * np.outer(units, units)
        return budget_of(Moments(names, np.zeros(len(names)), covariance), "tilt", "offset", sds)

    def _input_sds(self) -> dict[str, float]:
        """Standard uncertainty of each input before the data: scale, `LIGHT` and systematics, in order."""
        settings, is_full = self.settings, self.settings.model == "full"
        light = zip(LIGHT, light_sds(self.history, settings), strict=True) if is_full else ()
        layer = {"conductivity": settings.conductivity_sd, "heat capacity": settings.capacity_sd}
        # one minute alone shows nothing of the stored heat
        stores_heat = is_full and len(self.history) > 1
        return {
            "gain": math.hypot(settings.scale_sd, settings.factor_sd, 0.0 if is_full else PAPER_SCALE_SD),
            **dict(light),
            "offset": settings.offset_sd_k,
            "drift": settings.drift_sd_k_per_h,
            "exchange": settings.exchange_sd,
            **(layer if stores_heat else {}),
            **{name: sd for name, sd, *_ in uncertain_inputs(self.regions, settings)},
        }
