"""Inputs of the filters for each minute, from the minute bins.

A temperature that is missing is held from the minute before, and does not count as measured; light and
weather are as in `reading_gaps`. Minutes without any bin are bridged by straight lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.reading_gaps import WAIT_MIN, GapReading, reading_at
from fieldkit.estimation.region_temperatures import difference_covariance_k2
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.shade_evidence import DoubtfulShade, doubtful_shades, likely_shaded
from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.site import Region
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics import daylight
from fieldkit.physics.bodies import BODIES
from fieldkit.physics.climate import usual_air_k
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share

BRIDGED_MINUTES = 120
"""Longest gap between minutes that belong to one chain.

Judged: because the slowest store of a layer keeps 0.38 of its heat over that time; after longer gaps the past
is as unknown as before a session.
"""
EVERY_REGION = slice(None)


@dataclass(frozen=True, slots=True)
class MinuteInputs:
    """Inputs of one minute; arrays over the regions of a layout.

    Attributes
    ----------
    hours
        Since the first minute. [h]
    sun
        Unit vector to the sun (3,).
    temperature_k, measured
        Temperature of the regions; whether it was measured in this minute. [K]
    direct, direct_change, gap_sd
        Absorbed by a facet square to the sun; its change within the minute; the standard deviation of what
        heats it where readings are missing. [W/m2]
    diffuse, circumsolar, reflected
        Absorbed from the whole sky by a level facet; Hay and Davies' circumsolar share; absorbed from the
        ground by a facet that sees nothing else. [W/m2], [-]
    longwave_down, longwave_ground
        From the sky and from the ground. [W/m2]
    brightening, horizon
        Perez' circumsolar share less Hay and Davies', and the share of his horizon band. [-]
    air_k, air_stale_h
        Air temperature, logged or guessed; for how long it has not been logged. [K], [h]
    air_returns
        Whether it is logged from this minute on.
    wind_change
        Wind speed over the first one logged, 0 where none is. [m/s]
    shaded, sunlit
        Share of a minute that a region is under a board; share of the sun that its horizon leaves visible.
    is_edge
        Whether the board came or went within the minute, or the sun stands on the horizon.
    """

    hours: float
    sun: FloatArray
    temperature_k: FloatArray
    measured: BoolArray
    direct: float
    direct_change: float
    gap_sd: float
    diffuse: float
    circumsolar: float
    reflected: float
    longwave_down: float
    longwave_ground: float
    air_k: float
    shaded: FloatArray
    sunlit: FloatArray
    is_edge: BoolArray
    brightening: float
    horizon: float
    air_stale_h: float
    air_returns: bool
    wind_change: float

    def between(self, later: MinuteInputs, share: float) -> MinuteInputs:
        """Inputs of a minute without a bin, `share` of the way to a later one."""
        values = {
            name: (1.0 - share) * getattr(self, name) + share * getattr(later, name)
            for name in self.__slots__
            if name not in ("shaded", "is_edge", "air_returns")
        }
        values["measured"] = np.zeros_like(self.measured)
        values["direct_change"] = abs(later.direct - self.direct)
        return replace(self, **values)


@dataclass(frozen=True, slots=True)
class Logged:
    """Quantities measured in a chain's first minutes, by which priors are chosen.

    `longwave_per_k` is the longwave that a warmer air means where neither was measured. [W m-2 K-1]
    `camera_k` and `camera_sd_k` are the camera's error that all regions share, as contact probes in the
    regions show it, and its standard deviation. `emissivities_k2` is the covariance of the differences to the
    first region from uncertain emissivities (regions - 1, regions - 1). [K], [K2]
    """

    air: bool
    longwave: bool
    longwave_per_k: float
    diffuse: bool
    camera_k: float
    camera_sd_k: float
    emissivities_k2: FloatArray = field(compare=False)


class Recorded(NamedTuple):
    """A session: what it logs, and its minutes with those that were bridged."""

    logged: Logged
    minutes: list[MinuteInputs]


def logged_inputs(
    history: History, row: int, layout: Layout, regions: Sequence[Region], settings: EstimatorSettings
) -> Logged:
    """Quantities of the bins from a row on; `regions` are the columns of the history."""
    prior = settings.prior
    # one that is missing in the first minute alone is logged all the same
    begin = history.at(np.flatnonzero(history.minute <= history.minute[row] + WAIT_MIN)[row:])
    over_probe = begin.temperature_k[:, layout.columns] - begin.probe_k[:, layout.columns]
    probe_errors = np.concatenate([column[np.isfinite(column)][:1] for column in over_probe.T])
    # each probe is off by its own constant, so the mean of many is a measurement of the camera
    weight = probe_errors.size / prior.probe_sd_k**2
    information = weight + 1.0 / prior.camera_offset_sd_k**2
    air, longwave, diffuse = (
        bool(np.isfinite(column).any()) for column in (begin.air_k, begin.longwave_down_w_m2, begin.dhi_w_m2)
    )
    return Logged(
        air,
        longwave,
        0.0 if air or longwave else _longwave_per_k(settings, int(history.time_ns[row])),
        diffuse,
        float(weight * probe_errors.mean() / information) if probe_errors.size else 0.0,
        float(information**-0.5),
        difference_covariance_k2(
            _begin_k(history.temperature_k[row, layout.columns]),
            [regions[column] for column in layout.columns],
            settings,
        ),
    )


def _longwave_per_k(settings: EstimatorSettings, time_ns: int) -> float:
    """Longwave that a warmer air means where neither was measured, W m-2 K-1: of a clear sky on the Earth."""
    if not BODIES[settings.body].has_air_of_earth:
        return 0.0
    air_k = air_unlogged_k(math.nan, settings, time_ns)
    return 6.0 * float(daylight.clear_sky_longwave(air_k)) / air_k


def can_start(history: History, row: int, layout: Layout, required: BoolArray | slice = EVERY_REGION) -> bool:
    """True if a row has all wanted regions, and light unless the sun is down."""
    is_lit = history.sun[row, 2] > 0.0
    kelvin = history.temperature_k[row, layout.columns][required]
    return bool(np.isfinite(kelvin).all() and (not is_lit or np.isfinite(history.dni_w_m2[row])))


def first_row(history: History, layout: Layout) -> int | None:
    """The first row in which the first reference can be compared with all others that the history has."""
    required = np.asarray(np.isfinite(history.temperature_k[:, layout.columns]).any(axis=0))
    required[0] = True
    rows = range(len(history)) if required[1:].any() else ()
    return next((row for row in rows if can_start(history, row, layout, required)), None)


def minute_inputs(
    history: History,
    row: int,
    layout: Layout,
    settings: EstimatorSettings,
    before: MinuteInputs | None,
    start: int,
    shaded: BoolArray,
) -> MinuteInputs:
    """Inputs of the bin in a row, after those of the bin `before`; `start` is the first minute.

    `shaded` (2, regions) is its row of `shade`.
    """
    surface = settings.surface
    kelvin = history.temperature_k[row, layout.columns]
    measured = np.isfinite(kelvin)
    kelvin = np.where(measured, kelvin, _begin_k(kelvin) if before is None else before.temperature_k)
    cos_zenith = max(float(history.sun[row, 2]), 0.0)
    names = ("dni_w_m2", "dhi_w_m2", "longwave_down_w_m2", "air_k", "wind_m_s")
    light, skylight, longwave_read, air, wind = (reading_at(history, name, row) for name in names)
    direct, diffuse = light.value, _diffuse(light.value, skylight.value, cos_zenith, settings)
    absorptance = 1.0 - surface.albedo
    is_shaded, is_moved = shaded
    visible = sunlit(history.sun[row], layout)
    is_edge = is_moved | ((visible > 0.0) & (visible < 1.0))
    longwave, now_ns = longwave_read.value, int(history.time_ns[row])
    hours, is_logged = float(history.minute[row] - start) / 60.0, not math.isnan(air.value)
    stale_h = max(air.held_min - WAIT_MIN, 0.0) / 60.0 if is_logged else hours
    air_k = _held_air_k(air, now_ns, settings) if is_logged else air_unlogged_k(longwave, settings, now_ns)
    longwave = longwave if np.isfinite(longwave) else sky_longwave(air_k, settings)
    grey = surface.emissivity_broadband
    windy = settings.prior.wind_w_m2_k_per_m_s * (kelvin.mean() - air_k)
    by_air, by_wind = settings.prior.exchange_w_m2_k * air.sd, windy * wind.sd
    gap_sd = math.hypot(absorptance * light.sd, absorptance * skylight.sd, longwave_read.sd, by_air, by_wind)
    # the ground around, which the regions see, is taken to be as warm as the flattest reference
    ground_k = kelvin[0]
    top = float(daylight.extraterrestrial(history.time_ns[row], BODIES[settings.body]))
    circumsolar = settings.circumsolar_share * float(np.clip(direct / top, 0.0, 1.0))
    around_sun, band = circumsolar, 0.0
    if settings.circumsolar_share and BODIES[settings.body].has_air_of_earth and cos_zenith > 0.0:
        around_sun, band = map(float, daylight.perez_brightening(diffuse, direct, top, cos_zenith))
    return MinuteInputs(
        hours=hours,
        sun=history.sun[row].copy(),  # a view would keep the whole history
        temperature_k=kelvin,
        # a mean over a minute in which a shadow moved depends on when it did
        measured=measured & ~is_edge,
        direct=absorptance * direct,
        direct_change=0.0 if before is None else abs(absorptance * direct - before.direct),
        gap_sd=gap_sd,
        diffuse=absorptance * diffuse,
        circumsolar=circumsolar,
        reflected=absorptance * settings.ground_albedo * (direct * cos_zenith + diffuse),
        longwave_down=longwave,
        longwave_ground=float(grey * STEFAN_BOLTZMANN * ground_k**4 + (1.0 - grey) * longwave),
        air_k=air_k,
        shaded=np.where(is_moved, 0.5, is_shaded.astype(np.float64)),
        sunlit=visible,
        is_edge=is_edge,
        brightening=around_sun - circumsolar,
        horizon=band,
        air_stale_h=stale_h,
        air_returns=before is not None and before.air_stale_h > 0.0 and stale_h == 0.0,
        wind_change=_wind_change(wind, history, start),
    )


def minutes_between(
    history: History, first: int, end: int, layout: Layout, settings: EstimatorSettings
) -> list[MinuteInputs]:
    """Inputs of all minutes of the rows from `first` to before `end`, with those that have no bin."""
    start, shaded = int(history.minute[first]), shade(history, layout)
    minutes = [minute_inputs(history, first, layout, settings, None, start, shaded[first])]
    for row in range(first + 1, end):
        later = minute_inputs(history, row, layout, settings, minutes[-1], start, shaded[row])
        minutes.extend((*bridge(minutes[-1], later), later))
    return minutes


def recorded_session(
    history: History,
    first: int,
    end: int,
    layout: Layout,
    regions: Sequence[Region],
    settings: EstimatorSettings,
) -> Recorded:
    """The session of the rows from `first` to before `end`; `regions` are the columns of the history."""
    minutes = minutes_between(history, first, end, layout, settings)
    return Recorded(logged_inputs(history, first, layout, regions, settings), minutes)


def _begin_k(kelvin: FloatArray) -> FloatArray:
    """Temperatures to begin with: a region that is not measured is taken to be as warm as the first."""
    return np.where(np.isfinite(kelvin), kelvin, kelvin[0])


def _wind_change(wind: GapReading, history: History, start: int) -> float:
    """A wind speed over the first one logged, 0 without any."""
    logged = history.wind_m_s[(history.minute >= start) & np.isfinite(history.wind_m_s)]
    return wind.value - float(logged[0]) if logged.size and not math.isnan(wind.value) else 0.0


def shade(history: History, layout: Layout) -> BoolArray:
    """Regions shaded in each row, and those whose shade begins or ends there (n, 2, regions).

    Apart from the shadow of their horizon, and as far as temperatures do not contradict marks.
    """
    shaded = likely_shaded(*_flagged(history, layout))
    before, after = np.vstack([shaded[:1], shaded[:-1]]), np.vstack([shaded[1:], shaded[-1:]])
    return np.stack([shaded, shaded & ~(before & after)], axis=1)


def doubtful(history: History, layout: Layout, regions: Sequence[Region]) -> list[DoubtfulShade]:
    """Shade that the temperatures contradict; `regions` are the columns of the history."""
    return doubtful_shades(*_flagged(history, layout), [regions[column].name for column in layout.columns])


def _flagged(history: History, layout: Layout) -> tuple[BoolArray, History]:
    """Shade of a layout's regions as flagged, but for that of their horizon (n, regions); their history."""
    chosen = history.only(layout.columns)
    flagged = chosen.is_shaded()
    rows = flagged.any(axis=1)
    flagged[rows] &= sunlit(history.sun[rows], layout) == 1.0
    return flagged, chosen


