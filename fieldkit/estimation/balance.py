"""From minute bins to least-squares rows ``y = n . u + error``: the surface model, paper's or full.

Heat lost by a target less heat lost by the reference equals the difference in absorbed sunlight, which is
*linear* in the unit normal n. The paper's eq. (6) counts the direct beam alone. The full model adds diffuse
light (isotropic, or after Hay and Davies), light and longwave from level ground around, and heat conducted
into the layer. A facet sees ``(1 + n_z) / 2`` of the sky, so all of it is ``n . v`` plus a term common to all
normals:

    v = (1 - A) (S + D A_i / s_z) s  +  z k
    k = (1 - A) (D (1 - A_i) - A_g G) / 2  -  e (L_g - L) / 2

(s: towards the sun, S: DNI, D: DHI, G: GHI, A: albedo, A_i = S / S_0: circumsolar share, A_g: the ground's
albedo, e: broadband emissivity, L: downward longwave, L_g: longwave of the ground.) The same least squares
therefore solves both models; the design vector is u = v / V, where V is the beam's part of v.

Temperatures in kelvin, heat fluxes in W/m2, minute bins in rows, regions in columns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.physics.bodies import BODIES
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import extraterrestrial, perez_brightening
from fieldkit.physics.facet import VERTICAL
from fieldkit.physics.irradiance import DIFFUSE_MODELS
from fieldkit.physics.slab import Slab, conducted_flux

MINUTE_S = 60.0
# the heat conducted is close to a derivative of the temperature, which magnifies noise between minutes
SMOOTHED_MINUTES = 5
UNSTEADY = 0.1
"""Relative change of DNI from minute to minute that doubles the variance of a row."""
GROUND_ALBEDO_SD = 0.10
"""Uncertainty of an assumed albedo: bare ground lies evenly between 0.05 and 0.40 (Oke 1987, table 1.1)."""
LIGHT = ("circumsolar", "brightening", "diffuse", "ground albedo")
"""Uncertain properties of the light, for the full model."""
# least-squares parabola through five minutes: row i gives the smoothed value at the i-th of them
_PARABOLAS = np.vander(np.arange(SMOOTHED_MINUTES) - SMOOTHED_MINUTES // 2, 3).astype(np.float64)
_SMOOTHER: FloatArray = _PARABOLAS @ np.linalg.pinv(_PARABOLAS)


@dataclass(frozen=True, slots=True)
class Rows:
    """Least-squares rows: minute bins (n,) of a window by targets (m,); NaN where a bin has no value.

    Attributes
    ----------
    design
        Design vectors u, shape (n, 3). [-]
    y
        Measured cosine of incidence, (n, m). [-]
    sigma
        Standard deviation of `y` by the stated noise, (n, m). [-]
    per_kelvin
        Derivative of `y` by the target's temperature, (n, m). [1/K]
    per_w_m2
        Derivative of `y` by the difference of incident sunlight, (n,). [m2/W]
    systematics
        Change of `y` for one standard uncertainty of each systematic effect, (p, n, m): offset between
        regions, its drift, exchange with the air; for the full model conductivity and heat capacity of the
        layer; then every emissivity with a stated uncertainty. Only what changes the heat and not the light:
        an effect on the light depends on the slope and belongs to `methods`, as the scale does. [-]
    reference
        Mean unit normal of the references, (3,). [-]
    sun
        Unit vectors to the sun, (n, 3). [-]
    shade
        Largest y of a facet that faces away from the sun, of any tilt, under any sky from an even one
        to that of Hay and Davies, (n,). [-]
    light
        Change of the design for one standard uncertainty of each property of the light, (q, n, 4): along
        east, north and up, and per sine of the tilt; for the full model `LIGHT`, else none. [-]
    """

    design: FloatArray
    y: FloatArray
    sigma: FloatArray
    per_kelvin: FloatArray
    per_w_m2: FloatArray
    systematics: FloatArray
    reference: FloatArray
    sun: FloatArray
    shade: FloatArray
    light: FloatArray

    def light_near(self, slopes: FloatArray) -> FloatArray:
        """Light's change as `light` for each target, but with the sine of its slope, (q, 4, m, n).

        A slope's effect is linear in ``(normal - reference, 1)`` then.
        """
        light = np.nan_to_num(np.moveaxis(self.light, 2, 1))[:, :, np.newaxis]
        sine = np.hypot(*slopes.T[:2]) - np.hypot(*self.reference[:2])
        size = np.stack([*np.ones((3, sine.size)), sine])
        return np.asarray(light * size[..., np.newaxis])

    def light_effects(self, slopes: FloatArray) -> FloatArray:
        """Change of `y` for one standard uncertainty of each property of the light, (q, m, n), on unit
        normals (m, 3).

        A level target receives what a level reference does.
        """
        away = np.stack([*(slopes - self.reference).T, np.ones(len(slopes))])
        return np.asarray(np.sum(self.light_near(slopes) * away[..., np.newaxis], axis=1))


def least_squares_rows(
    history: History,
    first: int,
    columns: RegionColumns,
    settings: EstimatorSettings,
    shifted_k: Iterable[FloatArray] = (),
) -> Rows:
    """Rows of the minute bins from index `first` of the history on.

    The history begins with the session: conduction depends on what was before the window. References that
    were never measured are excluded; several are averaged. `shifted_k` are, for each uncertain emissivity,
    the temperatures (n, regions) one standard uncertainty further.

    Watanabe et al., "A Terrain Slope Estimation Scheme using Infrared Camera for Planetary Exploration
    Rovers", eq. (6); for the full model see the module's equation.
    """
    references = _measured_references(history, first, columns)
    target_k = history.temperature_k[:, columns.targets]
    reference_k = history.temperature_k[:, columns.references[references]]
    over_k = target_k - np.mean(reference_k, axis=1, keepdims=True)
    heat = _heat_difference(target_k, reference_k, settings)
    beam, vertical = absorbed_light(history, np.mean(reference_k, axis=1), settings)
    design = history.sun + (vertical / beam)[:, np.newaxis] * VERTICAL
    # an even sky sends a facet in its own shade the light that Hay and Davies place around the sun, too
    around_sun = (beam - (1.0 - settings.surface.albedo) * history.dni_w_m2) * history.sun[:, 2] / 2.0
    shade = (np.maximum(vertical + around_sun, 0.0) + around_sun) / beam
    reference = columns.reference_normals[references].mean(axis=0)
    steepness, storage_flux = _heat_loss_per_kelvin(target_k, settings), np.zeros_like(target_k)
    minutes = (history.minute - history.minute[first:].mean())[:, np.newaxis]
    drift_k = settings.drift_sd_k_per_h * minutes / 60.0
    exchange = settings.surface.exchange_w_m2_k * settings.exchange_sd * _trend(over_k, first)
    systematics = [settings.offset_sd_k * steepness, drift_k * steepness, exchange]
    kernel = np.zeros(1)
    # one minute alone shows nothing of the stored heat
    stores_heat = settings.model == "full" and len(history) > 1
    if stores_heat:
        storage_flux = conduction(history.minute, over_k, settings.slab)
        systematics[1] += conduction(history.minute, drift_k, settings.slab)
        perturbed = (conduction(history.minute, over_k, slab) for slab in _perturbed_slabs(settings))
        systematics += [flux - storage_flux for flux in perturbed]
        kernel = smoothed_kernel(settings.slab)
    for shifted in shifted_k:
        other_k, other_reference_k = shifted[:, columns.targets], shifted[:, columns.references[references]]
        shift = _heat_difference(other_k, other_reference_k, settings) - heat
        if stores_heat:
            further_k = other_k - np.mean(other_reference_k, axis=1, keepdims=True)
            shift += conduction(history.minute, further_k, settings.slab) - storage_flux
        systematics.append(shift)
    scale = (beam * settings.scale)[:, np.newaxis]
    # the difference has the target's noise and that of the references' mean
    noise_k = settings.noise_k * np.sqrt(1.0 + 1.0 / max(1, int(references.sum())))
    # noise of one minute enters by the loss of that minute and by the storage flux of those after
    noise_gain = np.sqrt((steepness + kernel[0]) ** 2 + np.sum(kernel[1:] ** 2))
    window = slice(first, None)
    return Rows(
        design=design[window],
        # the difference to the reference is u'(n - r): with u'r added it is the target's own cosine
        y=((heat + storage_flux) / scale + (design @ reference)[:, np.newaxis])[window],
        sigma=(noise_k * noise_gain * _unsteadiness(history.dni_w_m2)[:, np.newaxis] / scale)[window],
        per_kelvin=(steepness / scale)[window],
        per_w_m2=((1.0 - settings.surface.albedo) / scale[:, 0])[window],
        systematics=(np.stack(systematics) / scale)[:, window],
        reference=reference,
        sun=history.sun[window],
        shade=shade[window],
        light=(light_uncertainties(history, settings) / scale)[:, window],
    )


def _measured_references(history: History, first: int, columns: RegionColumns) -> BoolArray:
    """References with any temperature in the window; all if none has, so that their mean is NaN."""
    measured = np.isfinite(history.temperature_k[first:, columns.references]).any(axis=0)
    return np.asarray(measured | ~measured.any())


def _unsteadiness(dni_w_m2: FloatArray) -> FloatArray:
    """Factor on sigma for light that changes within a minute bin (n,): 1 when steady.

    A tenth more or less than a neighbouring minute doubles the variance: a mean over the minute no longer
    shows when the light came, and the surface responds to that.
    """
    change = np.abs(np.diff(dni_w_m2, prepend=np.nan, append=np.nan))
    largest = np.fmax(change[:-1], change[1:])
    relative = np.nan_to_num(largest / np.maximum(dni_w_m2, 1.0))
    return np.asarray(np.sqrt(1.0 + (relative / UNSTEADY) ** 2))


def _heat_difference(
    target_k: FloatArray, reference_k: FloatArray, settings: EstimatorSettings
) -> FloatArray:
    """Heat that targets (n, m) lose more than the mean of the references (n, r), W/m2."""
    loss = _heat_loss(target_k, settings)
    return np.asarray(loss - np.mean(_heat_loss(reference_k, settings), axis=1, keepdims=True))


def _heat_loss(temperature_k: FloatArray, settings: EstimatorSettings) -> FloatArray:
    """Heat a surface loses by radiation and to the air, without the terms common to all surfaces, W/m2."""
    surface = settings.surface
    emitted = surface.emissivity_broadband * STEFAN_BOLTZMANN * temperature_k**4
    return np.asarray(emitted + surface.exchange_w_m2_k * temperature_k)


def _heat_loss_per_kelvin(temperature_k: FloatArray, settings: EstimatorSettings) -> FloatArray:
    surface = settings.surface
    emitted = 4.0 * surface.emissivity_broadband * STEFAN_BOLTZMANN * temperature_k**3
    return np.asarray(emitted + surface.exchange_w_m2_k)


@dataclass(frozen=True, slots=True)
class MinuteLight:
    """Light of each minute (n,): direct normal and diffuse horizontal in W/m2, NaN without sun.

    `cos_zenith` is that of the sun, `circumsolar` the share of diffuse light around it after Hay and Davies.
    """

    beam: FloatArray
    diffuse: FloatArray
    cos_zenith: FloatArray
    circumsolar: FloatArray

    @classmethod
    def of(cls, history: History, settings: EstimatorSettings) -> MinuteLight:
        """The light of minute bins; diffuse light that was not measured is a share of the global."""
        cos_zenith = np.where(history.sun[:, 2] > 0.0, history.sun[:, 2], np.nan)
        beam = np.where(history.dni_w_m2 > 0.0, history.dni_w_m2, np.nan)
        clearness = beam / extraterrestrial(history.time_ns, BODIES[settings.body])
        share = np.full_like(beam, settings.diffuse_fraction)
        if share_by_beam := DIFFUSE_MODELS[settings.irradiance.diffuse].by_beam:
            share = share_by_beam(clearness)
        assumed = share / (1.0 - share) * beam * cos_zenith
        diffuse = np.where(np.isnan(history.dhi_w_m2), assumed, history.dhi_w_m2)
        return cls(beam, diffuse, cos_zenith, np.clip(clearness, 0.0, 1.0))

    @property
    def ghi(self) -> FloatArray:
        """Global horizontal irradiance, W/m2."""
        return self.beam * self.cos_zenith + self.diffuse


def absorbed_light(
    history: History, reference_k: FloatArray, settings: EstimatorSettings
) -> tuple[FloatArray, FloatArray]:
    """Absorbed light along the sun vector (n,) and along the vertical (n,), W/m2; NaN without sun."""
    surface, light = settings.surface, MinuteLight.of(history, settings)
    absorptance = 1.0 - surface.albedo
    if settings.model == "paper":
        return absorptance * light.beam, np.zeros_like(light.beam)
    circumsolar = settings.circumsolar_share * light.circumsolar
    measured = history.longwave_down_w_m2
    longwave = np.where(np.isnan(measured), settings.longwave_down_w_m2, measured)
    emissivity = surface.emissivity_broadband
    # the ground around is taken to be as warm as the reference
    ground_longwave = emissivity * STEFAN_BOLTZMANN * reference_k**4 + (1.0 - emissivity) * longwave
    # of the view factors (1 + n_z) / 2 and (1 - n_z) / 2 only n_z differs from the reference
    level = absorptance * (light.diffuse * (1.0 - circumsolar) - settings.ground_albedo * light.ghi) / 2.0
    return (
        absorptance * (light.beam + light.diffuse * circumsolar / light.cos_zenith),
        level - emissivity * (ground_longwave - longwave) / 2.0,
    )


def light_uncertainties(history: History, settings: EstimatorSettings) -> FloatArray:
    """Change of absorbed light for one standard uncertainty of each of `LIGHT`, (q, n, 4), W/m2.

    As `Rows.light`. The paper's model has none: its scale includes what it omits.
    """
    if settings.model == "paper":
        return np.zeros((0, len(history), 4))
    light = MinuteLight.of(history, settings)
    top = extraterrestrial(history.time_ns, BODIES[settings.body])
    around_sun, horizon = perez_brightening(light.diffuse, light.beam, top, light.cos_zenith)
    circumsolar_sd, brightening_sd, diffuse_sd, albedo_sd = light_sds(history, settings)
    sun, even = history.sun / light.cos_zenith[:, np.newaxis], VERTICAL / 2.0
    uneven = sun - even
    more_sky = even + (settings.circumsolar_share * light.circumsolar)[:, np.newaxis] * uneven
    # direct light that is the rest of the global decreases by as much
    rest = settings.ground_albedo * even if settings.irradiance.is_direct else sun
    changes = [
        _change(circumsolar_sd * light.diffuse * light.circumsolar, uneven),
        _change(brightening_sd * light.diffuse * (around_sun - light.circumsolar), uneven)
        + _change(brightening_sd * light.diffuse * horizon, 0.0 * uneven, 1.0),
        _change(diffuse_sd * light.diffuse, more_sky - rest),
        _change(-albedo_sd * light.ghi, even),
    ]
    return np.asarray((1.0 - settings.surface.albedo) * np.stack(changes))


def light_sds(history: History, settings: EstimatorSettings) -> tuple[float, float, float, float]:
    """Standard uncertainties of `LIGHT`: the sky's by the prior and its distance from the configured one."""
    prior = settings.prior
    return (
        math.hypot(prior.circumsolar_sd, settings.circumsolar_share - prior.circumsolar_share),
        math.hypot(prior.brightening_sd, prior.brightening_share),
        prior.diffuse_sd if bool(np.isfinite(history.dhi_w_m2).any()) else prior.diffuse_unmeasured_sd,
        GROUND_ALBEDO_SD,
    )


