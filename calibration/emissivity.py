"""Emissivity of a surface in the camera's band, from pairs of camera and thermometer.

At emissivity 1 the camera reports the brightness temperature of emitted plus reflected light, so over
many pairs ``M(T_app) - M(T_refl) = e (M(T) - M(T_refl))`` with M the band signal: a line through the
origin whose slope is the emissivity. Errors that all pairs share do not average out and are added
afterwards (GUM, type B). What the data do not determine is refused, with a fix that names what would.

Crumpled foil in the surface's plane shows what the surface reflects. Foil is not a perfect mirror: the few
hundredths that it emits itself make a cold sky some kelvins too warm; and under a cold sky it may be colder
than the camera can measure, which gives a bound instead of a measurement.

Sources: ASTM E1933 (contact thermometer and reference emissivity methods), ISO 18434-1 annex A
(reflector method), JCGM 100. Kelvin throughout; arrays of n pairs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from fieldkit.calibration.band import FLAT, Band, own_part_k
from fieldkit.calibration.line import Line, Points, fit_line
from fieldkit.calibration.uncertainty import Budgeted, Contribution, largest
from fieldkit.model.arrays import CountArray, FloatArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Argument
from fieldkit.model.quantities import kelvin_if_fahrenheit
from fieldkit.model.units import CELSIUS_ZERO_K

Reflected = Literal["fixed", "free"]

MIN_PAIRS = 3
MIN_CONTRAST_K = 10.0
"""Least contrast between surface and reflected temperature, the usual rule of ASTM E1933."""
MIN_SPAN_K = 15.0
"""Least span of surface temperatures for fitting the reflected temperature as well."""
MAX_UNCERTAINTY = 0.05
"""Standard uncertainty beyond which an emissivity does not distinguish soils, 0.85 to 0.98."""
UNLIKELY = 1e-3
MIN_SOIL, MAX_SOIL = 0.6, 1.02
DARK = 0.985
WARM_SKY_K = 253.15
"""Sky temperature assumed where it is fitted: -20 °C, humid clear air in the window band."""
MIN_REFLECTANCE = 0.02
"""Least reflectance assumed where it is fitted together with the sky."""

SATURATED_SHARE = 0.25
"""Share of a foil's pixels at one lowest count; noise alone leaves a few per cent there."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Readings at n moments, each array (n,), kelvin.

    `apparent_k` is the camera's region mean at emissivity 1 without the effect of the air, `contact_k` the
    thermometer, `reflected_k` the band temperature of what the surface reflects (foil). `apparent_sd_k` and
    `contact_sd_k` are standard uncertainties that are independent from pair to pair.
    """

    apparent_k: FloatArray
    contact_k: FloatArray
    reflected_k: FloatArray
    apparent_sd_k: FloatArray
    contact_sd_k: FloatArray

    def __len__(self) -> int:
        return len(self.apparent_k)

    @property
    def span_k(self) -> float:
        """Range of the surface temperatures."""
        return float(np.ptp(self.contact_k))

    @property
    def follows_the_sky(self) -> bool:
        """True if the reflected temperature was measured with each pair, not one for all."""
        return float(np.ptp(self.reflected_k)) > 0.0

    @property
    def contrast_k(self) -> float:
        """Least difference between surface and reflected temperature."""
        return float(np.min(np.abs(self.contact_k - self.reflected_k)))


@dataclass(frozen=True, slots=True)
class SharedUncertainties:
    """Standard uncertainties common to all pairs, kelvin (transmission: 1).

    Defaults are those of a camera checked against ice water, a good thermometer, a fine wire under one layer
    of grains in the sun, and a crumpled foil. `sky_drift_k` and `probe_gradient_k` are half of the change of
    sky and probe error from the coldest pair to the warmest. Of five measured days (SURFRAD Alamosa and Table
    Mountain, ARM Oklahoma) the RMS of the sky's is 3 K, 0.3 to 5.5 K; the heat flux of the two in Oklahoma
    swings by 90 W/m2, in sand of 0.25 W/(m K) 0.2 K at the 1.2 mm of a probe up to 2 mm deep. It is a little
    more, since on real days both errors make the emissivity too large.
    """

    camera_k: float = 0.3
    thermometer_k: float = 0.3
    probe_to_skin_k: float = 0.5
    reflected_k: float = 5.0
    transmission: float = 0.004
    sky_drift_k: float = 3.0
    probe_gradient_k: float = 0.25


DEFAULT_SHARED_UNCERTAINTIES = SharedUncertainties()


@dataclass(frozen=True, slots=True)
class Emissivity(Budgeted):
    """An emissivity with its uncertainty budget.

    `reflected_k` is a result when it was left free, else the mean of the values given. `freedom` are the
    degrees of freedom of the fit, `chi_square` is per degree of freedom, `residual_k` the RMS residual of
    the line as camera temperature. `remarks` are warnings short of a refusal.
    """

    value: float
    reflected_k: float
    chi_square: float
    freedom: int
    residual_k: float
    span_k: float
    budget: tuple[Contribution, ...]
    remarks: tuple[str, ...] = ()

    @property
    def largest(self) -> Contribution:
        """The contribution with the largest effect."""
        return largest(self.budget)


def fit_emissivity(
    pairs: Pairs,
    shared: SharedUncertainties = DEFAULT_SHARED_UNCERTAINTIES,
    *,
    reflected: Reflected = "fixed",
    band: Band = FLAT,
    tape_emissivity_sd: float = 0.0,
    tape_emissivity: float = 1.0,
    foil_emissivity_sd: float = 0.0,
) -> Emissivity:
    """Emissivity with budget and quality of the fit, from pairs of camera and thermometer.

    At least three pairs, the surface at least 10 K from what it reflects; with `reflected` ``free``, which
    also fits the reflected temperature, the surface must span 15 K. `shared` are the standard uncertainties
    common to all pairs. `tape_emissivity` and its standard uncertainty are those of a tape in place of a
    thermometer, 0 if unused; `foil_emissivity_sd` is that of the foil that showed the reflected temperature.
    Raises `CalibrationError` if the data do not determine the emissivity to 0.05, or contradict the model.

    ASTM E1933, Standard Practice for Measuring and Compensating for Emissivity Using Infrared Imaging
    Radiometers; JCGM 100:2008, Guide to the expression of uncertainty in measurement.
    """
    _refuse_before(pairs, shared.reflected_k, reflected)
    fit = _Fit(pairs, reflected, band)
    line = fit.line
    scatter_k = float(np.sqrt(np.mean(pairs.contact_sd_k**2 + pairs.apparent_sd_k**2)))
    tape = tape_emissivity if tape_emissivity_sd > 0.0 else None
    budget = (
        Contribution("scatter of the pairs", scatter_k, "K", "A", line.slope_sd),
        *_shared_effects(fit, shared, tape),
    )
    if tape is not None:
        effect = line.slope / tape * tape_emissivity_sd
        budget += (Contribution("emissivity of the tape", tape_emissivity_sd, "1", "B", effect),)
    if foil_emissivity_sd > 0.0:
        budget += (_foil_contribution(fit, foil_emissivity_sd),)
    result = Emissivity(
        value=line.slope,
        reflected_k=_reflected_k(fit),
        chi_square=line.chi_square / max(1, line.freedom),
        freedom=line.freedom,
        residual_k=float(np.sqrt(np.mean((line.residuals / fit.per_k(pairs.apparent_k)) ** 2))),
        span_k=pairs.span_k,
        budget=budget,
    )
    remarks = _refuse_after(result, _disagreement(fit, shared), _emissivity_if_fahrenheit(fit, shared))
    return replace(result, remarks=remarks)


@dataclass(frozen=True)
class _Fit:
    """Pairs and the line of camera signal over surface signal through them."""

    pairs: Pairs
    reflected: Reflected
    band: Band

    @cached_property
    def line(self) -> Line:
        """With a fixed reflected temperature both signals above that of it."""
        pairs, is_fixed = self.pairs, self.reflected == "fixed"
        apparent, black = self.band.signal(pairs.apparent_k), self.band.signal(pairs.contact_k)
        mirror = self.band.signal(pairs.reflected_k) if is_fixed else np.zeros(len(pairs))
        points = Points(
            black - mirror,
            apparent - mirror,
            self.per_k(pairs.contact_k) * pairs.contact_sd_k,
            self.per_k(pairs.apparent_k) * pairs.apparent_sd_k,
        )
        return fit_line(points, origin=is_fixed)

    def per_k(self, temperature_k: FloatArray) -> FloatArray:
        """dM/dT of the band signal per kelvin."""
        return np.asarray(self.band.signal(temperature_k + 0.5) - self.band.signal(temperature_k - 0.5))

    def slope_change(self, reflected: Reflected, **changed: FloatArray) -> float:
        """Change of the slope with some columns of the pairs."""
        return _Fit(replace(self.pairs, **changed), reflected, self.band).line.slope - self.line.slope


def _reflected_k(fit: _Fit) -> float:
    """The reflected temperature: as given, or from the intercept ``(1 - e) M(T_refl)``."""
    if fit.reflected == "fixed":
        return float(np.mean(fit.pairs.reflected_k))
    line = fit.line
    return float(fit.band.temperature(line.intercept / (1.0 - line.slope))) if line.slope < 1.0 else math.nan


def _shared_effects(fit: _Fit, shared: SharedUncertainties, tape: float | None) -> Iterator[Contribution]:
    """Change of the emissivity for each shared error, found by shifting the data and fitting again."""
    pairs, band, is_fixed = fit.pairs, fit.band, fit.reflected == "fixed"

    def slope_change(
        *, camera_k: float = 0.0, probe_k: FloatArray | float = 0.0, reflected_k: FloatArray | float = 0.0
    ) -> float:
        mirror, contact = pairs.reflected_k + reflected_k, pairs.contact_k + probe_k
        if tape is not None:  # the same camera views the tape, which reflects the same
            tape_signal = tape * band.signal(pairs.contact_k) + (1.0 - tape) * band.signal(pairs.reflected_k)
            contact = own_part_k(band.temperature(tape_signal) + camera_k, tape, mirror, band)
        seen_k = pairs.apparent_k + camera_k
        return fit.slope_change(fit.reflected, apparent_k=seen_k, contact_k=contact, reflected_k=mirror)

    yield Contribution("camera offset", shared.camera_k, "K", "B", slope_change(camera_k=shared.camera_k))
    if tape is None:
        for name, error_k in (
            ("thermometer calibration", shared.thermometer_k),
            ("probe to skin temperature", shared.probe_to_skin_k),
        ):
            yield Contribution(name, error_k, "K", "B", slope_change(probe_k=error_k))
        gradient_k = shared.probe_gradient_k
        effect = slope_change(probe_k=gradient_k * _position(pairs))
        yield Contribution("probe error with heat flow", gradient_k, "K", "B", effect)
    if is_fixed or tape is not None:
        shift = slope_change(reflected_k=shared.reflected_k)
        yield Contribution("reflected temperature", shared.reflected_k, "K", "B", shift)
    if not pairs.follows_the_sky:
        drift_k = shared.sky_drift_k
        shift_k = drift_k * _position(pairs)
        effect = slope_change(reflected_k=shift_k) if is_fixed else _drift_effect(fit, shift_k, tape)
        yield Contribution("drift of the sky", drift_k, "K", "B", effect)
    if tape is None:  # the camera sees the tape through the same air
        yield Contribution(
            "air in between", shared.transmission, "1", "B", fit.line.slope * shared.transmission
        )


def _position(pairs: Pairs) -> FloatArray:
    """Position of each pair relative to their mean, in halves of the span; zeros if all are alike."""
    away = pairs.contact_k - pairs.contact_k.mean()
    return np.asarray(away / max(0.5 * pairs.span_k, 1e-9))


def _drift_effect(fit: _Fit, drift_k: FloatArray, tape: float | None) -> float:
    """Effect of a sky that drifts as the surface warms, where its temperature is fitted as well.

    With c that of a perfect mirror the effect is c (1 - e), less c q e by a tape, whose temperature is
    read the warmer by what it reflects itself, q = (1 - tape) / tape. Both depend on an emissivity that is
    known no better, so s = c (1 - e - q e + (1 + q) s): a drift that makes the emissivity too large hides
    itself, because it also makes the reflectance too small.
    """
    by_tape = 0.0 if tape is None else (1.0 - tape) / tape
    seen_k, slope = fit.pairs.apparent_k, fit.line.slope
    per_k = fit.per_k(np.full(seen_k.size, WARM_SKY_K)) / fit.per_k(seen_k)
    of_mirror = fit.slope_change("free", apparent_k=seen_k + per_k * drift_k)
    effect = of_mirror * (max(1.0 - slope, MIN_REFLECTANCE) - by_tape * slope)
    return effect / max(1.0 - abs(of_mirror) * (1.0 + by_tape), 0.25)


def _foil_contribution(fit: _Fit, foil_sd: float) -> Contribution:
    """Effect of a foil that emits more or less than assumed: the sky would be colder or warmer."""
    mirror_k = fit.pairs.reflected_k
    own = fit.band.signal(fit.pairs.contact_k) - fit.band.signal(mirror_k)
    effect = fit.slope_change("fixed", reflected_k=mirror_k - foil_sd * own / fit.per_k(mirror_k))
    return Contribution("emissivity of the foil", foil_sd, "1", "B", effect)


def _disagreement(fit: _Fit, shared: SharedUncertainties) -> float:
    """Chi-square of the residuals, allowing for shared errors, which also bend the line.

    The distance of the probe from the skin acts through a heat flux that changes: it counts as an
    independent error of each pair as well.
    """
    pairs, line = fit.pairs, fit.line
    seen_per_k, felt_per_k = fit.per_k(pairs.apparent_k), line.slope * fit.per_k(pairs.contact_k)
    felt_sd_k = np.hypot(pairs.contact_sd_k, shared.probe_to_skin_k)
    own = np.hypot(seen_per_k * pairs.apparent_sd_k, felt_per_k * felt_sd_k)
    together = [
        seen_per_k * shared.camera_k,
        felt_per_k * np.hypot(shared.thermometer_k, shared.probe_to_skin_k),
    ]
    if fit.reflected == "fixed":
        together.append((1.0 - line.slope) * fit.per_k(pairs.reflected_k) * shared.reflected_k)
    covariance = np.diag(own**2) + sum(np.outer(effect, effect) for effect in together)
    return float(line.residuals @ np.linalg.solve(covariance, line.residuals))


def agree(chi_square: float, freedom: int) -> bool:
    """True if pairs scatter about their line as their uncertainties predict."""
    return freedom <= 0 or float(chdtrc(freedom, chi_square)) >= UNLIKELY


def _emissivity_if_fahrenheit(fit: _Fit, shared: SharedUncertainties) -> float:
    """Emissivity if the thermometer's numbers were °F; NaN where the pairs then disagree."""
    converted = replace(fit.pairs, contact_k=kelvin_if_fahrenheit(fit.pairs.contact_k))
    if not (converted.contrast_k > 0.0 and np.isfinite(fit.band.signal(converted.contact_k)).all()):
        return math.nan
    other = _Fit(converted, "fixed", fit.band)
    return other.line.slope if agree(_disagreement(other, shared), other.line.freedom) else math.nan


