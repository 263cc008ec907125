"""From minute bins to rows ``y = n . u + error``: the surface model, paper's or full.

Both models say that heat leaving a bed, less that leaving the reference, is sunlight that
depends on the normal *linearly*. The paper's eq. (6) has the direct beam alone. The full
model (`sky` and `slab` of the physics) adds diffuse light (isotropic, or Hay and Davies),
light and long wave from flat ground around, and heat conducted into the layer. Since a
facet sees ``(1 + n_z) / 2`` of the sky, all of it is ``n . v`` plus what is the same for every
normal, with

    v = (1 - A) (S + D A_i / s_z) s  +  z k
    k = (1 - A) (D (1 - A_i) - A_g G) / 2  -  e (L_g - L) / 2

(A_i = S / S_0 the circumsolar share, A_g the ground's albedo, L_g its long wave). So the
same least squares solves both, with an effective lamp ``u = v / V``.

Temperatures in kelvin, fluxes in W/m2 of heat, minutes in rows, regions in columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.daylight import extraterrestrial
from fieldkit.physics.energy_balance import STEFAN_BOLTZMANN
from fieldkit.physics.facet import VERTICAL, FloatArray
from fieldkit.physics.slab import Slab, conducted_flux

MINUTE_S = 60.0
SMOOTHED_MINUTES = 5
UNSTEADY = 0.1
"""Relative change of the light from minute to minute that doubles the variance of a row."""
# quadratic through five minutes: row i gives the smoothed value at the i-th of them
_PARABOLAS = np.vander(np.arange(SMOOTHED_MINUTES) - SMOOTHED_MINUTES // 2, 3).astype(np.float64)
_SMOOTHER: FloatArray = _PARABOLAS @ np.linalg.pinv(_PARABOLAS)


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of the least squares for the minutes (n,) of a window and the targets (m,).

    `design` (n, 3); `y` (n, m), measured cosine of incidence; `sigma` (n, m), its standard
    deviation by the stated noise; `per_kelvin` (n, m), how y grows with the target's
    temperature; `per_w_m2` (n,), how it grows with a difference of sunlight on the bed;
    `systematics` (p, n, m), how it moves with one standard deviation of each thing that is only
    known so well: offset between regions and its drift, exchange with the air, with the full model
    conductivity and heat capacity of the layer, and emissivities with a stated uncertainty.
    `reference` (3,) is the mean normal of the references. NaN where a minute says nothing.
    """

    design: FloatArray
    y: FloatArray
    sigma: FloatArray
    per_kelvin: FloatArray
    per_w_m2: FloatArray
    systematics: FloatArray
    reference: FloatArray


