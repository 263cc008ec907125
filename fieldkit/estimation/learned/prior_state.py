"""The state before any data: what relaxes and how fast, means, and covariances of all places.

A state is normally distributed before the first minute. Stores begin as a level that is hardly known and as
what unknown fluxes of the hours before have left in them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs
from fieldkit.estimation.learned.layout import GUSTS, Layout
from fieldkit.estimation.learned.noise import Noise
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.physics.layer_modes import RATES_PER_S

GUST_MINUTES: FloatArray = np.array([2.0, 6.0, 20.0])
"""Time constants of the gusts' parts.

Judged: because three of them follow f**(-5/3) over the minutes that matter; one alone put the inertia of
simulated sand 30 to 60 % off.
"""
GUST_SHARES: FloatArray = np.sqrt(GUST_MINUTES ** (2.0 / 3.0) / np.sum(GUST_MINUTES ** (2.0 / 3.0)))
"""Standard deviations of the gusts' parts over that of all: together nearly f**(-5/3), as turbulence has.

A. N. Kolmogorov's law of the inertial range (1941), carried to the exchange by the wind.
"""
SLOW_MINUTES = 30.0
"""Time constant of the drive of slow changes of the exchange, and of what follows it: twice over, an hour.

Judged: because the wind of a day freshens and dies away over about an hour.
"""
COMMON_MINUTES = 20.0
"""The same of fluxes that the model has no term for, 40 min in all.

Judged: because what is missing in the sky's light and longwave goes with its clouds.
"""
AIR_MINUTES = 30.0
"""The same of the air at the beds against that of the thermometer, or of the usual.

Judged: because the air over warm ground changes as slowly as the wind that exchanges it.
"""
DRYING_MINUTES = 35.0
"""Time in which the flux that dries one bed alone falls to 1/e.

Judged: because moisture of the uppermost millimetres lasts for half an hour of sun; beds that dried over 20
to 80 min were held by it.
"""
DRYING_W_M2 = 60.0
"""Standard deviation of that flux in the first minute.

Judged: because 0.1 mm of water that evaporates within an hour takes 70 W/m2.
"""
SMOOTHED = float(np.sqrt(2.0))
"""Standard deviation of a drive over that of the process which follows it with the same time constant.

Exact: two equal first-order lags in a row halve the variance.
"""
AIR_CHANGE_K = 1.5
"""Change of an air temperature that is not logged, over `AIR_MINUTES`.

Judged: because air over dry ground moves by one or two kelvins within the hour beside its daily course; the
minutes scale it (unrest).
"""
AIR_NOISE_K = 0.1
"""Change of the air at the beds against a thermometer that logs it, over `AIR_MINUTES`.

Judged: because a shaded thermometer nearby follows the same air, to the resolution of its reading.
"""
AIR_DRIFT_K_PER_H = 1.5
"""Change of an air temperature that is not logged any more, or never was, besides what is usual.

Judged: because a morning warms by that much in an hour; a random walk instead of a line was rough, and quiet
minutes contradicted it.
"""
LEVEL_SD_K = 15.0
"""Temperature of a region's layer before the first minute, against its first reading.

Judged: because it should decide nothing: the first minutes show the level far better.
"""
PAST_MINUTES: FloatArray = np.array([0.0, 4.0, 12.0, 36.0, 108.0, 300.0])
"""Bounds of the bins of time before the first minute in which the net flux was one unknown number each.

Judged: because each is three times as long as the one before, as the layer's memory fades by its stores of 1
to 125 min; what lies farther back is in the level.
"""
PAST_SHARE, PAST_HOLDS_MIN = 0.5, 60.0
"""Share of the net flux of a region's first minute that was there before it, and for how long: an e-folding
time backwards.

Judged: because beds that lie out for hours before a session at noon take up about as much in its first minute
as before, for as long as the sun stays. With none of it a bed that does not warm had to lose what it absorbs:
slopes came out too steep. With all of it exchange of one bed's own for minutes made them too flat.
"""
PAST_ALIKE = 0.9
"""Correlation of the fluxes of neighbouring bins.

Judged: because ground takes up heat as slowly as the sun climbs. With bins that know nothing of each other a
quiet beginning, which every bed has that lies out for long, spoke for a high inertia.
"""
LEAST_UP_SD, UP_SHARE = 0.15, 0.6
"""Standard deviation of a normal's vertical component: at least, and as a share of a horizontal one's.

Judged: because in the filter a normal has no unit length yet; a narrow vertical component would be a second
prior of the gain.
"""
OWN_LENGTH_SD = 0.5
"""Length of a stated normal times the gain, apart from the gain.

Judged: because it should decide nothing: what a bed absorbs more or less has its prior in `normals`.
"""
DIRECT_SD = 0.07
"""Relative, of direct light that is a reading less an assumed share of diffuse light.