def _change(w_m2: FloatArray, direction: FloatArray, sine: float = 0.0) -> FloatArray:
    """Light (n,) along a direction (n, 3) or (3,) and per sine of the tilt, (n, 4)."""
    along = np.broadcast_to(direction, (w_m2.size, 3))
    return np.asarray(w_m2[:, np.newaxis] * np.column_stack([along, np.full(w_m2.size, sine)]))


def _trend(values: FloatArray, first: int) -> FloatArray:
    """Parabolas through the columns from row `first` on, NaN before.

    An uncertain coefficient multiplies the trend, not the values: fitted to their noise it would always
    come out too small.
    """
    trend = np.full_like(values, np.nan)
    parabolas = np.vander(np.linspace(-1.0, 1.0, len(values) - first), 3)
    window = values[first:]
    # columns with the same gaps, nearly always all of them, are fitted together
    gaps, kind = np.unique(np.isfinite(window), axis=1, return_inverse=True)
    for place, known in enumerate(gaps.T):
        if known.any():
            columns = np.flatnonzero(kind.ravel() == place)
            fitted = np.linalg.lstsq(parabolas[known], window[np.ix_(known, columns)])[0]
            trend[first:, columns] = parabolas @ fitted
    return trend


def _perturbed_slabs(settings: EstimatorSettings) -> tuple[Slab, Slab]:
    """The layer with its conductivity, and with its heat capacity, one standard uncertainty higher."""
    slab = settings.slab
    conductivity = slab.conductivity_w_m_k * (1.0 + settings.conductivity_sd)
    capacity = slab.heat_capacity_j_m3_k * (1.0 + settings.capacity_sd)
    return replace(slab, conductivity_w_m_k=conductivity), replace(slab, heat_capacity_j_m3_k=capacity)


