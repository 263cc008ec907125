"""Factor from a light meter's reading to irradiance on its plane, against a reference instrument.

A line through the origin with errors in both coordinates: in the dark both read zero. The reference is a
pyranometer on the same plane, or a pyrheliometer or station whose beam is projected onto the meter's plane,
plus diffuse light as measured or as the configured diffuse model gives it. W/m2, and the reading's own unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldkit.calibration.line import Points, fit_line
from fieldkit.calibration.uncertainty import Budgeted, Contribution
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Action
from fieldkit.physics.irradiance import IrradianceModel, direct_normal, shares_on_plane

MIN_MINUTES, DARK_W_M2 = 10, 20.0
UNSTEADY = 0.05
"""Relative change between neighbouring minutes beyond which the response times of two instruments matter."""
METER_SD, REFERENCE_NOISE = 0.01, 0.005
COSINE_SD = 0.015
"""Standard uncertainty by cosine error and level of the meter, relative and common to all minutes."""
MAX_SCATTER, MIN_CONSISTENT = 0.10, 0.7
"""Minutes farther from the median ratio had a cloud over one instrument; the share that must be nearer."""
MAX_INTERCEPT, WORST_INTERCEPT = 0.05, 0.20
MAX_LAG_S, LAG_STEP_S, SIGNIFICANT_LAG_S = 5400.0, 60.0, 90.0
WORST_LAG_S = 900.0
"""Level and cosine error of a meter look like some minutes; a quarter of an hour is a clock's."""
BETTER_LAG, OVERLAP = 2.0, 0.7
"""Factor by which another shift must fit better, with this share of the minutes, to be accepted."""


@dataclass(frozen=True, slots=True)
class LightFactor(Budgeted):
    """W/m2 per unit of the reading, with its budget; `scatter` is relative, `minutes` were used."""

    value: float
    budget: tuple[Contribution, ...]
    scatter: float
    minutes: int
    remarks: tuple[str, ...] = ()


def on_plane(
    model: IrradianceModel,
    dni_w_m2: FloatArray,
    dhi_w_m2: FloatArray | None,
    sun: FloatArray,
    time_ns: IntArray,
) -> FloatArray:
    """Irradiance on the meter's plane from a measured beam, W/m2, shape (n,); NaN where the sun is too low.

    `model` has mounting and diffuse share of the meter, `sun` the unit vectors (n, 3) at UTC nanoseconds
    (n,); without measured diffuse horizontal irradiance the model's share is used.
    """
    if dhi_w_m2 is not None:
        per_beam, per_sky = shares_on_plane(model, sun)
        return np.asarray(dni_w_m2 * per_beam + dhi_w_m2 * per_sky)
    unit = replace(model, kind="calibrated", factor=1.0)
    guess = np.array(dni_w_m2)
    for _ in range(40):  # whole steps would overshoot where the diffuse share depends on the beam (Erbs)
        guess = guess * (dni_w_m2 / direct_normal(unit, guess, sun, time_ns)) ** 0.4
    return guess


def refuse_shifted_clocks(lag_s: float) -> None:
    """Raise `CalibrationError` for a `clock_lag_s` that no level and no cosine error explains."""
    if abs(lag_s) > WORST_LAG_S:
        minutes = f"{lag_s / 60.0:+.0f} min"
        raise CalibrationError(
            f"the clocks differ: the meter fits its reference best with {minutes} added to its times",
            fix=f"is a time zone wrong? import a logger again, {-lag_s:+.0f} s added to its times; for the "
            "session: " + Action.CALIBRATE("clock"),
        )


def clock_lag_s(
    time_ns: IntArray, reading: FloatArray, reference_ns: IntArray, plane_w_m2: FloatArray
) -> float:
    """Seconds to add to a meter's times so that it fits its reference best.

    From minutes (n,) of the meter and (m,) of the reference, which may begin before and end after them.
    Shifts of up to 90 minutes either way are tried. 0 where no shift is twice as good.
    """
    usable = np.isfinite(reading) & (reading > 0.0) & _steady(reading)
    lit = np.isfinite(plane_w_m2) & (plane_w_m2 > DARK_W_M2)
    if usable.sum() < MIN_MINUTES or not lit.any():
        return 0.0
    meter_s, reference_s = ((times - time_ns[0]) / 1e9 for times in (time_ns[usable], reference_ns[lit]))
    steps = round(MAX_LAG_S / LAG_STEP_S)
    lags = LAG_STEP_S * np.arange(-steps, steps + 1)
    shifted = [np.interp(meter_s + lag, reference_s, plane_w_m2[lit], np.nan, np.nan) for lag in lags]
    misfits = np.array([_misfit(plane / reading[usable]) for plane in shifted])
    if not misfits[steps] > BETTER_LAG * misfits.min():
        return 0.0
    best = float(lags[np.argmin(misfits)])
    return best if abs(best) > SIGNIFICANT_LAG_S else 0.0


