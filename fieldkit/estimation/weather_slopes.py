"""Slopes of surfaces without a reference, by their temperature and the weather: a posterior of directions.

For each direction of a grid the balance of a surface is written in kelvin: absorbed light, longwave, exchange
with the air and stored heat, over what a kelvin loses, should leave nothing but an error that is normal with
a known covariance [1]_. Inputs that act linearly are integrated exactly (`_balance`); exchange, layer and
size of the noise by hypotheses. Nothing is compared with another surface, and nothing is learnt from one.

With one declination of the sun, tilt along the meridian and gain (absorbed light over exchange) are one
number. The answer therefore has its components to east and north apart, and says where the latter is open.

.. [1] C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press, 2006, eq.
   (2.30), and 2.7 for what is linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.balance import GROUND_ALBEDO_SD, MinuteLight
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.region_temperatures import remove_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import blank_estimate
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, SlopeState, is_too_wide
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import air_mass, clear_sky_longwave, ground_view, sky_view
from fieldkit.physics.facet import normal, tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share
from fieldkit.physics.slab import conducted_flux

ROW_MINUTES = 10
"""Minutes of a row: errors of air and exchange last longer, and the cost grows with the cube of the rows."""
LEAST_ROWS = 8
EDGE_ROWS = 2
"""Rows at either end of a day that are excluded: what is stored is not known well there."""
NIGHT_S = 6 * 3600.0
"""Without usable rows: another day begins."""
OF_SEVERAL_DAYS = 0.5
"""Exponent of the likelihood of several days: errors of air and wind repeat by the hour. Judged, because with
1 the regions of measured walls and modules hold the truth half as often as stated."""
MOST_NORTH_DEG = 15.0
"""Half width from which the component to the north counts as undetermined."""
FROST_K, FROST_S = 1.0, 3600.0
"""A surface this near to 0 degrees Celsius for so long by day melts or freezes: there is no term for it."""
UNSTATED_GAIN_SD = 0.3
"""Relative uncertainty of absorbed light above which the albedo is asked for."""
DIRECTIONS = 1500
EXCHANGE_SDS: FloatArray = np.linspace(-2.4, 2.4, 7)
LAYER_SDS: FloatArray = np.linspace(-3.0, 3.0, 9)
"""Hypotheses of exchange and layer's depth, in standard deviations of their logarithms by the prior."""
NOISES = (0.7, 1.4, 2.8)
"""Hypotheses of a factor on all standard deviations; the largest would explain anything."""
USUAL_WIND_M_S = 2.0
"""Wind at which a kind has its median exchange."""
GROUND_K_PER_W_M2, GROUND_SD = 0.012, 0.008
"""Ground around over the air, by global light: 12 K at 1000 W/m2."""
CIRCUMSOLAR, CIRCUMSOLAR_SD, CLOCK_SD_S, FLUX_SD_W_M2, LONGWAVE_SD_W_M2 = 0.7, 0.4, 180.0, 5.0, 15.0
GUST_SD, SHORT_GUST_SD = 0.25, 0.1
"""Relative changes of the exchange over 2 h, and over 15 min."""
WHITE_K, WHITE_LIGHT, WHITE_W_M2 = 0.15, 0.02, 3.0
"""Errors of single rows: of the temperature, of absorbed light, of any flux."""
ESTIMATED = ("plate", "wall")
NO_GROUND = (
    "{} cannot be estimated from the weather, only plates and walls can: ground conducts and evaporates; "
    "draw a flat piece of it as reference"
)
FROST = f"within {FROST_K:g} K of 0 °C for an hour by day: melting frost, snow or ice"
MISFIT = "no slope explains the temperatures in this weather"


class Weather(NamedTuple):
    """Standard uncertainties of light and diffuse light (relative), optical depth, longwave in W/m2, air in
    K, lasting and passing within `air_h`; rows have the sun above `low_sun_deg`.
    """

    light: float
    diffuse: float
    turbidity: float
    longwave_w_m2: float
    air_k: float
    passing_air_k: float
    air_h: float
    low_sun_deg: float