def conduction(minutes: IntArray, difference_k: FloatArray, slab: Slab) -> FloatArray:
    """Heat flux into the layer of a target less that into the same layer of the reference, W/m2.

    `minutes` (n,) since 1970 increase; gaps are bridged by straight lines. `difference_k` (n, m) are surface
    temperatures over the reference's. Its shape; NaN where that is, and for columns with fewer than five
    values.
    """
    steps = np.arange(minutes[0], minutes[-1] + 1)
    is_known = np.isfinite(difference_k)
    columns = np.flatnonzero(np.count_nonzero(is_known, axis=0) >= SMOOTHED_MINUTES)
    flux = np.full_like(difference_k, np.nan)
    if columns.size:
        bridged = [
            _smooth(np.interp(steps, minutes[is_measured], values[is_measured]))
            for is_measured, values in zip(is_known.T[columns], difference_k.T[columns], strict=True)
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
def smoothed_kernel(slab: Slab) -> FloatArray:
    """Response of the flux to noise in one minute bin: its own bin first, then others, W/m2 per kelvin."""
    pulse = np.zeros(6 * SMOOTHED_MINUTES)
    # far from both ends, whose parabolas are other ones
    pulse[2 * SMOOTHED_MINUTES] = 1.0
    response = conducted_flux(slab, _smooth(pulse), MINUTE_S)[1:]
    own = 2 * SMOOTHED_MINUTES - 1
    return np.concatenate([response[own : own + 1], np.delete(response, own)])