def _refuse_before(pairs: Pairs, reflected_sd_k: float, reflected: Reflected) -> None:
    """Raise `CalibrationError` if the data cannot determine an emissivity, whatever its value.

    The surface must differ from what it reflects by 10 K, and by three standard uncertainties of that.
    """
    if (count := len(pairs)) < MIN_PAIRS:
        raise CalibrationError(
            f"{count} steady pair{'s' * (count != 1)} cannot show whether they agree",
            fix=f"measure at {MIN_PAIRS} temperatures or more, each steady for a minute",
        )
    if not all(
        np.isfinite(values).all() for values in (pairs.apparent_k, pairs.contact_k, pairs.reflected_k)
    ):
        raise CalibrationError(
            "some of the pairs have no temperature in this band",
            fix="check band, path through the air, what the camera has applied, and the foil's emissivity",
        )
    contrast_k, span_k = pairs.contrast_k, pairs.span_k
    least_k = max(MIN_CONTRAST_K, 3.0 * reflected_sd_k)
    if contrast_k < least_k:
        raise CalibrationError(
            f"the surface is only {contrast_k:.0f} K from what it reflects, not {least_k:.0f} K: "
            "its emissivity hardly shows",
            fix="heat the sample, or go outdoors under a clear sky; 25 K or more is good",
        )
    if reflected == "free" and span_k < MIN_SPAN_K:
        raise CalibrationError(
            f"the surface spans {span_k:.0f} K: emissivity and reflected temperature cannot be separated",
            fix=f"measure over {MIN_SPAN_K:.0f} K or more, or measure the reflected temperature with foil",
        )


