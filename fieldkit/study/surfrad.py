"""The surface models against days of SURFRAD, NOAA's radiation network.

Each file by itself: the paper's eq. (7) with and without diffuse irradiance, and fits within the
sample, within three hours of the highest sun. Files of one station that follow each other:
models trained on the first local day and tried on the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.physics.sun import sun_vectors
from fieldkit.study.output import Rows
from fieldkit.study.surface_models import Score, Station, as_printed, families
from fieldkit.weather import Weather, read_station_file

EMISSIVITIES = (0.90, 0.97)
FITTED_EMISSIVITY = 0.97
_INCOMING_COLUMN, _REFLECTED_COLUMN = 8, 10
_DARK_W_M2 = 20.0  # below, the ratio of two small numbers is noise


@dataclass(frozen=True)
class SurfradComparison:
    """Errors of surface models: on their own day, and on the day after the one they were fitted to."""

    within_sample: Rows
    next_day: Rows


def compare(paths: Sequence[Path]) -> SurfradComparison:
    """Compare the surface models with SURFRAD daily files. Raises `ConfigError`."""
    days = [read(path) for path in paths]
    alone = [row for path, day in zip(paths, days, strict=True) for row in within_sample(path.name, day)]
    return SurfradComparison(alone, next_day(days))


def within_sample(name: str, day: tuple[Weather, FloatArray]) -> Rows:
    """RMSE and bias of models on their own day, within three hours of the highest sun."""
    station = _station([day])
    midday = station.midday(np.ones(station.time_s.size, np.bool_))
    rows = []
    for emissivity in EMISSIVITIES:
        measured = station.surface_k(emissivity)
        for with_diffuse, words in ((False, "direct only"), (True, "plus diffuse")):
            printed = as_printed(emissivity, with_diffuse=with_diffuse).temperature_k(station)
            score = Score.of(printed, measured, midday)
            rows.append(_row(name, f"eq. (7), Table 1, {words}", emissivity, score))
    measured = station.surface_k(FITTED_EMISSIVITY)
    for family in families(FITTED_EMISSIVITY):
        if not family.whole_day:
            score = Score.of(family.fitted(station, midday).temperature_k(station), measured, midday)
            rows.append(_row(name, family.name, FITTED_EMISSIVITY, score))
    return rows


def next_day(days: Sequence[tuple[Weather, FloatArray]]) -> Rows:
    """RMSE on the second local day of models trained on the first, where two files follow each other."""
    days = sorted(days, key=lambda day: int(day[0].time_ns[0]))
    pairs = [pair for pair in pairwise(days) if _follow(*pair)]
    return [row for pair in pairs for row in _trained(_station(pair), pair[0][0])]


def _follow(first: tuple[Weather, FloatArray], second: tuple[Weather, FloatArray]) -> bool:
    gap = int(second[0].time_ns[0] - first[0].time_ns[-1])
    return first[0].site == second[0].site and 0 < gap <= 120_000_000_000


def _trained(station: Station, weather: Weather) -> Rows:
    # solar days, so that no clock of law cuts a night in two
    hours = station.time_s / 3600.0 + weather.time_ns[0] / 3.6e12 + weather.site.longitude_deg / 15.0
    day = np.floor(hours / 24.0).astype(np.int64)
    train, test = day == day[0] + 1, day == day[0] + 2
    emissivity, rows = FITTED_EMISSIVITY, []
    spans = {"daylight": test & station.daylight, "midday": station.midday(test), "all": test}
    grounds = {"eq. (7), Table 1, direct only": as_printed(emissivity, with_diffuse=False)}
    for family in families(emissivity):
        learnt = train if family.whole_day else train & station.daylight
        grounds[family.name] = family.fitted(station, learnt)
    measured = station.surface_k(emissivity)
    for name, ground in grounds.items():
        modelled = ground.temperature_k(station)
        scores = {span: Score.of(modelled, measured, chosen).rmse_k for span, chosen in spans.items()}
        rows.append(
            {"model, trained the day before": name} | {f"{span}, RMSE K": v for span, v in scores.items()}
        )
    return rows


def read(path: Path) -> tuple[Weather, FloatArray]:
    """The day and its albedo by the minute; the station is identified by its place."""
    albedo = _albedo(path)
    return read_station_file(path), albedo


def _albedo(path: Path) -> FloatArray:
    try:
        incoming, reflected = np.loadtxt(path, skiprows=2, usecols=(_INCOMING_COLUMN, _REFLECTED_COLUMN)).T
    except (ValueError, IndexError) as error:
        raise ConfigError(
            f"{path} is not a SURFRAD daily file: {message_of(error)}", fix="name it slv16001.dat"
        ) from error
    bright = incoming > _DARK_W_M2
    ratio = np.where(bright, reflected / np.where(bright, incoming, 1.0), np.nan)
    typical = float(np.nanmedian(ratio)) if bright.any() else 0.2
    return np.clip(np.where(bright, ratio, typical), 0.0, 1.0)


def _station(days: Sequence[tuple[Weather, FloatArray]]) -> Station:
    joined = {
        field.name: np.concatenate([getattr(weather, field.name) for weather, _ in days])
        for field in fields(Weather)
        if field.name not in ("site", "source")
    }
    time_ns = joined["time_ns"]
    return Station(
        time_s=(time_ns - time_ns[0]) / 1e9,
        cos_zenith=sun_vectors(time_ns, days[0][0].site, refraction=True)[:, 2],
        dni_w_m2=joined["dni_w_m2"],
        diffuse_w_m2=joined["dhi_w_m2"],
        longwave_down_w_m2=joined["longwave_down_w_m2"],
        longwave_up_w_m2=joined["longwave_up_w_m2"],
        air_k=joined["air_temperature_k"],
        wind_m_s=joined["wind_m_s"],
        albedo=np.concatenate([albedo for _, albedo in days]),
    )


def _row(name: str, model: str, emissivity: float, score: Score) -> dict[str, Any]:
    return {
        "file": name,
        "model": model,
        "emissivity": emissivity,
        "rmse_k": score.rmse_k,
        "bias_k": score.bias_k,
    }