def rows(
    history: History,
    first: int,
    references: NDArray[np.int64],
    targets: NDArray[np.int64],
    normals: FloatArray,
    settings: EstimatorSettings,
    moved_k: Iterable[FloatArray] = (),
) -> Rows:
    """Rows of the minutes from index `first` of the history on.

    Parameters
    ----------
    history
        Bins from the start of the session: conduction remembers what was before the window.
    first
        Index of the window's first minute.
    references, targets
        Columns of the regions. References that were never measured are left out; several
        are averaged.
    normals
        Unit normals of the references, shape (len(references), 3).
    settings
        Surface, model and noise.
    moved_k
        Temperatures (n, regions) were one thing that shifts them a standard uncertainty higher, for each.
    """
    kept = np.isfinite(history.temperature_k[first:, references]).any(axis=0)
    kept |= not kept.any()  # none measured: all of them, whose mean is NaN without a warning
    base = history.temperature_k[:, references[kept]]
    warm = history.temperature_k[:, targets]
    heat = _lost(warm, settings) - np.mean(_lost(base, settings), axis=1, keepdims=True)
    beam, ground = _lamp(history, np.mean(base, axis=1), settings)
    design = history.sun + (ground / beam)[:, np.newaxis] * VERTICAL
    reference = normals[kept].mean(axis=0)
    steepness, rise = _lost_per_kelvin(warm, settings), np.zeros_like(warm)
    over = warm - np.mean(base, axis=1, keepdims=True)
    exchange = settings.surface.exchange_w_m2_k * settings.exchange_sd * _trend(over, first)
    drift = settings.drift_sd_k_per_h * (history.minute - history.minute[first:].mean()) / 60.0
    systematics = [settings.offset_sd_k * steepness, drift[:, np.newaxis] * steepness, exchange]
    amplification = np.zeros(1)
    if settings.model == "full":
        rise = conducted(history.minute, over, settings.slab)
        systematics += [conducted(history.minute, over, slab) - rise for slab in _doubtful_slabs(settings)]
        amplification = _smoothed_kernel(settings.slab)
    for moved in moved_k:
        other, other_base = moved[:, targets], moved[:, references[kept]]
        shift = _lost(other, settings) - np.mean(_lost(other_base, settings), axis=1, keepdims=True) - heat
        if settings.model == "full":
            further = other - np.mean(other_base, axis=1, keepdims=True)
            shift += conducted(history.minute, further, settings.slab) - rise
        systematics.append(shift)
    scale = (beam * settings.scale)[:, np.newaxis]
    noise = settings.noise_k * np.sqrt(1.0 + 1.0 / max(1, int(kept.sum())))
    direct = steepness + amplification[0]
    loud = np.sqrt(direct**2 + np.sum(amplification[1:] ** 2))
    window = slice(first, None)
    return Rows(
        design[window],
        ((heat + rise) / scale + (design @ reference)[:, np.newaxis])[window],
        (noise * loud * _unsteadiness(history.dni_w_m2)[:, np.newaxis] / scale)[window],
        (steepness / scale)[window],
        ((1.0 - settings.surface.albedo) / scale[:, 0])[window],
        (np.stack(systematics) / scale)[:, window],
        reference,
    )


def _unsteadiness(dni_w_m2: FloatArray) -> FloatArray:
    """How much less a minute says when the light changes within it (n,): 1 when steady.

    A tenth more or less than a neighbouring minute doubles the variance: means over a
    minute no longer tell when the light came, and the ground answers to that.
    """
    change = np.abs(np.diff(dni_w_m2, prepend=np.nan, append=np.nan))
    largest = np.fmax(change[:-1], change[1:])
    relative = np.nan_to_num(largest / np.maximum(dni_w_m2, 1.0))
    return np.asarray(np.sqrt(1.0 + (relative / UNSTEADY) ** 2))


def _lost(temperature_k: FloatArray, settings: EstimatorSettings) -> FloatArray:
    """Heat a surface gives off by radiation and air, less what all surfaces share, W/m2."""
    surface = settings.surface
    emitted = surface.emissivity_broadband * STEFAN_BOLTZMANN * temperature_k**4
    return np.asarray(emitted + surface.exchange_w_m2_k * temperature_k)


def _lost_per_kelvin(temperature_k: FloatArray, settings: EstimatorSettings) -> FloatArray:
    surface = settings.surface
    emitted = 4.0 * surface.emissivity_broadband * STEFAN_BOLTZMANN * temperature_k**3
    return np.asarray(emitted + surface.exchange_w_m2_k)


def _lamp(
    history: History, reference_k: FloatArray, settings: EstimatorSettings
) -> tuple[FloatArray, FloatArray]:
    """Absorbed light along the sun vector (n,) and along the vertical (n,), W/m2; NaN without sun."""
    surface = settings.surface
    cos_zenith = np.where(history.sun[:, 2] > 0.0, history.sun[:, 2], np.nan)
    beam = np.where(history.dni_w_m2 > 0.0, history.dni_w_m2, np.nan)
    absorbed = 1.0 - surface.albedo
    if settings.model == "paper":
        return absorbed * beam, np.zeros_like(beam)
    around = settings.diffuse_fraction / (1.0 - settings.diffuse_fraction) * beam * cos_zenith
    diffuse = np.where(np.isnan(history.dhi_w_m2), around, history.dhi_w_m2)
    whole = beam * cos_zenith + diffuse
    circumsolar = np.zeros_like(beam)
    if settings.sky == "hay-davies":
        circumsolar = np.clip(beam / extraterrestrial(history.time_ns), 0.0, 1.0)
    measured = history.longwave_down_w_m2
    longwave = np.where(np.isnan(measured), settings.longwave_down_w_m2, measured)
    grey = surface.emissivity_broadband
    warmth = grey * STEFAN_BOLTZMANN * reference_k**4 + (1.0 - grey) * longwave
    light = absorbed * (diffuse * (1.0 - circumsolar) - settings.ground_albedo * whole) / 2.0
    return (
        absorbed * (beam + diffuse * circumsolar / cos_zenith),
        light - grey * (warmth - longwave) / 2.0,
    )