def sunlit(sun: FloatArray, layout: Layout) -> FloatArray:
    """Share of the sun that the regions' horizons leave visible (..., regions), by sun vectors (..., 3)."""
    shares = [sunlit_share(horizon, sun, MINUTE_EDGE_DEG) for horizon in layout.horizons]
    return np.stack(shares, axis=-1)


def bridge(before: MinuteInputs, after: MinuteInputs) -> Iterator[MinuteInputs]:
    """The minutes without a bin between two others."""
    minutes = round(60.0 * (after.hours - before.hours))
    for minute in range(1, minutes):
        yield before.between(after, minute / minutes)


def _diffuse(direct: float, read: float, cos_zenith: float, settings: EstimatorSettings) -> float:
    """Diffuse irradiance, W/m2: as read, or a fixed share of the global; none at night."""
    share = settings.diffuse_fraction / (1.0 - settings.diffuse_fraction)
    diffuse = share * direct * cos_zenith if math.isnan(read) else read
    return max(diffuse, 0.0) if cos_zenith > 0.0 else 0.0


def _held_air_k(air: GapReading, now_ns: int, settings: EstimatorSettings) -> float:
    """An air temperature; one held for long changes as the air usually does by then.

    Smoothing would part it from the sun that warms it.
    """
    if air.held_min <= WAIT_MIN or settings.site is None or not BODIES[settings.body].has_air_of_earth:
        return air.value
    read_ns = now_ns - round(air.held_min * MINUTE_NS)
    then_k, now_k = usual_air_k(np.array([read_ns, now_ns]), settings.site).tolist()
    return air.value + float(now_k - then_k)


def sky_longwave(air_k: float, settings: EstimatorSettings) -> float:
    """Longwave where it is not measured, W/m2: of the Earth's clear sky over the air, or as configured.

    One fixed number is 100 W/m2 too much over a high plateau in winter.
    """
    if np.isfinite(air_k) and BODIES[settings.body].has_air_of_earth:
        return float(daylight.clear_sky_longwave(air_k))
    return settings.longwave_down_w_m2


def air_unlogged_k(longwave_w_m2: float, settings: EstimatorSettings, time_ns: int) -> float:
    """Air temperature where it is not logged, K.

    On the Earth the usual one of place, date and hour, without a site that under a clear sky of the longwave
    (NaN where not measured): winter skies over high plateaus make that 10 K too cold. Elsewhere the body's.
    """
    body = BODIES[settings.body]
    if not body.has_air_of_earth:
        return body.air_temperature_k
    if settings.site is None:
        is_measured = np.isfinite(longwave_w_m2)
        return float(
            daylight.air_under_clear_sky(longwave_w_m2 if is_measured else settings.longwave_down_w_m2)
        )
    return float(usual_air_k(time_ns, settings.site))