def _refuse_after(found: Emissivity, chi_square: float, in_fahrenheit: float) -> tuple[str, ...]:
    """Raise `CalibrationError` if the fit contradicts the model or is too uncertain; else return warnings.

    `in_fahrenheit` is the emissivity for a thermometer that shows °F, NaN where that fits no better.
    """
    value, freedom = found.value, found.freedom
    is_impossible = value > 1.0 + found.expanded
    disagrees = not agree(chi_square, freedom)
    if (is_impossible or disagrees or value < MIN_SOIL) and MIN_SOIL <= in_fahrenheit <= MAX_SOIL:
        raise CalibrationError(
            f"the emissivity would be {value:.2f}; read as °F the thermometer gives {in_fahrenheit:.2f}",
            fix="set the thermometer to °C, for it seems to show °F, or give " + Argument("unit", "F"),
        )
    if is_impossible:
        raise CalibrationError(
            f"the emissivity would be {value:.2f}, which is impossible",
            fix="check that the camera applies none itself (1), the probe is in this region, and the foil "
            "under the same sky; check the camera's offset",
        )
    if disagrees:
        raise CalibrationError(
            "the pairs disagree by more than their uncertainties (chi-square "
            f"{chi_square / freedom:.1f} per degree of freedom)",
            fix="check for unsteady moments, a probe outside the region, clocks that differ between logs, "
            "or a reflected temperature from another sky",
        )
    if not found.standard_uncertainty <= MAX_UNCERTAINTY:
        worst = found.largest
        raise CalibrationError(
            f"the emissivity would be {value:.2f} ± {found.expanded:.2f} (k=2): not determined",
            fix=f"reduce the largest contribution, {worst.name} ({abs(worst.effect):.3f}), "
            "or make the surface warmer than what it reflects",
        )
    remarks = []
    if value > DARK:
        remarks.append("blacker than any dry soil: check that the camera applies no emissivity of its own")
    if value > 1.0:
        remarks.append("above 1, as no surface is, within its uncertainty: write surface.emissivity = 1.0")
    return tuple(remarks)


