"""Guidance while an emissivity is measured: how good it is in degrees of tilt, and what would make it better.

An emissivity that regions share shifts them alike, so what counts is the difference that it leaves between
a bed and the reference, over the bed's kelvin per degree. Pure: readings, fit and minute in, words out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fieldkit.calibration.emissivity import Emissivity
from fieldkit.calibration.steady_pairs import BLOCK_S, MAX_BLOCKS, Readings, best_lag_s, drift_k_min
from fieldkit.config import Config
from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.region_temperatures import difference_k
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import kelvin_per_degree
from fieldkit.model.durations import rounded_duration
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import STEEP_SHARE
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import normal

APART_K = 5.0
"""Steady temperatures closer than this count as one."""
TREND_NS = 600_000_000_000
"""Length of the interval whose drift is extrapolated."""
LONGEST_WAIT_S = 4.0 * 3600.0
ENOUGH = 0.25
"""Share of the half-width of a slope that is ok which an emissivity may cost; it adds 3 % to the rest."""

Advice = tuple[str, dict[str, Any]]
"""A line for the terminal, and its values for the page."""


def advice_on_probe(
    readings: Readings, levels_k: Sequence[float], settings: EstimatorSettings
) -> Iterator[Advice]:
    """A probe too deep, and the time to the next temperature 5 K from those that were steady (n,)."""
    if depth_mm := round(probe_depth_mm(readings, settings)):
        yield f"the probe lags: some {depth_mm} mm of sand over it; lift it to one layer of grains", {}
    if math.isfinite(wait_s := seconds_to_next(readings, levels_k)):
        yield f"the next temperature in {rounded_duration(wait_s)} at this drift", {"next_s": round(wait_s)}


def advice_on_result(fit: Emissivity, minute: Minute, beds: Sequence[Region], config: Config) -> Advice:
    """The emissivity so far (k = 2), the tilt that its uncertainty is worth, and what is left to do."""
    settings = config.estimator_settings()
    words = f"emissivity {fit.value:.2f} ± {fit.expanded:.2f} (k=2)"
    values: dict[str, Any] = {"emissivity": round(fit.value, 3), "expanded": round(fit.expanded, 3)}
    region, tilt_deg, degrees = tilt_effect(fit, minute, beds, settings)
    if not math.isfinite(degrees):
        return words, values
    excess = degrees / (ENOUGH * max(settings.target_half_width_deg, STEEP_SHARE * tilt_deg))
    values |= {"region": region, "tilt_deg": round(degrees, 1), "enough": "yes" if excess <= 1.0 else "no"}
    step = "enough" if excess <= 1.0 else remedy(fit, excess)
    return f"{words}, that is ±{degrees:.1f}° of {region}: {step}", values


def tilt_effect(
    fit: Emissivity, minute: Minute, beds: Sequence[Region], settings: EstimatorSettings
) -> tuple[str, float, float]:
    """The steepest bed, its tilt, and that which the uncertainty (k = 2) is worth; NaN where that is open.

    By eq. (6) of a minute, at the given slopes, or else at estimated ones.
    """
    targets = {bed.name: bed for bed in beds if bed.kind is RegionKind.TARGET}
    reference = next((bed for bed in beds if bed.kind is RegionKind.REFERENCE), None)
    slopes = [(bed.tilt_deg, bed.azimuth_deg, name) for name, bed in targets.items()]
    slopes += [(slope.tilt_deg, slope.azimuth_deg, slope.region) for slope in minute.estimates]
    slopes = [slope for slope in slopes if slope[0] >= 0.0 and slope[2] in targets]
    if reference is None or not slopes or not minute.dni_w_m2 > 0.0:
        return "", math.nan, math.nan
    tilt, azimuth, name = max(slopes)
    of_bed, of_reference = (
        np.array([minute.temperature_k.get(region, math.nan)]) for region in (name, reference.name)
    )
    uncertain = replace(settings, emissivity_sd=fit.expanded, own_emissivity_sd={})
    shift_k = difference_k(of_bed, of_reference, targets[name], reference, uncertain)
    sun = normal(minute.sun_zenith_deg, minute.sun_azimuth_deg)
    per_kelvin = irradiance_per_kelvin(of_bed, settings.surface) / minute.dni_w_m2
    return name, tilt, float(shift_k[0]) / abs(kelvin_per_degree(tilt, azimuth, sun, float(per_kelvin[0])))


def remedy(fit: Emissivity, excess: float) -> str:
    """Remedy for an emissivity whose uncertainty is too large by a factor `excess`."""
    needed, scatter = (fit.standard_uncertainty / excess) ** 2, fit.budget[0].effect ** 2
    rest = fit.standard_uncertainty**2 - scatter
    if needed <= rest:
        return f"more minutes do not help; largest contribution: {fit.largest.name}"
    more = max(1, round((fit.freedom + 1) * (scatter / (needed - rest) - 1.0)))
    return f"{rounded_duration(more * MAX_BLOCKS * BLOCK_S)} more of steady readings"


def seconds_to_next(readings: Readings, levels_k: Sequence[float]) -> float:
    """Seconds until the probe, drifting as now, is 5 K from every level (n,); NaN if not within hours."""
    recent = readings.contact_ns > int(readings.contact_ns[-1]) - TREND_NS
    drift = drift_k_min(readings.contact_ns[recent], readings.contact_k[recent]) or math.nan
    sides = (level + math.copysign(APART_K, drift) for level in levels_k)
    free = [side for side in sides if all(abs(side - level) >= APART_K for level in levels_k)]
    waits = (60.0 * (side - float(readings.contact_k[-1])) / drift for side in free)
    return min((wait for wait in waits if 0.0 < wait < LONGEST_WAIT_S), default=math.nan)


def probe_depth_mm(readings: Readings, settings: EstimatorSettings) -> float:
    """Depth of a probe that lags behind the surface in sand, ``sqrt(2 kappa lag)``; 0 without a lag.

    Of a probe 10 and 20 mm deep under a board's shadow every 40 min it is 12 and 18 mm; one less than 8 mm
    deep has a lag that does not show.
    """
    late_s, sand = max(0.0, -(best_lag_s(readings) or 0.0)), settings.slab
    return 1e3 * math.sqrt(2.0 * sand.conductivity_w_m_k / sand.heat_capacity_j_m3_k * late_s)
