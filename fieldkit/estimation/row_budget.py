"""The uncertainty budget of a slope by the full model, from its rows, as the GUM tabulates it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.balance import LIGHT, Rows, light_sds
from fieldkit.estimation.bins import History
from fieldkit.estimation.learned.budget import BudgetTerm, budget_of
from fieldkit.estimation.learned.readout import Moments
from fieldkit.estimation.normal import tangents
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.weather_reference import INPUTS
from fieldkit.physics.facet import FloatArray

GAIN = ("gain", "exchange", "level gain", "level exchange")
"""Inputs that decide how many kelvin a watt per square metre causes."""


@dataclass(frozen=True, slots=True)
class RowBudget:
    """The slope of one target by the full model, to first order about the one that was found.

    `target` is its column in the `rows`, `weights` (n,) are inverse variances, zero for an excluded row,
    `slope` is the unit normal (3,). `history` and `settings`: the minutes, standard uncertainties before the
    data, and whether azimuths are known.
    """

    rows: Rows
    target: int
    weights: FloatArray
    slope: FloatArray
    history: History
    settings: EstimatorSettings

    def terms(self) -> tuple[BudgetTerm, ...]:
        """Budget of the tilt, the largest share first."""
        sds = self._input_sds()
        names, covariance = self._covariance(sds)
        return budget_of(Moments(names, np.zeros(len(names)), covariance), "tilt", "offset", sds)

    def north_south_deg(self) -> tuple[float, float]:
        """How far the gain moves the slope to north or south, and all else: standard deviations in degrees.

        Gain is kelvin per watt: absorbed light and heat exchange, of the target and of its reference.
        """
        sds = self._input_sds()
        towards = np.array([along[1] for along in tangents(self.slope)])
        variances = []
        for known in ((), GAIN):
            certain = {name: 0.0 if name in known else sd for name, sd in sds.items()}
            names, covariance = self._covariance(certain)
            count = len(names) - len(sds)
            variances.append(float(towards[:count] @ covariance[:count, :count] @ towards[:count]))
        moved = max(variances[0] - variances[1], 0.0)
        return math.sqrt(moved), math.sqrt(variances[1])

    def _covariance(self, sds: Mapping[str, float]) -> tuple[tuple[str, ...], FloatArray]:
        """Names and joint covariance after the data: of tilt, direction unless known, and all inputs."""
        rows, used = self.rows, self.weights > 0.0
        effects = [
            rows.design @ (self.slope - rows.reference) * sds["gain"],
            *rows.light_effects(self.slope[np.newaxis])[:, 0],
            *rows.systematics[:, :, self.target],
        ]
        angles = tangents(self.slope)[: 1 if self.settings.azimuth == "known" else 2]
        is_open = [sd > 0.0 for sd in sds.values()]
        columns = np.stack([*(rows.design @ np.radians(one) for one in angles), *effects])[:, used]
        columns[len(angles) :] *= np.array(is_open)[:, np.newaxis]
        information = columns * self.weights[used] @ columns.T
        # few rows may leave an angle open: a prior so wide that it never counts keeps the matrix regular
        information += np.diag([*np.full(len(angles), 1e-9), *np.ones(len(effects))])
        units = np.array([*np.ones(len(angles)), *sds.values()])
        names = ("tilt", "direction")[: len(angles)] + tuple(sds)
        return names, np.linalg.inv(information) * np.outer(units, units)

    def _input_sds(self) -> dict[str, float]:
        """Standard uncertainty of each input before the data: scale, `LIGHT` and systematics, in order."""
        rows, settings = self.rows, self.settings
        light = dict(zip(LIGHT, light_sds(self.history, settings), strict=True)) if rows.light.size else {}
        known = {
            "gain": math.hypot(settings.scale_sd, settings.factor_sd),
            **light,
            "offset": settings.offset_sd_k,
            "drift": settings.drift_sd_k_per_h,
            "exchange": settings.exchange_sd,
        }
        if settings.model == "full":
            known |= {"conductivity": settings.conductivity_sd, "heat capacity": settings.capacity_sd}
        # these are known by their effect alone
        levels = INPUTS if settings.reference == "weather" else ()
        emissivities = 1 + len(rows.light) + len(rows.systematics) - len(known) - len(levels)
        others = [*(f"emissivity {number}" for number in range(1, emissivities + 1)), *levels]
        return known | dict.fromkeys(others, 1.0)