0.15 x 0.4 / 0.85: a diffuse fraction of 0.15 that is known to 40 %, over what it leaves.
"""
ALBEDO_SD = 0.0625
"""Relative, of the absorptance of sand whose albedo is 0.20 within 0.05: 0.05 / 0.80."""

DAY_TO_DAY: Mapping[str, float] = {"gain": 0.03, "thermal_inertia": 0.08, "depth": 0.06}
"""Relative changes from one day to the next, as standard deviations.

Judged: because of the light meter's response to another sun and to dust; the air's moisture in dry sand;
raking and settling of some 2 mm in 3 cm.
"""


def processes(
    layout: Layout, prior: Prior, hypotheses: Hypotheses, logged: Logged, noise: Noise
) -> dict[int, tuple[FloatArray, float]]:
    """Standard deviation (p,) and time constant in minutes of what relaxes and is driven by chance, by place.

    A smooth process follows its drive with the same time constant. Chance moves it over tens of minutes but
    not from one to the next; otherwise quiet minutes would be taken for a high inertia.
    """
    unrest, usual = SMOOTHED * hypotheses.unrest, prior.exchange_w_m2_k
    by_place = {
        layout.place("slow_gust_drive"): (unrest * prior.slow_gust_sd * usual, SLOW_MINUTES),
        layout.place("common_flux_drive"): (unrest * prior.common_flux_sd_w_m2, COMMON_MINUTES),
        layout.place("air_change_drive"): (air_change_k(hypotheses, prior, logged.air), AIR_MINUTES),
    }
    for name, share, minutes in zip(GUSTS, GUST_SHARES, GUST_MINUTES, strict=True):
        by_place[layout.place(name)] = (share * hypotheses.gust, float(minutes))
    for target in range(layout.targets):
        spread = unrest * prior.own_slow_exchange * usual * layout.unlike_of(target).exchange
        by_place[layout.slow_exchange_drive(target)] = (spread, SLOW_MINUTES)
    for region in range(layout.regions):
        by_place[layout.own(region)] = (np.full(hypotheses.exchange.size, noise.own_k), noise.own_minutes)
    return by_place


def air_change_k(hypotheses: Hypotheses, prior: Prior, is_logged: bool) -> FloatArray:
    """Standard deviation (p,) of the drive of the air's changes, K.

    Without a log they are one flux into the ground under every hypothesis, at whatever unrest.
    """
    if is_logged:
        return SMOOTHED * hypotheses.unrest * AIR_NOISE_K
    return SMOOTHED * AIR_CHANGE_K * prior.exchange_w_m2_k / hypotheses.exchange


def prior_mean(
    layout: Layout, settings: EstimatorSettings, first: MinuteInputs, logged: Logged
) -> FloatArray:
    """Prior mean (n,)."""
    mean = np.zeros(layout.size)
    for region in range(layout.regions):
        mean[layout.stores(region).start] = first.temperature_k[region]
    mean[layout.place("gain")] = settings.scale
    # to a camera that reads high the air would be warmer by as much
    mean[layout.place("air")] = logged.camera_k
    mean[layout.place("circumsolar")] = settings.prior.circumsolar_share
    mean[layout.place("brightening")] = settings.prior.brightening_share
    mean[layout.place("wind")] = settings.prior.wind_w_m2_k_per_m_s
    for target in range(layout.targets):
        up, _ = upwards(layout.unlike_of(target).normal_horizontal_sd)
        mean[layout.normal(target)] = settings.scale * up * layout.facing[target][2]
    for target in range(layout.stated):
        mean[layout.normal(target)] = settings.scale * layout.stated_normal(target)
    return mean


def prior_sds(settings: EstimatorSettings, logged: Logged) -> dict[str, float]:
    """Prior standard deviations of the constants that all regions share, by name."""
    prior = settings.prior
    air_sd_k = prior.air_sd_k if logged.air else prior.air_unlogged_sd_k
    return {
        "gain": float(np.hypot(gain_sd(settings), 0.0 if logged.diffuse else DIRECT_SD)),
        "diffuse": prior.diffuse_sd if logged.diffuse else prior.diffuse_unmeasured_sd,
        "circumsolar": prior.circumsolar_sd,
        "brightening": prior.brightening_sd,
        "air_drift": AIR_DRIFT_K_PER_H,
        "wind": prior.wind_sd_w_m2_k_per_m_s,
        "longwave": prior.longwave_sd_w_m2,
        "air": float(np.hypot(air_sd_k, logged.camera_sd_k)),
    }


def upwards(horizontal: float) -> tuple[float, float]:
    """Prior mean and standard deviation of the vertical component of a unit normal, by a horizontal one's."""
    return float(np.sqrt(max(1.0 - 2.0 * horizontal**2, 0.1))), max(LEAST_UP_SD, UP_SHARE * horizontal)


def gain_sd(settings: EstimatorSettings) -> float:
    """Prior standard deviation of the gain: as stated, or a calibrated meter's factor and the albedo."""
    calibrated = float(np.hypot(settings.factor_sd, ALBEDO_SD))
    return min(settings.prior.gain_sd, calibrated) if settings.factor_sd > 0.0 else settings.prior.gain_sd


