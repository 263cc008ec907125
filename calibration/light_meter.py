"""Factor from a light meter's reading to irradiance on its plane, against a reference instrument.

A line through the origin with errors in both coordinates: in the dark both read zero. The reference is a
pyranometer on the same plane, or a pyrheliometer or station whose beam is projected onto the meter's plane,
plus diffuse light as measured or as the configured diffuse model gives it. W/m2, and the reading's own unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldkit.calibration.line import Points, fit_line
from fieldkit.calibration.uncertainty import Budgeted, Contribution
from fieldkit.model.errors import CalibrationError
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.irradiance import IrradianceModel, direct_normal, shares_on_plane

MIN_MINUTES = 10
UNSTEADY = 0.05
"""Relative change between neighbouring minutes beyond which the response times of two instruments matter."""
METER_SD, REFERENCE_NOISE = 0.01, 0.005
COSINE_SD = 0.015
"""Of cosine error and level of the meter, relative and common to all minutes."""
MAX_SCATTER, MIN_CONSISTENT = 0.10, 0.7
"""Minutes farther from the median ratio had a cloud over one instrument; the share that must be nearer."""
MAX_INTERCEPT = 0.05


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
    time_ns: NDArray[np.int64],
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
    kept = np.isfinite(reading) & np.isfinite(plane_w_m2) & (reading > 0.0) & (plane_w_m2 > 20.0)
    kept &= _steady(reading) & _steady(plane_w_m2)
    if kept.sum() < MIN_MINUTES:
        raise CalibrationError(
            f"only {kept.sum()} steady minutes of sun in which both instruments read",
            fix="compare them for half an hour under a clear sky, the sun above 12°; check their clocks",
        )
    ratio = plane_w_m2 / np.where(kept, reading, np.nan)
    consistent = kept & (np.abs(ratio / np.nanmedian(ratio) - 1.0) < MAX_SCATTER)
    if consistent.sum() < MIN_CONSISTENT * kept.sum():
        raise CalibrationError(
            f"the instruments disagree: only {consistent.sum()} of {kept.sum()} minutes fit one factor",
            fix="compare their clocks (time zone?), levels and mounting; is one of them shaded?",
        )
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


def _steady(values: FloatArray) -> NDArray[np.bool_]:
    """Minutes that differ little from both neighbours."""
    with np.errstate(all="ignore"):
        change = np.abs(np.diff(values)) / np.maximum(np.abs(values[1:]), 1e-9)
    calm = np.concatenate([[True], change < UNSTEADY, [True]])
    return np.asarray(calm[1:] & calm[:-1])


def _intercept(points: Points) -> tuple[str, ...]:
    """A note where the free line misses the origin by more than 5 % of the mean."""
    if np.ptp(points.x) < 0.2 * points.x.mean():
        return ()
    free = fit_line(points, origin=False)
    miss = free.intercept / float(points.y.mean())
    if abs(miss) < MAX_INTERCEPT:
        return ()
    return (
        f"a free line misses the origin by {miss:+.0%} of the mean: cosine error, sky share or dark offset",
    )