WEATHER = {
    "measured": Weather(0.02, 0.05, 0.01, 10.0, 0.5, 0.7, 3.0, 4.0),
    # a module was 2 to 3.5 K warmer than a satellite's air in clear nights, where 1 to 2 K colder is physical
    "model": Weather(0.05, 0.15, 0.04, 30.0, 1.0, 3.0, 5.0, 20.0),
}


def weather_slopes(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    """Slope of every target at the last minute bin of a history, by its own temperatures and the weather.

    All days of the history count, in whole rows of ten minutes before that bin. References are not used.
    Arguments and order are as of `slopes`.
    """
    corrected = remove_offsets(history, regions, settings)
    targets = RegionColumns(tuple(regions)).targets
    return tuple(_slope(corrected, column, regions[column], settings) for column in targets)


def _slope(history: History, column: np.int64, region: Region, settings: EstimatorSettings) -> SlopeEstimate:
    blank = blank_estimate(region, column, history, 0, settings)
    values = (history.temperature_k[:, column], history.dni_w_m2, history.air_k)
    names = ("temperatures of this region", "irradiance", "air temperature")
    lacking = [f"no {name}" for name, each in zip(names, values, strict=True) if not np.isfinite(each).any()]
    if lacking:
        return replace(blank, reason="; ".join(lacking))
    no_slope = replace(blank, state=SlopeState.NO_INTERSECTION)
    kind = settings.kinds.get(region.name, settings.kind)
    if kind not in ESTIMATED or region.name in settings.kinds:
        return replace(no_slope, reason=NO_GROUND.format(kind))
    rows, days = _rows(history, column, region, settings)
    used = sum(day.size for day in days)
    if not (days := [day for day in days if day.size >= LEAST_ROWS]):
        reason = f"{used} of {LEAST_ROWS} rows of {ROW_MINUTES} min with the sun high enough so far"
        return replace(blank, state=SlopeState.TOO_FEW, reason=reason, n_bins=used)
    if not (days := [day for day in days if not _freezes(rows.at(day))]):
        return replace(no_slope, reason=FROST)
    azimuth = region.azimuth_deg % 360.0 if settings.azimuth == "known" else math.nan
    normals, stored = directions(settings.tilt_limit_deg, azimuth), _stored(rows, settings)
    log_prior = -0.5 * np.sum((normals[:, :2] / settings.prior.normal_horizontal_sd) ** 2, axis=1)
    by_day = [log_likelihoods(rows.at(day), stored[:, day], normals, settings) for day in days]
    by_day = [day for day in by_day if np.logaddexp.reduce(day + log_prior, axis=1).argmax() < len(day) - 1]
    if not by_day:
        return replace(no_slope, reason=MISFIT)
    exponent = OF_SEVERAL_DAYS if len(by_day) > 1 else 1.0
    log_density = exponent * np.logaddexp.reduce(by_day, axis=1).sum(axis=0) + log_prior
    share = np.exp(log_density - np.logaddexp.reduce(log_density))
    filled = _with_posterior(replace(blank, n_bins=used), normals, share, settings, azimuth)
    return _with_state(filled, settings)


def _rows(
    history: History, column: np.int64, region: Region, settings: EstimatorSettings
) -> tuple[History, list[IntArray]]:
    """Rows of one region, its weather linear over gaps, and those of each day that can be used."""
    sunlit = sunlit_share(settings.horizon_of(region.name), history.sun, MINUTE_EDGE_DEG) == 1.0
    is_open = sunlit & ~history.is_shaded()[:, column]
    rows, is_lit = history.only(np.array([column])).averaged(ROW_MINUTES, is_open)
    air_k, longwave = (_linear(rows, values) for values in (rows.air_k, rows.longwave_down_w_m2))
    longwave = np.where(np.isnan(longwave), clear_sky_longwave(air_k), longwave)
    rows = replace(rows, air_k=air_k, longwave_down_w_m2=longwave)
    is_lit &= rows.sun[:, 2] > math.sin(math.radians(WEATHER[settings.air].low_sun_deg))
    is_lit &= np.isfinite(rows.temperature_k[:, 0] + MinuteLight.of(rows, settings).ghi)
    usable = np.flatnonzero(is_lit)
    nights = np.flatnonzero(np.diff(rows.time_ns[usable]) > NIGHT_S * SECOND_NS) + 1
    return rows, [day[EDGE_ROWS:-EDGE_ROWS] for day in np.split(usable, nights)]


def _linear(rows: History, values: FloatArray) -> FloatArray:
    """Values of rows, linear over gaps; NaN without any."""
    seen = np.isfinite(values)
    return np.interp(rows.time_ns, rows.time_ns[seen], values[seen]) if seen.any() else values


def _freezes(day: History) -> bool:
    near = np.abs(day.temperature_k[:, 0] - CELSIUS_ZERO_K) < FROST_K
    return bool(near.sum() * np.median(np.diff(day.time_ns)) >= FROST_S * SECOND_NS)


def _stored(rows: History, settings: EstimatorSettings) -> FloatArray:
    """Heat flux (layers, t) into layers of the depths of `LAYER_SDS`, W/m2."""
    seconds = (rows.time_ns - rows.time_ns[0]) / SECOND_NS
    step_s = float(np.median(np.diff(seconds)))
    steps_s = np.arange(0.0, seconds[-1] + 1.5 * step_s, step_s)
    kelvin = np.interp(steps_s, seconds, _linear(rows, rows.temperature_k[:, 0]))
    depths = settings.slab.depth_m * np.exp(LAYER_SDS * settings.prior.depth_log_sd)
    layers = (replace(settings.slab, depth_m=depth) for depth in depths.tolist())
    fluxes = [conducted_flux(layer, kelvin, step_s) for layer in layers]
    # a flux is the mean since the step before: that of a row is the mean of two
    halves = [[np.interp(seconds + later_s, steps_s, flux) for later_s in (0.0, step_s)] for flux in fluxes]
    return np.asarray(np.mean(halves, axis=1))


def directions(limit_deg: float, azimuth_deg: float = math.nan) -> FloatArray:
    """Unit normals (n, 3) up to a tilt: of equal areas on a spiral, or along an azimuth where it is known."""
    if math.isfinite(azimuth_deg):
        return normal(np.linspace(0.0, limit_deg, DIRECTIONS), azimuth_deg)
    place = np.arange(DIRECTIONS)
    up = 1.0 - (place + 0.5) / DIRECTIONS * (1.0 - math.cos(math.radians(limit_deg)))
    # turns by the golden angle: R. Swinbank and R. J. Purser, Q. J. R. Meteorol. Soc. 132, 1769, 2006
    return normal(np.degrees(np.arccos(up)), place * 180.0 * (3.0 - math.sqrt(5.0)))


def log_likelihoods(
    day: History, stored: FloatArray, normals: FloatArray, settings: EstimatorSettings
) -> FloatArray:
    """Logarithm of the probability of a day's rows for unit normals (n, 3), by noise: (noises, n).

    `stored` (layers, t) are heat fluxes into the layers of `LAYER_SDS`, W/m2; these and exchange are summed.
    """
    prior, emitted = settings.prior, settings.surface.emissivity_broadband * STEFAN_BOLTZMANN
    kelvin = day.temperature_k[:, 0]
    over, wind = kelvin - day.air_k, np.nan_to_num(day.wind_m_s - USUAL_WIND_M_S)
    gained, columns, white = _balance(day, normals, settings)
    air, gusts, fluxes = _covariances(day, settings)
    parts = []
    for sds in EXCHANGE_SDS.tolist():
        usual = prior.exchange_w_m2_k * math.exp(sds * prior.exchange_log_sd)
        exchange = np.maximum(usual + prior.wind_w_m2_k_per_m_s * wind, 1.0)
        loss = exchange + 4.0 * emitted * kelvin**3
        passing = air * np.outer(exchange, exchange) + gusts * np.outer(usual * over, usual * over) + fluxes
        root = np.linalg.cholesky(passing / np.outer(loss, loss) + np.diag((white / loss) ** 2 + WHITE_K**2))
        whitener = np.linalg.inv(root) / loss
        whitened = np.matmul(whitener, columns)
        sizes, axes = np.linalg.eigh(np.matmul(whitened.swapaxes(1, 2), whitened))
        rest = (gained - exchange * over) @ whitener.T
        for layer_sds, flux in zip(LAYER_SDS.tolist(), stored @ whitener.T, strict=True):
            residual = (rest - flux)[:, np.newaxis]
            squares = np.sum(residual**2, axis=(1, 2))
            along = np.matmul(np.matmul(residual, whitened), axes)[:, 0] ** 2
            log_weight = -0.5 * (sds**2 + layer_sds**2) - np.log(np.diagonal(root)).sum()
            sums = (squares, along, np.maximum(sizes, 0.0), over.size)
            parts.append([log_weight + _log_density(*sums, noise**2) for noise in NOISES])
    return np.asarray(np.logaddexp.reduce(parts, axis=0))


def _log_density(
    squares: FloatArray, along: FloatArray, sizes: FloatArray, count: int, variance: float
) -> FloatArray:
    """Logarithm of a normal density (n,) of covariance ``variance I + W W'`` for residuals of a `count`.

    By their squares (n,), the squares of their products with W along the eigenvectors of ``W'W`` and its
    eigenvalues (n, k).
    """
    explained = np.sum(along / (variance + sizes), axis=1)
    log_size = np.log1p(sizes / variance).sum(axis=1) + count * math.log(variance)
    return np.asarray(-0.5 * ((squares - explained) / variance + log_size))


def _balance(
    day: History, normals: FloatArray, settings: EstimatorSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Light and longwave less emission (n, t), its changes (n, t, k) by a standard uncertainty of each linear
    input, and the standard deviation (t,) of what belongs to a row, W/m2.
    """
    surface, weather, light = settings.surface, WEATHER[settings.air], MinuteLight.of(day, settings)
    emissivity, absorptance = surface.emissivity_broadband, 1.0 - surface.albedo
    sky, ground, kelvin = sky_view(normals[:, 2:]), ground_view(normals[:, 2:]), day.temperature_k[:, 0]
    facing = np.maximum(normals @ day.sun.T, 0.0)
    circumsolar = light.diffuse * light.circumsolar * (facing / light.cos_zenith - sky)
    direct, diffuse = light.beam * facing, light.diffuse * sky + CIRCUMSOLAR * circumsolar
    received = direct + diffuse + settings.ground_albedo * light.ghi * ground
    ground_k = day.air_k + GROUND_K_PER_W_M2 * light.ghi
    from_sky, from_ground = sky + (1.0 - emissivity) * ground, emissivity * STEFAN_BOLTZMANN * ground
    longwave = from_sky * day.longwave_down_w_m2 + from_ground * ground_k**4
    diffuse_sd = (weather if np.isfinite(day.dhi_w_m2).any() else WEATHER["model"]).diffuse
    by_wind = np.nan_to_num(day.wind_m_s - USUAL_WIND_M_S) * (kelvin - day.air_k)
    columns = (
        absorptance * math.hypot(settings.prior.gain_sd, weather.light) * received,
        absorptance * GROUND_ALBEDO_SD * light.ghi * ground,
        absorptance * CIRCUMSOLAR_SD * circumsolar,
        absorptance * diffuse_sd * diffuse,
        absorptance * weather.turbidity * air_mass(light.cos_zenith) * direct,
        absorptance * CLOCK_SD_S * np.gradient(received, day.time_ns / SECOND_NS, axis=1),
        emissivity * 4.0 * from_ground * ground_k**3 * GROUND_SD * light.ghi,
        emissivity * weather.longwave_w_m2 * from_sky,
        settings.prior.wind_sd_w_m2_k_per_m_s * by_wind,
        FLUX_SD_W_M2,
    )
    gained = absorptance * received + emissivity * (longwave - STEFAN_BOLTZMANN * kelvin**4)
    linear = np.stack([np.broadcast_to(column, gained.shape) for column in columns], axis=2)
    return gained, linear, np.hypot(WHITE_LIGHT * absorptance * light.ghi, WHITE_W_M2)


def _covariances(day: History, settings: EstimatorSettings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariances (t, t) of what passes: air in K2, exchange relative, fluxes in W2/m4."""
    weather, hours = WEATHER[settings.air], (day.time_ns - day.time_ns[0]) / SECOND_NS / 3600.0
    apart = np.abs(np.subtract.outer(hours, hours))
    matern = math.sqrt(3.0) * apart / weather.air_h
    air = weather.air_k**2 + weather.passing_air_k**2 * (1.0 + matern) * np.exp(-matern)
    # the mean of the exchange is a hypothesis, which its gusts must not undo
    centred = np.eye(hours.size) - 1.0 / hours.size
    gusts = GUST_SD**2 * centred @ np.exp(-apart / 2.0) @ centred + SHORT_GUST_SD**2 * np.exp(-apart / 0.25)
    longwave_sd = LONGWAVE_SD_W_M2 * settings.surface.emissivity_broadband
    return air, gusts, longwave_sd**2 * np.exp(-apart / 3.0) + FLUX_SD_W_M2**2 * np.exp(-apart / 2.0)


def _with_posterior(
    blank: SlopeEstimate,
    normals: FloatArray,
    share: FloatArray,
    settings: EstimatorSettings,
    azimuth_deg: float,
) -> SlopeEstimate:
    """The estimate with mean direction, region of highest density and components, by shares of normals."""
    mean = share @ normals / np.linalg.norm(share @ normals)
    tilt, azimuth = (float(angle) for angle in tilt_azimuth(mean))
    order = np.argsort(-share)
    count = 1 + int(np.searchsorted(np.cumsum(share[order]), blank.confidence))
    tilts, azimuths = tilt_azimuth(normals[order[:count]])
    turned, limit = (azimuths - azimuth + 180.0) % 360.0 - 180.0, settings.tilt_limit_deg
    # a normal stands for a cell, of the spiral a disc of its area
    cell = math.degrees(math.sqrt(2.0 * (1.0 - math.cos(math.radians(limit))) / DIRECTIONS))
    if math.isfinite(azimuth_deg):
        azimuth, turned, cell = azimuth_deg, np.zeros(1), 0.0
    low = max(float(tilts.min()) - cell, 0.0)
    side = cell / math.sin(math.radians(tilt)) if low else 180.0
    ends = azimuth + np.clip((turned.min() - side, turned.max() + side), -180.0, 180.0)
    numbers = {
        "tilt": (tilt, low, min(float(tilts.max()) + cell, limit)),
        "azimuth": (azimuth, *ends.tolist()),
    }
    for name, values, middle in zip(("east", "north"), normals.T, mean, strict=False):
        order = np.argsort(values)
        tails = (0.5 * (1.0 - blank.confidence), 0.5 * (1.0 + blank.confidence))
        between = np.interp(tails, np.cumsum(share[order]), values[order])
        leans = np.degrees(np.arcsin((middle, *between))) + np.array((0.0, -cell, cell))
        numbers[name] = tuple(np.clip(leans, -90.0, 90.0).tolist())
    names = [f"{name}_{end}" for name in numbers for end in ("deg", "low_deg", "high_deg")]
    return replace(blank, **dict(zip(names, chain.from_iterable(numbers.values()), strict=True)))


def _with_state(filled: SlopeEstimate, settings: EstimatorSettings) -> SlopeEstimate:
    """The estimate with its state: certain where north and south are determined and the albedo stated."""
    low, high = filled.tilt_low_deg, filled.tilt_high_deg
    north = 0.5 * (filled.north_high_deg - filled.north_low_deg)
    east = f"{filled.east_deg:.1f}° ({filled.east_low_deg:.1f}° to {filled.east_high_deg:.1f}°)"
    causes = {
        f"north–south undetermined (±{north:.0f}°); component to the east {east}": north > MOST_NORTH_DEG,
        f"anything from {low:.1f}° to {high:.1f}° fits": bool(
            is_too_wide(filled.tilt_deg, filled.tilt_half_width_deg, settings.target_half_width_deg)
        ),
        "state surface.albedo": settings.prior.gain_sd > UNSTATED_GAIN_SD,
    }
    reason = "; ".join(words for words, applies in causes.items() if applies)
    return replace(filled, state=SlopeState.WIDE if reason else SlopeState.OK, reason=reason)