def _trend(values: FloatArray, first: int) -> FloatArray:
    """Parabolas through the columns from row `first` on, NaN before.

    A doubt about a coefficient may not be fitted to the noise of what it multiplies: that
    would always prefer a smaller one.
    """
    trend = np.full_like(values, np.nan)
    parabolas = np.vander(np.linspace(-1.0, 1.0, len(values) - first), 3)
    for column, window in enumerate(values[first:].T):
        known = np.isfinite(window)
        if known.any():
            fitted = np.linalg.lstsq(parabolas[known], window[known])[0]
            trend[first:, column] = parabolas @ fitted
    return trend


def _doubtful_slabs(settings: EstimatorSettings) -> list[Slab]:
    """The layer with its conductivity, and with its heat capacity, one standard deviation up."""
    slab = settings.slab
    return [
        replace(slab, conductivity_w_m_k=slab.conductivity_w_m_k * (1.0 + settings.conductivity_sd)),
        replace(slab, heat_capacity_j_m3_k=slab.heat_capacity_j_m3_k * (1.0 + settings.capacity_sd)),
    ]


def conducted(minutes: NDArray[np.int64], difference_k: FloatArray, slab: Slab) -> FloatArray:
    """Heat flux into the layer less that into the reference's, W/m2, shape of `difference_k`.

    `difference_k` (n, m) is surface over reference at the `minutes` (n,), increasing; NaN where unknown.
    Missing minutes are bridged by straight lines.
    """
    steps = np.arange(minutes[0], minutes[-1] + 1)
    is_known = np.isfinite(difference_k)
    columns = np.flatnonzero(np.count_nonzero(is_known, axis=0) >= SMOOTHED_MINUTES)
    flux = np.full_like(difference_k, np.nan)
    if columns.size:
        bridged = [
            _smooth(np.interp(steps, minutes[known], values[known]))
            for known, values in zip(is_known.T[columns], difference_k.T[columns], strict=True)
        ]
        # all columns in one transform: this is called once per minute bin and layer
        whole = conducted_flux(slab, np.column_stack(bridged), MINUTE_S)
        flux[:, columns] = whole[minutes - minutes[0]]
    return np.where(is_known, flux, np.nan)


def _smooth(values: FloatArray) -> FloatArray:
    """Quadratic through five neighbours, at the ends through the first and last five."""
    if values.size < SMOOTHED_MINUTES:
        return values
    half = SMOOTHED_MINUTES // 2
    middle = np.convolve(values, _SMOOTHER[half], mode="valid")
    head, tail = _SMOOTHER @ values[:SMOOTHED_MINUTES], _SMOOTHER @ values[-SMOOTHED_MINUTES:]
    return np.concatenate([head[:half], middle, tail[-half:]])


@lru_cache(maxsize=16)
def _smoothed_kernel(slab: Slab) -> FloatArray:
    """How one noisy minute enters the flux of its own and of neighbouring minutes, W/m2 per kelvin.

    Its own first.
    """
    pulse = np.zeros(6 * SMOOTHED_MINUTES)
    pulse[2 * SMOOTHED_MINUTES] = 1.0
    answer = conducted_flux(slab, _smooth(pulse), MINUTE_S)[1:]
    own = 2 * SMOOTHED_MINUTES - 1
    return np.concatenate([answer[own : own + 1], np.delete(answer, own)])