def mirrored_temperature_k(
    foil_k: FloatArray, surface_k: FloatArray, foil_emissivity: float, band: Band = FLAT
) -> FloatArray:
    """Band temperature of what a foil reflects, without the foil's own emission (ISO 18434-1, annex A).

    From the foil's brightness temperature at emissivity 1 and its own temperature, (n,) each in kelvin, and
    its emissivity in the band, in [0, 1). Shape (n,), kelvin.
    """
    own = foil_emissivity * band.signal(surface_k)
    return band.temperature((band.signal(foil_k) - own) / (1.0 - foil_emissivity))


def is_saturated(counts: CountArray) -> bool:
    """True if the foil's pixels (n,) of one frame are at the end of the camera's range."""
    return bool(np.mean(counts == counts.min()) >= SATURATED_SHARE)


def refuse_saturated(frames: int, saturated: int, lowest_k: float) -> None:
    """Raise `CalibrationError` if the foil was at the end of the range in half of the frames or more."""
    if frames and 2 * saturated >= frames:
        raise CalibrationError(
            f"the foil reads the camera's lowest temperature, {lowest_k - CELSIUS_ZERO_K:.0f} °C: saturated",
            fix="measure the sky otherwise; over 15 K, " + Argument("reflected", "free") + " fits it",
        )
