"""Where the degrees of error come from: an estimate for each cause, from the session's own numbers.

The paper's eq. (6) knows direct light and the exchange with air and sky that all beds share.
What it leaves out is worked out here term by term with the functions of the full model, and
each term is turned into degrees of tilt by how fast direct light changes with tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.band_emissivity import difference_k
from fieldkit.estimation.bins import MINUTE_NS
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics import sky
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.physics.slab import conducted_flux
from fieldkit.physics.surface import emitted_longwave
from fieldkit.views.report.series import Bed, Series

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BedBudget:
    """Medians over the session for one bed.

    The four terms are what the paper's model takes for direct light and is not, in W/m2 of
    eq. (6); positive ones make the bed look more turned to the sun than it is.
    `w_m2_per_degree` is how direct light on the bed changes with its tilt; `noise_deg` half
    the width of the likelihood region. `emissivity_k` is the standard uncertainty of bed minus reference
    by calibrated emissivities, `factor_sd` the relative one of a calibrated light meter.
    """

    name: str
    diffuse_w_m2: float
    reflected_w_m2: float
    longwave_w_m2: float
    storage_w_m2: float
    w_m2_per_degree: float
    kelvin_per_degree: float
    noise_deg: float
    tilt_deg: float
    emissivity_k: float = 0.0
    factor_sd: float = 0.0

    @property
    def left_out_w_m2(self) -> float:
        """Sum of the four terms; they partly cancel."""
        return self.diffuse_w_m2 + self.reflected_w_m2 + self.longwave_w_m2 + self.storage_w_m2

    def degrees(self, term_w_m2: float) -> float:
        """Tilt that a term feigns, to first order."""
        return term_w_m2 / self.w_m2_per_degree

    def of_offset(self, offset_k: float) -> float:
        """Tilt that a constant temperature offset between bed and reference feigns."""
        return offset_k / self.kelvin_per_degree

    def of_scale(self, relative: float) -> float:
        """Tilt that a relative error of the irradiance feigns, to first order."""
        return relative * self.tilt_deg


def budget(columns: Series, bed: Bed, settings: EstimatorSettings) -> BedBudget:
    """The budget of one bed at its given slope, or at the estimated one where none was given."""
    tilt, azimuth = _slope(bed)
    cos_tilt = float(np.cos(np.radians(tilt)))
    in_sun = columns.irradiance_w_m2 > 0
    light = np.where(in_sun, columns.irradiance_w_m2, np.nan)
    assumed = settings.diffuse_fraction / (1 - settings.diffuse_fraction) * light * columns.cos_zenith
    diffuse = np.where(np.isnan(columns.diffuse_w_m2), assumed, columns.diffuse_w_m2)
    on_bed = sky.hay_davies_diffuse(
        diffuse,
        light,
        sky.extraterrestrial(columns.time_ns),
        cos_incidence(normal(tilt, azimuth), columns.sun),
        columns.cos_zenith,
        cos_tilt,
    )
    reflected = sky.ground_reflected(diffuse + light * columns.cos_zenith, settings.ground_albedo, cos_tilt)
    absorbing = 1.0 - settings.surface.albedo
    return BedBudget(
        bed.region.name,
        _median(on_bed - diffuse),
        _median(reflected),
        _median(_longwave(columns, cos_tilt, settings)) / absorbing,
        _median(-_stored(columns, bed, settings)) / absorbing,
        _median(light * _per_degree(columns, tilt, azimuth)),
        _median(bed.kelvin_per_degree),
        _median(np.where(bed.is_answer, (bed.tilt_high_deg - bed.tilt_low_deg) / 2, np.nan)),
        tilt,
        _median(_of_emissivity(columns, bed, settings)),
        settings.factor_sd,
    )


def pooled(name: str, budgets: Sequence[BedBudget]) -> BedBudget:
    """The medians over several sessions, under one name."""
    numbers = [one.name for one in fields(BedBudget) if one.name != "name"]
    return BedBudget(name, **{one: _median(np.array([getattr(b, one) for b in budgets])) for one in numbers})


def _slope(bed: Bed) -> tuple[float, float]:
    given = (bed.region.tilt_deg, bed.region.azimuth_deg)
    estimated = (_median(bed.answered_tilt_deg), _median(bed.azimuth_deg))
    return given if np.isfinite(given).all() else estimated


def _per_degree(columns: Series, tilt_deg: float, azimuth_deg: float) -> FloatArray:
    """Change of cos(incidence) per degree of tilt, per minute."""
    tilt, azimuth = np.radians([tilt_deg, azimuth_deg])
    towards = np.array([np.cos(tilt) * np.sin(azimuth), np.cos(tilt) * np.cos(azimuth), -np.sin(tilt)])
    return np.asarray(np.radians(columns.sun @ towards))


def _longwave(columns: Series, cos_tilt: float, settings: EstimatorSettings) -> FloatArray:
    """Long wave the bed takes from the ground around instead of from the sky, W/m2 absorbed."""
    measured, emissivity = columns.longwave_w_m2, settings.surface.emissivity_broadband
    down = np.where(np.isnan(measured), settings.longwave_down_w_m2, measured)
    ground = emitted_longwave(columns.reference_k, emissivity) + (1.0 - emissivity) * down
    return emissivity * (sky.longwave_on_facet(down, ground, cos_tilt) - down)


def _of_emissivity(columns: Series, bed: Bed, settings: EstimatorSettings) -> FloatArray:
    """Standard uncertainty of bed minus reference by their emissivities, kelvin."""
    if not columns.references:
        return np.zeros(columns.time_ns.size)
    seen = columns.temperature_k[bed.region.name], columns.reference_k
    return difference_k(*seen, bed.region, columns.references[0], settings)


def _stored(columns: Series, bed: Bed, settings: EstimatorSettings) -> FloatArray:
    """Heat that goes into the bed's sand beyond what goes into the reference's, W/m2."""
    difference = columns.temperature_k[bed.region.name] - columns.reference_k
    known = np.isfinite(difference)
    flux = np.full(difference.shape, np.nan)
    if known.sum() > 1:
        minutes = columns.time_ns[known] // MINUTE_NS
        every = np.arange(minutes[0], minutes[-1] + 1)
        bridged = np.interp(every, minutes, difference[known])
        flux[known] = conducted_flux(settings.slab, bridged, MINUTE_NS / 1e9)[minutes - minutes[0]]
    return flux


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
