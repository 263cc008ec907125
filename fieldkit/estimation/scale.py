"""Scale and offsets from regions of known slope.

Albedo, heat exchange, irradiance and the light meter's model act nearly as one factor kappa: the measured
``delta S / S`` is kappa times the true one. One region of known slope (10 to 25 degrees) gives it; a uniform
target seen by all regions gives the offsets between them; regions of known slope give alpha and beta of eq.
(6) only in the combination reported by `identify`. Every result has its uncertainty, and states where the
data do not determine it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE
from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.facet import normal

LEAST_TILT_DEG = 3.0
"""Flatter regions hardly differ from the reference, whatever kappa is."""
LEAST_SIGNAL = 5.0
"""Least signal of a known region that determines the scale, in standard deviations."""


@dataclass(frozen=True, slots=True)
class KnownSlope:
    """A target region of known slope: its column among the targets, tilt and azimuth in degrees."""

    column: int
    tilt_deg: float
    azimuth_deg: float

    def normal(self, steeper_deg: float = 0.0) -> FloatArray:
        """Unit normal (3,), of a slope that is `steeper_deg` steeper."""
        return normal(self.tilt_deg + steeper_deg, self.azimuth_deg)


def known_slopes(regions: Sequence[Region], beds: Sequence[str], path: Path) -> dict[str, KnownSlope]:
    """Target regions of known slope by name, or those of `beds`.

    Raises `ConfigError` if a region of `beds` is not one of them.
    """
    targets = [region for region in regions if region.kind is RegionKind.TARGET]
    slopes = {
        region.name: KnownSlope(column, region.tilt_deg, region.azimuth_deg)
        for column, region in enumerate(targets)
        if np.isfinite(region.azimuth_deg) and region.tilt_deg >= LEAST_TILT_DEG
    }
    for bed in beds:
        if bed not in slopes:
            fix = f"name a known one of {', '.join(slopes) or 'none'}; give tilt_deg"
            raise ConfigError(f"region {bed} has no known slope", place=path, fix=fix)
    return {name: slope for name, slope in slopes.items() if not beds or name in beds}


def with_known(regions: Regions, beds: Collection[str], steeper_deg: float = 0.0) -> RegionSchedule:
    """Regions to learn from: targets of `beds` as references, all of them steeper by `steeper_deg`.

    The flattest stays a target if no other is left: it would tell least as a reference.
    """
    schedule = RegionSchedule.of(regions)
    targets = [region for region in schedule.latest if region.kind is RegionKind.TARGET]
    steepening = sorted((bed for bed in targets if bed.name in beds), key=lambda region: region.tilt_deg)
    if len(steepening) == len(targets):
        steepening = steepening[1:]
    names = {region.name for region in steepening}
    columns = (
        replace(region, kind=RegionKind.REFERENCE, tilt_deg=region.tilt_deg + steeper_deg)
        if region.name in names
        else region
        for region in schedule.columns
    )
    return replace(schedule, columns=tuple(columns))


@dataclass(frozen=True, slots=True)
class Scale:
    """kappa and its standard uncertainty from noise alone; reduced `chi_square` and number of rows."""

    kappa: float
    kappa_sd: float
    chi_square: float
    rows: int


def scale_from_known_bed(
    design: FloatArray,
    y: FloatArray,
    sigma: FloatArray,
    reference: FloatArray,
    bed: FloatArray,
    *,
    systematics: FloatArray | None = None,
    prior_sd: float = float("inf"),
) -> Scale:
    """Scale from the rows of a region whose normal is known.

    Measured ``y - reference . u`` is kappa times ``(bed - reference) . u``. The regressor is geometry, not a
    temperature, so noise does not bias kappa low as in a regression on measured differences. Systematic
    effects are fitted with a standard normal prior, kappa with a prior about 1 of `prior_sd`. Rows with NaN
    are excluded, and those in which region or reference is self-shaded and only shows ``n . s < 0``.

    `design` (n, 3), `y` and `sigma` (n,) are as of `Rows`, `reference` and `bed` unit normals (3,);
    `systematics` (p, n) are changes of y for one standard uncertainty of each effect on this region, such as
    its own offset. Raises `CalibrationError` if the region's slope is too close to the reference's to
    determine the scale.
    """
    columns = np.vstack([design @ (bed - reference), *(() if systematics is None else systematics)]) / sigma
    measured = (y - design @ reference) / sigma
    is_finite = np.isfinite(measured) & np.isfinite(columns).all(axis=0)
    is_finite &= np.minimum(design @ bed, design @ reference) >= LOWEST_COS_INCIDENCE
    columns, measured = columns[:, is_finite], measured[is_finite]
    if float(columns[0] @ columns[0]) < LEAST_SIGNAL**2:
        fix = "use a bed of 10 to 25 degrees, or more minutes"
        raise CalibrationError("the known bed is too close to the reference to determine the scale", fix=fix)
    priors = np.diag([prior_sd**-2.0, *np.ones(len(columns) - 1)])
    expected = priors[0] * 1.0
    solution = np.linalg.solve(columns @ columns.T + priors, columns @ measured + expected)
    residual = measured - solution @ columns
    chi_square = float(residual @ residual) / max(int(is_finite.sum()) - 1, 1)
    # a misfit beyond the noise inflates the variance, so that the priors weigh more
    inflation = max(1.0, chi_square)
    information = columns @ columns.T / inflation + priors
    solution = np.linalg.solve(information, columns @ measured / inflation + expected)
    kappa_sd = float(np.sqrt(np.linalg.inv(information)[0, 0]))
    return Scale(float(solution[0]), kappa_sd, chi_square, int(is_finite.sum()))


@dataclass(frozen=True, slots=True)
class Offsets:
    """Offsets of regions (m,) against the reference, measured minus true, and standard errors; kelvin."""

    offset_k: FloatArray
    offset_sd_k: FloatArray


def offsets_from_uniform(temperature_k: FloatArray, reference_k: FloatArray) -> Offsets:
    """Offsets of regions (n, m) against the reference (n,) in minutes in which all have the same temperature.

    NaN where missing. The standard error allows for correlation of neighbouring minutes (lag one). Raises
    `CalibrationError` with fewer than three minutes of any region.
    """
    difference = temperature_k - reference_k[:, np.newaxis]
    count = np.isfinite(difference).sum(axis=0)
    if np.any(count < 3):
        fix = "record it for ten minutes"
        raise CalibrationError("fewer than three minutes of the uniform target", fix=fix)
    mean = np.nanmean(difference, axis=0)
    away = difference - mean
    variance = np.nansum(away**2, axis=0) / (count - 1)
    correlation = np.nansum(away[1:] * away[:-1], axis=0) / np.maximum(np.nansum(away**2, axis=0), 1e-300)
    correlation = np.clip(correlation, 0.0, 0.95)
    return Offsets(mean, np.sqrt(variance / count * (1.0 + correlation) / (1.0 - correlation)))


@dataclass(frozen=True, slots=True)
class ExchangeFit:
    """alpha and beta of eq. (6) from regions of known slope, and which part of them the data determine.

    `steepness_w_m2_k` is D = 4 alpha T^3 + beta at the mean temperature, which differences determine, with
    its standard uncertainty `steepness_sd`; `share_sd` is that of the radiative share of D. `share_is_prior`:
    the data did not even halve it, so alpha and beta separately are the prior's, not the measurement's.
    Albedo, emissivity and exchange separately are never determined by temperatures: eq. (7) is homogeneous in
    them. `summary` states this in words.
    """

    alpha: float
    beta: float
    steepness_w_m2_k: float
    steepness_sd: float
    share_sd: float
    share_is_prior: bool
    summary: str


def identify(
    temperature_k: FloatArray,
    reference_k: FloatArray,
    sunlight_w_m2: FloatArray,
    noise_k: float,
    prior: tuple[float, float],
    prior_share_sd: float = 0.10,
) -> ExchangeFit:
    """Fit alpha and beta to known differences of sunlight, by total least squares in the temperatures.

    `temperature_k` and `reference_k` (k,) are of known regions and of the reference in the same minutes, with
    noise of `noise_k` each; `sunlight_w_m2` (k,) is ``S (bed - reference) . s`` from the known slopes.
    `prior` are the expected alpha and beta, `prior_share_sd` is the standard uncertainty of the expected
    radiative share of D. Raises `CalibrationError` if the differences of sunlight do not exceed the noise.
    """
    cube = 4.0 * float(np.mean(reference_k)) ** 3
    steepness = cube * prior[0] + prior[1]
    expected_share = cube * prior[0] / steepness
    emitted = (temperature_k**4 - reference_k**4) / cube
    over_k = temperature_k - reference_k
    noise = np.sqrt(2.0) * noise_k
    if float(np.sqrt(np.mean(sunlight_w_m2**2))) < 3.0 * steepness * noise:
        problem = "the known beds differ too little from the reference to determine the exchange of heat"
        raise CalibrationError(problem, fix="use steeper beds, or a longer time of sun")

    def residuals(parameters: FloatArray) -> FloatArray:
        scale, share = parameters
        predicted_k = share * emitted + (1.0 - share) * over_k
        # residuals in kelvin: the noise is in the temperatures, so D divides the sunlight
        off_k = sunlight_w_m2 / scale - predicted_k
        return np.append(off_k / noise, (share - expected_share) / prior_share_sd)

    fit = least_squares(residuals, [steepness, expected_share], x_scale=[steepness, 0.1])
    jacobian = np.asarray(fit.jac, np.float64)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    fitted, share = (float(value) for value in fit.x)
    fitted_sd, share_sd = (float(sd) for sd in np.sqrt(np.diag(covariance)))
    is_prior = share_sd > 0.5 * prior_share_sd
    summary = (
        f"D = {fitted:.2f} ± {fitted_sd:.2f} W/m2 per kelvin is measured; "
        f"its split into alpha and beta is {'the prior, not the data' if is_prior else 'measured as well'}; "
        "albedo, emissivity and exchange separately cannot be determined from temperatures"
    )
    alpha, beta = fitted * share / cube, fitted * (1.0 - share)
    return ExchangeFit(alpha, beta, fitted, fitted_sd, share_sd, is_prior, summary)
