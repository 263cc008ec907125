"""One scale kappa for the differences between beds, from several beds of known slope.

Each bed gives a kappa (measured over true ``delta S / S``); here they are pooled. Where they disagree by
more than noise, the disagreement is the uncertainty. Temperatures cannot separate albedo, emissivity and
exchange.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.calibration.uncertainty import Budgeted, Contribution
from fieldkit.model.errors import CalibrationError

MIN_KAPPA, MAX_KAPPA = 0.3, 3.0
MAX_UNCERTAINTY = 0.25


@dataclass(frozen=True, slots=True)
class BedScale:
    """kappa of one bed, its standard uncertainty from noise, and its change with the inclinometer's error."""

    kappa: float
    kappa_sd: float
    per_tilt_sd: float


@dataclass(frozen=True, slots=True)
class PooledScale(Budgeted):
    """kappa of all beds with its budget."""

    kappa: float
    budget: tuple[Contribution, ...]
    freedom: int


def pool(beds: Mapping[str, BedScale], tilt_sd_deg: float) -> PooledScale:
    """Weighted mean of the scales of one or more beds, with its budget.

    Weights allow for noise and for the inclinometer, which is uncertain by `tilt_sd_deg`, independently from
    bed to bed. Raises `CalibrationError` for a scale outside 0.3 to 3, or if the beds disagree by more than
    0.25.
    """
    kappas = np.array([bed.kappa for bed in beds.values()])
    noise = np.array([bed.kappa_sd for bed in beds.values()])
    tilted = np.abs([bed.per_tilt_sd for bed in beds.values()])
    weights = 1.0 / (noise**2 + tilted**2)
    weights = weights / weights.sum()
    kappa = float(weights @ kappas)
    spread = math.sqrt(float(weights @ (kappas - kappa) ** 2)) if len(beds) > 1 else 0.0
    beyond = max(0.0, spread**2 - float(weights @ (noise**2 + tilted**2)))
    inclinometer = float(np.sqrt(np.sum((weights * tilted) ** 2)))
    budget = (
        Contribution(
            "noise", float(np.mean(noise)), "1", "A", float(np.sqrt(np.sum((weights * noise) ** 2)))
        ),
        Contribution("beds disagree", math.sqrt(beyond), "1", "A", math.sqrt(beyond)),
        Contribution("inclinometer", tilt_sd_deg, "deg", "B", inclinometer),
    )
    pooled = PooledScale(kappa, budget, max(0, len(beds) - 1))
    _refuse(pooled, beds)
    return pooled


def _refuse(found: PooledScale, beds: Mapping[str, BedScale]) -> None:
    each = ", ".join(f"{name} {bed.kappa:.2f}" for name, bed in beds.items())
    if not MIN_KAPPA < found.kappa < MAX_KAPPA:
        raise CalibrationError(
            f"the scale would be {found.kappa:.2f} ({each}), which no surface has",
            fix="check irradiance (eq. (10) counts 400-700 nm only), the beds' azimuths, the clock",
        )
    if found.standard_uncertainty > MAX_UNCERTAINTY:
        raise CalibrationError(
            f"the beds disagree: {each}",
            fix="check names, tilts and azimuths of the regions; use one alone to see which is wrong",
        )
