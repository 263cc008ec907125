"""Offset of a clock, against times read elsewhere or against the sun.

The offset is what must be added to recorded times. Against the sun, the logarithm of a light meter's
reading, ``a + log sin(h) - k m(h)`` with h the sun's elevation and m the air mass, is fitted with a shift of
time; three clear hours determine it to some minutes, enough to detect a wrong zone or a forgotten daylight
saving time. That is the law of global irradiance of P. Ineichen and R. Perez, "A new airmass independent
formulation for the Linke turbidity coefficient", Solar Energy 73, 151-157, 2002.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from fieldkit.calibration.uncertainty import Budgeted, Contribution, combined_uncertainty
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Site
from fieldkit.model.units import DAY_S
from fieldkit.physics.daylight import air_mass
from fieldkit.physics.sun import sun_vectors

LOWEST = 0.15
"""Sine of the sun's elevation (8.6 degrees) below which sky light and horizon decide what a meter reads."""
HORIZON = 0.01
"""Least sine of the elevation in the law: a shift that puts the sun below is far off anyway."""
DARK_LX = 1000.0
ROLLOVER_S = 1024 * 7 * DAY_S
"""GPS counts weeks in ten bits: an old receiver's date jumps back by 1024 weeks (IS-GPS-200)."""
LONGEST_S = 14 * 3600.0
FIRST_STEP_S = 900.0
MIN_SPAN_S = 3600.0
MIN_READINGS = 20
WORST_SCATTER = 0.05
CORRELATED_NS = 300e9
"""Readings closer than this have correlated errors."""
LEVEL_SD_DEG = 0.5
"""Standard uncertainty of a bubble level on a meter's case."""
HAZE_SD = 0.006
"""Half of the change of k, 0.04 per unit of Linke turbidity, in a session: 0.3 units from first to last."""
LAW_SD = 0.008
"""Curvature of the residuals per factor e of air mass: sun and sky differ in lumens per watt.

A parabola of this size is what Perez's efficacies, or Littlefair's constant ones, leave of a clear sky.
"""
MIN_HAZE, MAX_HAZE = 0.02, 0.8
SKY_SD = 0.004
"""Scatter about the law that a clear sky itself has: the best shift may fit better than the true one.

Alamosa, 2016-01-01: 0.002 to 0.005 at its own times, of beam and diffuse light in windows of two hours.
"""
FARTHEST_S, FAR_STEP_S = 5400.0, 150.0


@dataclass(frozen=True, slots=True)
class ClockOffset(Budgeted):
    """Seconds to add to recorded times, with their uncertainty budget; `readings` were used."""

    offset_s: float
    budget: tuple[Contribution, ...]
    readings: int


def offset_from_times(own_ns: IntArray, true_ns: IntArray, reading_sd_s: float, source: str) -> ClockOffset:
    """Median offset, with its budget, against another clock read at the same moments.

    `own_ns` and `true_ns` are times (n,) by the recording computer and by the other clock, `source` its name
    for messages. `reading_sd_s` is the standard uncertainty of one pair's simultaneity, common to all: half a
    second by hand, 0.3 s for a receiver's sentences. Raises `CalibrationError` without a pair, if the clocks
    differ by changing amounts, or after a GPS week rollover.
    """
    if own_ns.size == 0:
        raise CalibrationError("no pair of readings of both clocks", fix="read the other clock once")
    apart_s = (true_ns - own_ns) / 1e9
    rollovers = round(float(np.median(apart_s)) / ROLLOVER_S)
    if rollovers and abs(np.median(apart_s) - rollovers * ROLLOVER_S) < DAY_S:
        raise CalibrationError(
            f"{abs(1024 * rollovers)} weeks off: its count of weeks has rolled over",
            place=source,
            fix="update the receiver's firmware, or compare with a phone: " + Action.HOST_CLOCK(),
        )
    scatter = float(np.std(apart_s)) if own_ns.size > 1 else 0.0
    if scatter > 10.0:
        raise CalibrationError(
            f"the clocks differ by {apart_s.min():+.0f} to {apart_s.max():+.0f} s: one was stepped",
            fix=Action.CHECK() + " shows when; compare them again after that",
        )
    drift_s = _change(apart_s[np.argsort(own_ns, kind="stable")])
    budget: tuple[Contribution, ...] = (
        Contribution("scatter", scatter, "s", "A", scatter / own_ns.size**0.5),
        Contribution(f"reading the {source}", reading_sd_s, "s", "B", reading_sd_s),
    )
    if drift_s:  # one offset for all times is half of it wrong at either end; rectangular
        budget += (Contribution("drift of the clocks", drift_s, "s", "B", drift_s / 2.0 / math.sqrt(3.0)),)
    return ClockOffset(float(np.median(apart_s)), budget, int(own_ns.size))


