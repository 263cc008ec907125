"""The uncertainty budget of a slope by the learned model, as the GUM tabulates it.

To first order a tilt is ``y = sum c_i x_i + rest``: the sensitivities c are the regression of the tilt on the
parameters over the posterior, so inputs that the data have tied to each other count once. The share of an
input is ``c_i cov(x_i, y) / var(y)``, the terms of JCGM 100:2008, eq. (13), gathered by input; one that
compensates another is negative. With the rest, which is noise and what passes, the shares add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.learned.hypotheses import DEPTH_QUANTILES, depths_m
from fieldkit.estimation.learned.learner import Learner
from fieldkit.estimation.learned.prior_state import prior_sds
from fieldkit.estimation.learned.readout import LOGARITHMS, STATES, Moments, prior_places

REST = "noise, drift and passing fluxes"
UNITS: Mapping[str, str] = {"longwave": "W/m²", "air": "K", "offset": "K", "drift": "K/h", REST: "°"}
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


def slope_budget(learner: Learner, found: Moments, target: int) -> tuple[BudgetTerm, ...]:
    """Budget of a target of the learner's layout, the largest share first."""
    return budget_of(found, f"tilt{target}", f"offset{target}", _priors(learner))


def budget_of(found: Moments, tilt: str, offset: str, priors: Mapping[str, float]) -> tuple[BudgetTerm, ...]:
    """Budget of the tilt named `tilt` by the inputs of `priors`, of which ``offset`` is that named `offset`.

    `found` are the joint moments after the data, `priors` standard deviations before.
    """
    inputs = {name: found.names.index(offset if name == "offset" else name) for name in priors}
    places, row = list(inputs.values()), found.names.index(tilt)
    own, shared = found.covariance[np.ix_(places, places)], found.covariance[places, row]
    # inputs may be all but a combination of others
    sensitivity = np.linalg.pinv(own, hermitian=True) @ shared
    variance, sds = found.covariance[row, row], np.sqrt(np.diagonal(own))
    shares = sensitivity * shared / variance
    kinds = [
        "A" if sd < LEARNT_SHARE * prior else "B" for sd, prior in zip(sds, priors.values(), strict=True)
    ]
    rows = zip(inputs, kinds, sds.tolist(), sensitivity.tolist(), shares.tolist(), strict=True)
    terms = [BudgetTerm(name, UNITS.get(name, ""), *numbers) for name, *numbers in rows]
    left = max(1.0 - float(shares.sum()), 0.0)
    rest = BudgetTerm(REST, UNITS[REST], "A", float(np.sqrt(left * variance)), 1.0, left)
    return tuple(sorted([*terms, rest], key=lambda one: -one.share))


def _priors(learner: Learner) -> dict[str, float]:
    """Standard deviations of all inputs before the data; of `LOGARITHMS` relative."""
    settings = learner.settings
    low, high = np.log(depths_m(np.array(DEPTH_QUANTILES), settings))
    sds = {name: sd for name, (_, sd) in prior_places(settings, prior_sds(settings, learner.logged)).items()}
    sds |= {"offset": settings.offset_sd_k, "depth": float(high - low) / 2.0}
    return {name: sds[name] for name in ("gain", *STATES, "offset", *LOGARITHMS)}
