"""The uncertainty budget of a slope by the full model, from its rows, as the GUM tabulates it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fieldkit.estimation.balance import LIGHT, Rows, light_sds
from fieldkit.estimation.bins import History
from fieldkit.estimation.learned.budget import BudgetTerm, budget_of
from fieldkit.estimation.learned.readout import Moments
from fieldkit.estimation.normal import tangents
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.facet import FloatArray


def row_budget(
    rows: Rows,
    target: int,
    weights: FloatArray,
    slope: FloatArray,
    history: History,
    settings: EstimatorSettings,
) -> tuple[BudgetTerm, ...]:
    """Budget of a tilt to first order about the slope that was found, the largest share first.

    Parameters
    ----------
    rows
        Of the full model.
    target
        The target's column in `rows`.
    weights
        Inverse variances, (n,); zero excludes a row. [-]
    slope
        Unit normal, (3,). [-]
    history, settings
        The minutes, and standard uncertainties before the data, and whether azimuths are known.
    """
    used = weights > 0.0
    sds = _input_sds(rows, history, settings)
    effects = [
        sds["gain"] * rows.design @ (slope - rows.reference),
        *rows.light_effects(slope[np.newaxis])[:, 0],
        *rows.systematics[:, :, target],
    ]
    angles = tangents(slope)[: 1 if settings.azimuth == "known" else 2]
    columns = np.stack([*(rows.design @ np.radians(one) for one in angles), *effects])[:, used]
    information = columns * weights[used] @ columns.T
    information += np.diag([*np.zeros(len(angles)), *np.ones(len(effects))])
    units = np.array([*np.ones(len(angles)), *sds.values()])
    covariance = np.linalg.inv(information) * np.outer(units, units)
    names = ("tilt", "direction")[: len(angles)] + tuple(sds)
    return budget_of(Moments(names, np.zeros(len(names)), covariance), "tilt", "offset", sds)


def _input_sds(rows: Rows, history: History, settings: EstimatorSettings) -> Mapping[str, float]:
    """Standard uncertainty of each input before the data, in the order of scale, `LIGHT` and systematics."""
    known = {
        "gain": math.hypot(settings.scale_sd, settings.factor_sd),
        **dict(zip(LIGHT, light_sds(history, settings), strict=True)),
        "offset": settings.offset_sd_k,
        "drift": settings.drift_sd_k_per_h,
        "exchange": settings.exchange_sd,
        "conductivity": settings.conductivity_sd,
        "heat capacity": settings.capacity_sd,
    }
    emissivities = 1 + len(LIGHT) + len(rows.systematics) - len(known)
    return known | {f"emissivity {number}": 1.0 for number in range(1, emissivities + 1)}