def offset_from_sun(time_ns: IntArray, illuminance_lx: FloatArray, site: Site) -> ClockOffset:
    """Offset at which a horizontal light meter, read over an hour or more, fits the sun's elevation.

    Of readings (n,) in lx at recorded times (n,), only those with the sun above 8.6 degrees count, and those
    darker than the rest (clouds) are excluded. Raises `CalibrationError` if illuminance does not determine
    the time.
    """
    is_light = np.isfinite(illuminance_lx) & (illuminance_lx > DARK_LX)
    light = _ClearSkyFit(time_ns[is_light], np.log(illuminance_lx[is_light]), site)
    _refuse_short(light.time_ns, "less than an hour of daylight")
    shift_s = light.coarse_shift_s()
    high = clear = np.ones(light.time_ns.size, np.bool_)
    for _ in range(4):
        high = light.height(shift_s) > LOWEST
        _refuse_short(light.time_ns[high], "less than an hour of daylight with the sun above 9°")
        chosen = high & clear if (high & clear).sum() >= MIN_READINGS else high
        shift_s, residual = light.fit(shift_s, chosen)
        clear = residual > -3.0 * max(0.01, float(np.median(np.abs(residual[chosen]))))
    chosen = high & clear
    scatter = float(np.std(residual[chosen])) if chosen.any() else np.inf
    if scatter > WORST_SCATTER or chosen.sum() < MIN_READINGS:
        raise CalibrationError(
            f"illuminance scatters by {scatter:.0%} about a clear sky: clouds, or a shaded meter",
            fix="use a session under a clear sky, or compare with a phone: " + Action.HOST_CLOCK(),
        )
    return ClockOffset(shift_s, light.budget(shift_s, chosen, scatter), int(chosen.sum()))


def _change(apart_s: FloatArray) -> float:
    """Change of offsets (n,) from the first third to the last, by their medians; 0 for fewer than three."""
    third = apart_s.size // 3
    return abs(float(np.median(apart_s[-third:]) - np.median(apart_s[:third]))) * 1.5 if third else 0.0


def _refuse_short(time_ns: IntArray, what: str) -> None:
    if time_ns.size < MIN_READINGS or np.ptp(time_ns) < MIN_SPAN_S * 1e9:
        raise CalibrationError(
            "the sun does not determine the time",
            place=what,
            fix="use a session of three hours or more about noon, or a phone: " + Action.HOST_CLOCK(),
        )


