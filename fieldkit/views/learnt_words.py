"""Learnt parameters, in words and tables: each parameter before and after the data, and the residuals."""

from __future__ import annotations

import math
from collections.abc import Callable

from fieldkit.model.confidence import CONFIDENCE, percent
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.views import formatting

NAMES = {
    "exchange": "exchange with the air",
    "diffuse": "diffuse light",
    "circumsolar": "circumsolar share",
    "brightening": "light around sun and horizon",
    "air": "air temperature",
}
"""Names of parameters in tables; others are shown as they are."""
SHORT = {"thermal_inertia": "inertia", "air": "air temp."}
"""Names where there is little room."""
FIRST = ("gain", "depth", "thermal_inertia", "exchange")
"""Parameters that the live view has room for."""
COLUMNS = ("parameter", "from data", "learnt", "prior")
RESIDUAL_COLUMNS = ("region", "residual, K", "autocorrelation")
_MEANING = (
    "From data: 1 − posterior/prior standard deviation; 0 %: the data added nothing. Gain: absorbed over "
    "stated direct light. Diffuse light is relative to the measured or configured value; longwave and air "
    "temperature are offsets from it. Circumsolar share: 0 isotropic, 1 Hay and Davies."
)
BAR_CELLS = 8
SHORT_UNIT = 4
CORRELATED = 0.3
"""Autocorrelation of residuals from which the model misses something that lasts for minutes."""


def name(parameter: LearntParameter) -> str:
    """A parameter's name with its unit: ``thermal inertia, J m⁻² K⁻¹ s⁻½``."""
    words = NAMES.get(parameter.name, parameter.name.replace("_", " "))
    return f"{words}, {parameter.unit}" if parameter.unit else words


def short(parameter: LearntParameter) -> str:
    """A parameter's short name, with its unit where that is short."""
    words = SHORT.get(parameter.name, parameter.name)
    return f"{words}, {parameter.unit}" if 0 < len(parameter.unit) <= SHORT_UNIT else words


def by_name(learnt: Learnt | None) -> dict[str, LearntParameter]:
    """The parameters by their names; empty where nothing was learnt."""
    return {parameter.name: parameter for parameter in learnt.parameters} if learnt else {}


def main(learnt: Learnt | None) -> list[LearntParameter]:
    """The parameters that matter most, in the order of `FIRST`."""
    parameters = by_name(learnt)
    return [parameters[name] for name in FIRST if name in parameters]


def before(parameter: LearntParameter) -> str:
    """The prior with its interval: ``15 (7 to 34)``."""
    return _interval(parameter.prior, parameter.prior_low, parameter.prior_high)


def value_text(parameter: LearntParameter) -> str:
    """The estimate with its interval."""
    return _interval(parameter.value, parameter.low, parameter.high)


def value(parameter: LearntParameter) -> str:
    """The estimate alone, in `short` units."""
    words = formatting.number(parameter.value, _digits((parameter.high - parameter.low) / 2))
    return f"{words} {parameter.unit}" if 0 < len(parameter.unit) <= SHORT_UNIT else words


def from_data(parameter: LearntParameter) -> float:
    """Information from the data, in [0, 1]: one less posterior over prior standard deviation."""
    return min(1.0, max(0.0, 1.0 - parameter.share_of_prior))


def bar(share: float, cells: int = BAR_CELLS) -> str:
    """A share as a bar of characters: ``█████░░░``."""
    filled = round(share * cells) if math.isfinite(share) else 0
    return "█" * filled + "░" * (cells - filled)


def bar_and_percentage(share: float) -> str:
    """A share as a bar of characters and in figures."""
    return f"{bar(share)} {share:.0%}"


def confidence(learnt: Learnt) -> str:
    """The confidence of the intervals: ``90 %``."""
    return percent(next((parameter.confidence for parameter in learnt.parameters), CONFIDENCE))


def meaning(learnt: Learnt | None) -> str:
    """Meaning of the columns, with the confidence of the intervals."""
    return f"Medians with {confidence(learnt)} intervals. {_MEANING}" if learnt else _MEANING


def rows(
    learnt: Learnt | None, shown: Callable[[float], object] = bar_and_percentage
) -> list[tuple[object, ...]]:
    """For each parameter the `COLUMNS`, with how much the data said as `shown` renders shares."""
    parameters = learnt.parameters if learnt else ()
    return [
        (name(parameter), shown(from_data(parameter)), value_text(parameter), before(parameter))
        for parameter in parameters
    ]


def residual_rows(learnt: Learnt) -> list[tuple[str, ...]]:
    """For each region the `RESIDUAL_COLUMNS`."""
    return [
        (
            region,
            formatting.number(residual_k, 3),
            formatting.number(learnt.autocorrelation.get(region, math.nan), 2),
        )
        for region, residual_k in learnt.residual_k.items()
    ]


def correlations(learnt: Learnt) -> dict[str, float]:
    """The autocorrelations by region that show something missed by the model, and regions too narrow.

    Errors that are correlated and small at once are covered by what is stated: only their product says more.
    """
    return {
        name: value
        for name, value in learnt.autocorrelation.items()
        if abs(value) >= CORRELATED and learnt.misfit(name) > 1.0
    }


def judgement(learnt: Learnt) -> str:
    """Judgement of the model by the residuals, in a sentence."""
    chi_square = f"Mean square of the standardised residuals: {formatting.number(learnt.chi_square, 2)}"
    if missed := correlations(learnt):
        return (
            f"{chi_square}; those of {', '.join(missed)} are correlated from minute to minute: the model "
            "misses something there, and the likelihood regions are too narrow."
        )
    return f"{chi_square} (1: as the stated noise); uncorrelated from minute to minute."


def _interval(value: float, low: float, high: float) -> str:
    """A value with its interval, to two digits of half the interval."""
    if not math.isfinite(value):
        return formatting.UNKNOWN
    digits = _digits((high - low) / 2)
    bounds = f" ({formatting.number(low, digits)} to {formatting.number(high, digits)})"
    return formatting.number(value, digits) + (bounds if math.isfinite(high - low) else "")


def _digits(half: float) -> int:
    """Decimals at which an uncertainty has a digit above 3, or two: 0.05 has two, 1.7 one, 3.5 none."""
    return max(0, math.ceil(-math.log10(half / 3.0))) if math.isfinite(half) and half > 0 else 2
