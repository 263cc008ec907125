"""Whether the minutes contradict the model, and what is the likeliest cause.

Prediction errors of a right model are white and of unit variance; of errors with the mean square c and the
correlation r from minute to minute, ``c (1 + r) / (1 - r)`` is how much too small the stated variances are
(the variance of the mean of an autoregressive process of order 1; G. E. P. Box and G. M. Jenkins, Time Series
Analysis, Holden-Day, 1970, section 2.1). A model that is wrong can also fit by parameters that nothing has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.learned.inputs import MinuteInputs
from fieldkit.estimation.learned.readout import Moments, prior_places
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.facet import FloatArray

MOST_MISFIT = 4.0
"""Misfit from which no slope is reported: the stated deviations are half of the true ones."""
SURPRISING_SDS = 2.5
NIGHT_RISE_K = 3.0
"""No ground warms by as much before the sun is up."""
WORDS = {
    "gain": "absorbed light",
    "exchange": "heat exchange with the air",
    "thermal_inertia": "thermal inertia",
    "longwave": "longwave of the sky",
    "air": "air temperature",
}


@dataclass(frozen=True, slots=True)
class Surprise:
    """A learnt parameter against its prior: its name, and by how many prior standard deviations it is off."""

    name: str
    sds: float

    def __str__(self) -> str:
        side = "above" if self.sds > 0.0 else "below"
        return f"{WORDS[self.name]} {abs(self.sds):.1f} standard deviations {side} what is usual"


def misfit(standardised: FloatArray) -> FloatArray:
    """How much too small stated variances are, by standardised prediction errors (n, regions).

    One number for each region; NaN is skipped; 1 for a region with fewer than ten.
    """
    known = np.isfinite(standardised)
    filled = np.nan_to_num(standardised)
    squares = (filled**2).sum(axis=0)
    count = known.sum(axis=0)
    correlation = np.clip((filled[1:] * filled[:-1]).sum(axis=0) / np.maximum(squares, 1e-12), 0.0, 0.95)
    found = squares / np.maximum(count, 1) * (1.0 + correlation) / (1.0 - correlation)
    return np.where(count < 10, 1.0, found)


def surprise(found: Moments, settings: EstimatorSettings, prior_sds: dict[str, float]) -> Surprise | None:
    """The learnt parameter that is farthest from its prior, if by more than `SURPRISING_SDS`."""
    worst = Surprise("", 0.0)
    for name, (prior, sd) in prior_places(settings, prior_sds).items():
        off = float((found.mean[found.names.index(name)] - prior) / sd)
        if name in WORDS and abs(off) > abs(worst.sds):
            worst = Surprise(name, off)
    return worst if abs(worst.sds) > SURPRISING_SDS else None


def cause(minutes: Sequence[MinuteInputs], unusual: Surprise | None) -> str:
    """The likeliest reason of a misfit, as a question to whoever measured."""
    dark = [one for one in minutes if one.sun[2] <= 0.0]
    kelvin = np.array([one.temperature_k[0] for one in dark])
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