def _misfit(ratio: FloatArray) -> float:
    """Median relative deviation of ratios (n,) from their median; infinite if too few are known."""
    ratios = ratio[np.isfinite(ratio)]
    if ratios.size < max(MIN_MINUTES, OVERLAP * ratio.size):
        return float("inf")
    return float(np.median(np.abs(ratios / np.median(ratios) - 1.0)))


def with_lag(found: LightFactor, shifted: LightFactor, lag_s: float) -> LightFactor:
    """The factor with the change that a shift of the clocks would make in its budget."""
    effect = shifted.value - found.value
    line = Contribution("clocks or levels that differ", abs(lag_s), "s", "B", effect)
    return replace(found, budget=(*found.budget, line))


def light_factor(
    reading: FloatArray,
    plane_w_m2: FloatArray,
    *,
    reference_sd: float = 0.02,
    diffuse_sd: float = 0.0,
) -> LightFactor:
    """Factor through the origin from minutes of both instruments, with its budget.

    `reading` are the meter's (n,), `plane_w_m2` the irradiance on its plane by the reference (n,). Minutes in
    which either changes by more than 5 %, or a cloud shades one of them, are excluded. The other arguments
    are relative standard uncertainties that all minutes share: of the reference, of the diffuse share. Raises
    `CalibrationError` with fewer than ten steady minutes, or if no single factor fits the two instruments.
    """
    usable = np.isfinite(reading) & np.isfinite(plane_w_m2) & (reading > 0.0) & (plane_w_m2 > DARK_W_M2)
    usable &= _steady(reading) & _steady(plane_w_m2)
    if usable.sum() < MIN_MINUTES:
        raise CalibrationError(
            f"only {usable.sum()} steady minutes of sun in which both instruments read",
            fix="compare them for half an hour under a clear sky, the sun above 12°; check their clocks",
        )
    ratio = plane_w_m2 / np.where(usable, reading, np.nan)
    consistent = usable & (np.abs(ratio / np.nanmedian(ratio) - 1.0) < MAX_SCATTER)
    if consistent.sum() < MIN_CONSISTENT * usable.sum():
        raise _disagreement(f"only {consistent.sum()} of {usable.sum()} minutes fit one factor")
    x, y = reading[consistent], plane_w_m2[consistent]
    points = Points(x, y, METER_SD * x, REFERENCE_NOISE * y)
    line = fit_line(points, origin=True)
    scatter = float(np.std(line.residuals / y))
    value = line.slope
    shared = {
        "reference instrument": reference_sd,
        "cosine and level": COSINE_SD,
        "share of the sky's light": diffuse_sd,
    }
    # errors of neighbouring minutes are correlated, so the scatter is not divided by their number
    budget = (
        Contribution("scatter", scatter, "1", "A", value * scatter),
        *(Contribution(name, sd, "1", "B", value * sd) for name, sd in shared.items() if sd > 0.0),
    )
    return LightFactor(value, budget, scatter, int(consistent.sum()), _intercept(points))


def _steady(values: FloatArray) -> BoolArray:
    """Minutes that differ little from both neighbours."""
    with np.errstate(all="ignore"):
        change = np.abs(np.diff(values)) / np.maximum(np.abs(values[1:]), 1e-9)
    calm = np.concatenate([[True], change < UNSTEADY, [True]])
    return np.asarray(calm[1:] & calm[:-1])


def _intercept(points: Points) -> tuple[str, ...]:
    """A note where the free line misses the origin by more than 5 % of the mean; refused beyond 20 %."""
    if np.ptp(points.x) < 0.2 * points.x.mean():
        return ()
    free = fit_line(points, origin=False)
    miss = free.intercept / float(points.y.mean())
    what = f"a free line misses the origin by {miss:+.0%} of the mean"
    if abs(miss) > WORST_INTERCEPT:
        raise _disagreement(what)
    return (f"{what}: cosine error, sky share or dark offset",) if abs(miss) >= MAX_INTERCEPT else ()


def _disagreement(what: str) -> CalibrationError:
    fix = "compare their clocks (time zone?), levels and mounting; is one of them shaded?"
    return CalibrationError(f"the instruments disagree: {what}", fix=fix)