def prior_covariance(
    layout: Layout,
    settings: EstimatorSettings,
    hypotheses: Hypotheses,
    logged: Logged,
    noise: Noise,
) -> FloatArray:
    """Prior covariance (p, n, n); stores by past fluxes and an unknown level."""
    prior = settings.prior
    variance = np.zeros((hypotheses.exchange.size, layout.size))
    unlike = noise.unlike(hypotheses.unrest)
    for name, sd in prior_sds(settings, logged).items():
        variance[:, layout.place(name)] = sd**2
    for place, (spread, _) in processes(layout, prior, hypotheses, logged, noise).items():
        variance[:, place] = spread**2
    for target in range(layout.targets):
        vertical, own = layout.facing[target][2], layout.unlike_of(target)
        # a known azimuth does not make a bed flatter: its one component is as long as two otherwise are
        horizontal = own.normal_horizontal_sd * np.sqrt(4 - vertical.size)
        sds = np.where(vertical > 0.0, upwards(own.normal_horizontal_sd)[1], horizontal)
        variance[:, layout.normal(target)] = sds**2
        lasting = np.hypot(unlike * prior.own_exchange, own.exchange_sd) * hypotheses.exchange * own.exchange
        variance[:, layout.own_exchange(target)] = lasting**2
        variance[:, layout.drying(target)] = DRYING_W_M2**2
        variance[:, layout.own_response(target)] = (unlike * prior.own_inertia_sd) ** 2 + own.inertia_sd**2
    variance[:, layout.level] = (settings.scale * layout.level_sds[0]) ** 2
    for region in range(1, layout.regions):
        variance[:, layout.offset(region)] = settings.offset_sd_k**2
        variance[:, layout.drift(region)] = settings.drift_sd_k_per_h**2
    covariance = np.zeros((*variance.shape, layout.size))
    covariance[:, range(layout.size), range(layout.size)] = variance
    for target in range(layout.stated):
        _state_slope(covariance, layout, target, settings.scale)
    offsets = slice(layout.offset(1), layout.offset(layout.regions - 1) + 1)
    covariance[:, offsets, offsets] += logged.emissivities_k2
    air, longwave = layout.place("air"), layout.place("longwave")
    together = logged.longwave_per_k * variance[:, air]  # a sky is as warm as its air
    covariance[:, longwave, longwave] += logged.longwave_per_k * together
    covariance[:, air, longwave] = covariance[:, longwave, air] = together
    # started as if it had long run: a process that follows its drive has half the drive's variance
    smooth, drives = (np.arange(layout.size)[places] for places in (layout.smooth, layout.drives))
    for rows, columns in ((smooth, smooth), (smooth, drives), (drives, smooth)):
        covariance[:, rows, columns] = variance[:, drives] / 2.0
    past = _past_fills()
    bins = np.arange(past.shape[1])
    alike = past @ PAST_ALIKE ** np.abs(bins[:, np.newaxis] - bins) @ past.T
    shared, alone = prior.past_flux_sd_w_m2**2 * alike, prior.bed_past_flux_sd_w_m2**2 * alike
    for here in range(layout.regions):
        for there in range(layout.regions):
            covariance[:, layout.stores(here), layout.stores(there)] = shared + (here == there) * alone
        level = layout.stores(here).start
        covariance[:, level, level] += LEVEL_SD_K**2
    return covariance


def _state_slope(covariance: FloatArray, layout: Layout, target: int, scale: float) -> None:
    """Enter into covariances (p, n, n) that the slope of a target is stated: it shows the gain."""
    along, places, gain = layout.stated_normal(target), layout.normal(target), layout.place("gain")
    gain_variance = covariance[0, gain, gain]
    square, level = np.outer(along, along), (scale * layout.level_sds[layout.region(target)]) ** 2
    covariance[:, places, places] = level * (np.eye(along.size) - square)
    covariance[:, places, places] += (gain_variance + OWN_LENGTH_SD**2) * square
    covariance[:, gain, places] = covariance[:, places, gain] = gain_variance * along


def past_of_first_flux(layout: Layout) -> FloatArray:
    """Stores (stores, regions) that the net flux of each region's first minute has filled before it."""
    middle = 0.5 * (PAST_MINUTES[:-1] + PAST_MINUTES[1:])
    filled = PAST_SHARE * _past_fills() @ np.exp(-middle / PAST_HOLDS_MIN)
    return np.asarray(np.kron(np.eye(layout.regions), filled[:, np.newaxis]), np.float64)


def _past_fills() -> FloatArray:
    """Seconds of the flux of each past bin that are left in level and stores (1 + MODES, bins)."""
    bounds_s = 60.0 * PAST_MINUTES
    rates = RATES_PER_S[1:, np.newaxis]
    remaining = (np.exp(-rates * bounds_s[:-1]) - np.exp(-rates * bounds_s[1:])) / rates
    # the level takes no flux, the store without loss keeps all of it, the others fade
    return np.vstack([np.zeros(remaining.shape[1]), np.diff(bounds_s), remaining])
