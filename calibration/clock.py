"""How far a clock is off: against times read elsewhere, or against the sun.

The offset is what must be added to the recorded times. Against the sun the logarithm of a light meter's
reading, ``a + log sin(h) - k / sin(h)`` with h the sun's height, is fitted with a shift of time; three clear
hours tell it to some minutes, enough to catch a wrong zone or a forgotten daylight saving time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from fieldkit.calibration.budget import COVERAGE_FACTOR, Contribution, combined
from fieldkit.errors import CalibrationError
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.sun import sun_vectors
from fieldkit.site import Site

LOWEST = 0.15
"""Sine of the sun's height below which the simple law of the air no longer holds."""
LONGEST_S = 14 * 3600.0
FIRST_STEP_S = 900.0
MIN_SPAN_S = 3600.0
WORST_SCATTER = 0.05
MODEL_SD_S = 120.0
"""What a changing haze and a tilted meter do to the best shift."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Seconds to add to recorded times, with the budget of that; `readings` were used."""

    offset_s: float
    budget: tuple[Contribution, ...]
    readings: int

    @property
    def standard_uncertainty_s(self) -> float:
        """Standard uncertainty, all contributions together."""
        return combined(self.budget)

    @property
    def expanded_s(self) -> float:
        """Expanded uncertainty, k = 2."""
        return COVERAGE_FACTOR * self.standard_uncertainty_s


def offset_from_times(
    own_ns: NDArray[np.int64], true_ns: NDArray[np.int64], reading_sd_s: float, source: str
) -> ClockOffset:
    """The offset against another clock read at the same moments (n,).

    `reading_sd_s` is how well the moments are the same: half a second by hand, 0.3 s of a receiver's
    sentences; it is shared by all. Raises `CalibrationError` without a moment or if the clocks drift apart.
    """
    if own_ns.size == 0:
        raise CalibrationError("no moment at which both clocks were read", fix="read the other clock once")
    apart_s = (true_ns - own_ns) / 1e9
    scatter = float(np.std(apart_s)) if own_ns.size > 1 else 0.0
    if scatter > 10.0:
        raise CalibrationError(
            f"the clocks differ by {apart_s.min():+.0f} to {apart_s.max():+.0f} s: one was stepped",
            fix="fieldkit check shows when; compare them again after that",
        )
    budget = (
        Contribution("scatter", scatter, "s", "A", scatter / own_ns.size**0.5),
        Contribution(f"reading the {source}", reading_sd_s, "s", "B", reading_sd_s),
    )
    return ClockOffset(float(np.median(apart_s)), budget, int(own_ns.size))


def offset_from_sun(time_ns: NDArray[np.int64], illuminance_lx: FloatArray, site: Site) -> ClockOffset:
    """The offset at which a light meter lying flat, read over an hour or more, fits the sun's height.

    Minutes darker than the rest (clouds) are left out. Raises `CalibrationError` where the light does
    not tell the time.
    """
    known = np.isfinite(illuminance_lx) & (illuminance_lx > 1000.0)
    times, light = time_ns[known], illuminance_lx[known]
    if times.size < 20 or np.ptp(times) < MIN_SPAN_S * 1e9:
        raise CalibrationError(
            "less than an hour of daylight: the sun does not tell the time from it",
            fix="take a session of three hours or more, or compare with a phone: --told",
        )
    shifts = np.arange(-LONGEST_S, LONGEST_S + 1.0, FIRST_STEP_S)
    misfits = [_misfit(times, light, site, float(shift)) for shift in shifts]
    start = float(shifts[int(np.argmin(misfits))])
    clear = np.ones(times.size, np.bool_)
    for _ in range(3):
        fit = _fit(times[clear], light[clear], site, start)
        left = _left(np.asarray(fit.x), times, light, site)
        clear = left > -3.0 * max(0.01, float(np.median(np.abs(left[clear]))))
        start = float(fit.x[0]) * FIRST_STEP_S
    left = left[clear]
    scatter = float(np.std(left))
    if scatter > WORST_SCATTER or clear.sum() < 20:
        raise CalibrationError(
            f"the light scatters by {scatter:.0%} about a clear sky's: clouds, or a shaded meter",
            fix="take a clear session, or compare with a phone: --told",
        )
    jacobian = np.asarray(fit.jac, np.float64)
    # neighbouring readings err alike: as many are independent as there are five minutes
    alike = max(1.0, clear.sum() / (np.ptp(times) / 300e9))
    sd = FIRST_STEP_S * scatter * float(np.sqrt(alike * np.linalg.inv(jacobian.T @ jacobian)[0, 0]))
    budget = (
        Contribution("scatter of the light", scatter, "1", "A", sd),
        Contribution("haze and level of the meter", MODEL_SD_S, "s", "B", MODEL_SD_S),
    )
    return ClockOffset(start, budget, int(clear.sum()))


def _left(unknown: FloatArray, times: NDArray[np.int64], light: FloatArray, site: Site) -> FloatArray:
    """What is left of the logarithm of the light; unknown are the shift (in steps), a and k."""
    height = np.maximum(_height(times, site, float(unknown[0]) * FIRST_STEP_S), 1e-3)
    return np.asarray(np.log(light) - (unknown[1] + np.log(height) - unknown[2] / height))


def _height(times: NDArray[np.int64], site: Site, shift_s: float) -> FloatArray:
    return sun_vectors(times + round(shift_s * 1e9), site, refraction=True)[:, 2]


def _misfit(times: NDArray[np.int64], light: FloatArray, site: Site, shift_s: float) -> float:
    """Root mean square at one shift with the best haze; infinite where bright light would have no sun."""
    height = _height(times, site, shift_s)
    if (height < LOWEST).any():
        return float("inf")
    y, x = np.log(light / height), 1.0 / height
    k = float(np.clip(-np.polyfit(x, y, 1)[0], 0.05, 0.6))
    return float(np.std(y + k * x))


def _fit(times: NDArray[np.int64], light: FloatArray, site: Site, start_s: float) -> OptimizeResult:
    begin = [start_s / FIRST_STEP_S, float(np.log(light.max())), 0.2]
    return least_squares(
        _left, begin, args=(times, light, site), bounds=([-60.0, 5.0, 0.02], [60.0, 20.0, 0.8])
    )
