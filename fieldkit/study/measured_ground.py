"""A record of measured ground: a radiometer that looks at it beside a weather station, minute by minute."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.facet import FloatArray

DAY_MIN = 1440
_GROUND = "ground_radiometer_c"
_WEATHER = (
    "air_c",
    "wind_m_s",
    "shortwave_down_w_m2",
    "shortwave_up_w_m2",
    "longwave_down_w_m2",
    "sun_zenith_apparent_deg",
)


@dataclass(frozen=True, slots=True)
class MeasuredGround:
    """Minutes of flat ground and its weather, arrays (n,), at least a day; NaN only in `surface_k`."""

    name: str
    surface_k: FloatArray
    air_k: FloatArray
    wind_m_s: FloatArray
    shortwave_down_w_m2: FloatArray
    shortwave_up_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    daylight: NDArray[np.bool_]


def read_measured_ground(path: Path) -> MeasuredGround:
    """Read a table of measured ground.

    Parameters
    ----------
    path
        CSV with one row a minute and the columns minute, ground_radiometer_c, air_c, wind_m_s,
        shortwave_down_w_m2, shortwave_up_w_m2, longwave_down_w_m2 and sun_zenith_apparent_deg; others are
        ignored.

    Returns
    -------
    The record; the sun is up in rows with a zenith angle below 90 degrees.

    Raises
    ------
    ConfigError
        If a column is missing, a cell is not a number, minutes are missing, or there is less than a day.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        columns = {
            name: np.array([float(row[name] or "nan") for row in rows])
            for name in ("minute", _GROUND, *_WEATHER)
        }
    except KeyError as missing:
        raise ConfigError(f"{path} has no column {missing}", fix="see `fieldkit study --help`") from None
    except (OSError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{path} is not a table of measured ground: {message_of(error)}", fix="give a CSV file of numbers"
        ) from error
    _check(path, columns)
    return MeasuredGround(
        name=path.stem,
        surface_k=columns[_GROUND] + CELSIUS_ZERO_K,
        air_k=columns["air_c"] + CELSIUS_ZERO_K,
        wind_m_s=columns["wind_m_s"],
        shortwave_down_w_m2=columns["shortwave_down_w_m2"],
        shortwave_up_w_m2=columns["shortwave_up_w_m2"],
        longwave_down_w_m2=columns["longwave_down_w_m2"],
        daylight=columns["sun_zenith_apparent_deg"] < 90.0,
    )


def _check(path: Path, columns: dict[str, FloatArray]) -> None:
    minutes = columns["minute"]
    if minutes.size < DAY_MIN:
        raise ConfigError(f"{path} has {minutes.size} minutes", fix=f"give at least a day, {DAY_MIN}")
    if np.any(np.diff(minutes) != 1.0):
        row = int(np.argmax(np.diff(minutes) != 1.0))
        raise ConfigError(f"{path} has a gap after minute {minutes[row]:g}", fix="fill it, or cut the record")
    for name in _WEATHER:
        if not np.all(np.isfinite(columns[name])):
            row = int(np.argmin(np.isfinite(columns[name])))
            raise ConfigError(
                f"{path} has no {name} in minute {minutes[row]:g}", fix="fill it, or cut the record"
            )
