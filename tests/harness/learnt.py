"""What the data taught, as a learned model leaves it after some minutes: nine parameters, three regions."""

from __future__ import annotations

from math import exp

from fieldkit.model.learnt import Learnt, LearntParameter

# name, unit, prior median and standard deviation, whether that is of the logarithm, value, share of prior
_TAUGHT = (
    ("gain", "", 1.0, 0.09, False, 0.94, 0.35),
    ("exchange", "W m⁻² K⁻¹", 15.0, 0.5, True, 21.4, 0.2),
    ("thermal_inertia", "J m⁻² K⁻¹ s⁻½", 570.0, 0.25, True, 520.0, 0.3),
    ("depth", "cm", 3.0, 0.5, True, 3.6, 0.55),
    ("diffuse", "", 1.0, 0.4, False, 1.1, 0.7),
    ("circumsolar", "", 0.5, 0.4, False, 0.55, 0.95),
    ("longwave", "W/m²", 0.0, 30.0, False, -8.0, 0.8),
    ("air", "K", 0.0, 8.0, False, 1.2, 0.25),
    ("gusts", "W m⁻² K⁻¹", 1.5, 0.7, True, 2.2, 0.4),
)


def learnt(after_minutes: int = 60) -> Learnt:
    """What is known after so many minutes: nothing at first, and `_TAUGHT` after an hour."""
    done = min(1.0, after_minutes / 60)
    residual_k = {"flat": 0.05, "b15": 0.06, "b25": 0.071}
    return Learnt(
        tuple(_parameter(*one, done=done) for one in _TAUGHT),
        residual_k,
        {"flat": 0.03, "b15": -0.08, "b25": 0.41},
        1.07,
    )


def _parameter(
    name: str, unit: str, prior: float, sd: float, of_log: bool, value: float, share: float, *, done: float
) -> LearntParameter:
    share = 1.0 - done * (1.0 - share)
    value = prior + done * (value - prior)
    return LearntParameter(
        name, unit, *_interval(prior, sd, of_log), *_interval(value, sd * share, of_log), share
    )


def _interval(median: float, sd: float, of_log: bool) -> tuple[float, float, float]:
    half = 1.645 * sd
    return (
        (median, median * exp(-half), median * exp(half))
        if of_log
        else (median, median - half, median + half)
    )
