"""The component of a slope along the sun, which one instant gives.

One minute measures one cosine, that between normal and sun, while a slope has two components. Of a normal
that leans by `p` (a sine) across the sun's azimuth and by the tilt `t` within it, a design vector `u` of
zenith angle Z has ``n . u = |u| sqrt(1 - p**2) cos(Z - t)``. So `t` is known but for the lean, which makes a
surface seem turned away from the sun whatever its side. The likelihood region covers noise, the stated
systematic uncertainties and leans as the prior of slopes has them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.balance import least_squares_rows
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE
from fieldkit.estimation.region_temperatures import remove_offsets, shifted_temperatures
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.estimation.slopes import shaded_rows
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.confidence import interval_sds
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.facet import tilt_azimuth

EDGE = 25
"""Points along the edge of the region of cosine and lean: its ends are met within one part in a hundred."""
MOST_LEAN = 0.98


@dataclass(frozen=True, slots=True)
class AlongSun:
    """Tilts towards the sun's azimuth in its vertical plane, with their likelihood regions, shape (...).

    Degrees, negative away from the sun; NaN where no tilt within the limit gives the cosine. Where not
    `resolved`, a second tilt beyond the sun fits too and the region reaches to it.
    """

    tilt_deg: FloatArray
    low_deg: FloatArray
    high_deg: FloatArray
    resolved: BoolArray
    azimuth_deg: float


def along_sun(
    design: FloatArray, cosine: FloatArray, cosine_sd: FloatArray, settings: EstimatorSettings
) -> AlongSun:
    """Components of slopes along the sun, from one design vector (3,) (`balance`).

    `cosine` and `cosine_sd`, shape (...), are measured cosines ``n . design`` and their standard
    uncertainties; `settings` give tilt limit, confidence and the prior of slopes.
    """
    zenith, azimuth = (float(angle) for angle in tilt_azimuth(design))
    sds, limit = interval_sds(settings.confidence), settings.tilt_limit_deg
    lean_sd = settings.prior.normal_horizontal_sd
    # leans to both sides add to one end of the region, which half of what it leaves out may exceed
    lean_sds = interval_sds(0.5 * (1.0 + settings.confidence))
    most = min(lean_sds * lean_sd, math.sin(math.radians(limit)), MOST_LEAN)
    angle = np.linspace(0.0, np.pi, EDGE)
    length = float(np.linalg.norm(design))
    measured, spread = np.asarray(cosine) / length, sds * np.asarray(cosine_sd) / length
    edge = measured[..., np.newaxis] + spread[..., np.newaxis] * np.cos(angle)
    edge = edge / np.sqrt(1.0 - (most * np.sin(angle)) ** 2)
    tilt = zenith - _angle_deg(measured)
    low, high = zenith - _angle_deg(edge.min(axis=-1)), zenith - _angle_deg(edge.max(axis=-1))
    beyond = 2.0 * zenith - tilt
    # of two that fit the gentler is likelier by the prior of slopes
    likelier = (np.sin(np.radians(beyond)) ** 2 - np.sin(np.radians(tilt)) ** 2) / lean_sd**2
    resolved = (edge.max(axis=-1) < 1.0) & ((beyond > limit) | (likelier > sds**2))
    high = np.where(resolved, high, 2.0 * zenith - low)
    fits = (measured >= LOWEST_COS_INCIDENCE) & (edge.min(axis=-1) < 1.0) & (np.abs(tilt) <= limit)
    tilt, low, high = (np.where(fits, np.clip(angles, -limit, limit), np.nan) for angles in (tilt, low, high))
    return AlongSun(tilt, low, high, resolved & fits, azimuth)


def _angle_deg(cosine: FloatArray) -> FloatArray:
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def instant_scale_sd(settings: EstimatorSettings) -> float:
    """Relative uncertainty of a cosine's difference: what one instant cannot show is the stored heat."""
    return math.hypot(settings.scale_sd, settings.factor_sd, PAPER_SCALE_SD)


def with_along_sun(
    estimate: SlopeEstimate, history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> SlopeEstimate:
    """An estimate that has too few minutes, with what the last of them gives: the component along the sun.

    It is returned as it is in another state, where its azimuth is known, and where no minute has steady sun
    and frames. Arguments as of `slopes`; the model ``learned`` counts as ``full``.
    """
    if estimate.state is not SlopeState.TOO_FEW:
        return estimate
    columns = RegionColumns(tuple(regions))
    names = [columns.regions[column].name for column in columns.targets]
    target = columns.targets[[names.index(estimate.region)]]
    usable = np.flatnonzero(_is_usable(history, columns, target, settings))
    is_known = settings.azimuth == "known" and math.isfinite(columns.regions[target[0]].azimuth_deg)
    if is_known or not usable.size:
        return estimate
    component = _of_minute(history.at(usable[-1:]), columns, target[0], settings)
    if not np.isfinite(component.tilt_deg):
        return estimate
    tilt, low, high = (float(value) for value in (component.tilt_deg, component.low_deg, component.high_deg))
    reason = (
        f"only the component along the sun: {tilt:.1f}° ({low:.1f}° to {high:.1f}°) "
        f"towards {component.azimuth_deg:.0f}°; another hour gives the rest"
    )
    return replace(
        estimate,
        along_sun_deg=tilt,
        along_sun_low_deg=low,
        along_sun_high_deg=high,
        sun_azimuth_deg=component.azimuth_deg,
        reason=f"{estimate.reason}; {reason}",
    )


def _is_usable(
    history: History, columns: RegionColumns, target: IntArray, settings: EstimatorSettings
) -> BoolArray:
    """Minutes (n,) with steady sun on the target and a reference, and frames of both."""
    kelvin = np.isfinite(history.temperature_k)
    seen = kelvin[:, target[0]] & kelvin[:, columns.references].any(axis=1)
    steady = (history.flags & int(Quality.CLOUD)) == 0
    high = history.sun[:, 2] >= math.sin(math.radians(settings.low_sun_deg))
    lit = ~shaded_rows(history, columns, target)[:, 0] & (history.dni_w_m2 > 0.0)
    return np.asarray(seen & steady & high & lit)


def _of_minute(
    minute: History, columns: RegionColumns, target: np.int64, settings: EstimatorSettings
) -> AlongSun:
    settings = replace(settings, model="full") if settings.model == "learned" else settings
    corrected = remove_offsets(minute, columns.regions, settings)
    shifted = shifted_temperatures(corrected.temperature_k, columns.regions, settings)
    rows = least_squares_rows(corrected, 0, columns, settings, shifted)
    place = int(np.flatnonzero(columns.targets == target)[0])
    cosine, design = rows.y[0, place], rows.design[0]
    scaled = instant_scale_sd(settings) * (cosine - rows.reference @ design)
    parts = (rows.sigma[0, place], scaled, *rows.systematics[:, 0, place])
    return along_sun(design, cosine, np.asarray(np.linalg.norm(parts)), settings)