@dataclass(frozen=True, slots=True)
class _ClearSkyFit:
    """Logarithms of a horizontal meter's readings (n,) and the law of a clear sky that they should follow."""

    time_ns: IntArray
    log_light: FloatArray
    site: Site

    def sun(self, shift_s: float) -> FloatArray:
        """Unit vectors (n, 3) to the sun for times shifted by `shift_s`."""
        return sun_vectors(self.time_ns + round(shift_s * 1e9), self.site, refraction=True)

    def height(self, shift_s: float) -> FloatArray:
        """Sine of the sun's elevation, (n,)."""
        return np.asarray(self.sun(shift_s)[:, 2])

    def coarse_shift_s(self) -> float:
        """The multiple of 15 minutes at which the law of a clear sky fits best."""
        shifts = np.arange(-LONGEST_S, LONGEST_S + 1.0, FIRST_STEP_S)
        return float(shifts[int(np.argmin([self._misfit(float(shift)) for shift in shifts]))])

    def _misfit(self, shift_s: float) -> float:
        """Mean deviation at one shift with the best haze; the sun is never taken as below the horizon."""
        height = np.maximum(self.height(shift_s), HORIZON)
        y, mass = self.log_light - np.log(height), air_mass(height, self.site.elevation_m)
        above_air = y + _haze(mass, y) * mass
        return float(np.mean(np.abs(above_air - np.median(above_air))))

    def fit(self, start_s: float, used: BoolArray) -> tuple[float, FloatArray]:
        """Best shift near a first guess by the readings `used`, and the residuals of all (n,)."""
        begin = [0.0, float(self.log_light.max()), 0.2]
        bounds = ([-2.0, 5.0, MIN_HAZE], [2.0, 20.0, MAX_HAZE])

        def residuals(unknown: FloatArray) -> FloatArray:
            return self._residuals(unknown, start_s)[used]

        fit = least_squares(residuals, begin, bounds=bounds)
        return start_s + float(fit.x[0]) * FIRST_STEP_S, self._residuals(fit.x, start_s)

    def _residuals(self, unknown: FloatArray, start_s: float) -> FloatArray:
        """Residuals of the logarithm of illuminance; unknowns are the shift in steps, a and k."""
        height = np.maximum(self.height(start_s + float(unknown[0]) * FIRST_STEP_S), HORIZON)
        mass = air_mass(height, self.site.elevation_m)
        return np.asarray(self.log_light - (unknown[1] + np.log(height) - unknown[2] * mass))

    def budget(self, shift_s: float, used: BoolArray, scatter: float) -> tuple[Contribution, ...]:
        """Scatter, effects of a meter out of level, changing haze and the law; other shifts that fit."""
        sun, later = self.sun(shift_s)[used], self.height(shift_s + 1.0)[used]
        mass, later_mass = (air_mass(height, self.site.elevation_m) for height in (sun[:, 2], later))
        k = float(np.clip(-np.polyfit(mass, self.log_light[used] - np.log(sun[:, 2]), 1)[0], 0.0, MAX_HAZE))
        per_second = np.log(later / sun[:, 2]) - k * (later_mass - mass)
        # the shift's row of the least squares solution: seconds per unit of error of each logarithm
        gain = np.linalg.pinv(np.column_stack([per_second, np.ones_like(mass), -mass]))[0]
        correlated = max(1.0, used.sum() * CORRELATED_NS / np.ptp(self.time_ns[used]))
        east_north = gain @ (sun[:, :2] / sun[:, 2:])
        elapsed = np.interp(self.time_ns[used], self.time_ns[used][[0, -1]], [-1.0, 1.0])
        level = float(np.radians(LEVEL_SD_DEG) * np.hypot(*east_north))
        haze = HAZE_SD * float(gain @ (elapsed * mass))
        place = np.interp(mass, [mass.min(), mass.max()], [-1.0, 1.0])
        law = LAW_SD * float(np.log(mass.max() / mass.min()) * (gain @ place**2))
        noise = scatter * float(np.sqrt(correlated) * np.linalg.norm(gain))
        near = (
            Contribution("scatter of the light", scatter, "1", "A", noise),
            Contribution("level of the meter", LEVEL_SD_DEG, "deg", "B", level),
            Contribution("haze that changes", HAZE_SD, "1", "B", haze),
            Contribution("law of a clear sky", LAW_SD, "1", "B", law),
        )
        # the slopes at the best shift say nothing of others, which haze makes fit on one side of noon;
        # anywhere up to the farthest, rectangular, of which the slopes have explained a part
        farthest_s = self._farthest_s(shift_s, used, math.hypot(scatter, SKY_SD))
        beyond = max(0.0, farthest_s**2 / 3.0 - combined_uncertainty(near) ** 2)
        return (*near, Contribution("other times that fit", farthest_s, "s", "B", math.sqrt(beyond)))

    def _farthest_s(self, shift_s: float, used: BoolArray, scatter: float) -> float:
        """Distance to the farthest shift at which readings scatter no more, with the best haze for it."""
        away = np.arange(-FARTHEST_S, FARTHEST_S + 1.0, FAR_STEP_S)
        fits = [abs(float(far)) for far in away if self._scatter(shift_s + float(far), used) <= scatter]
        return max(fits, default=0.0)

    def _scatter(self, shift_s: float, used: BoolArray) -> float:
        """Scatter of the readings for which the sun is high at a shift; infinite where they are too few."""
        height = self.height(shift_s)
        high = used & (height > LOWEST)
        if high.sum() < MIN_READINGS:
            return np.inf
        y, mass = self.log_light[high] - np.log(height[high]), air_mass(height[high], self.site.elevation_m)
        return float(np.std(y + _haze(mass, y) * mass))


def _haze(mass: FloatArray, y: FloatArray) -> float:
    """The best haze k of ``a - k m``, within its bounds."""
    slope = np.polyfit(mass, y, 1)[0] if np.ptp(mass) > 1e-6 else 0.0
    return float(np.clip(-slope, MIN_HAZE, MAX_HAZE))
