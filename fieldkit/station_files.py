"""Measured weather in the files of the radiation networks, told apart by what stands in them.

SURFRAD's daily files are read by `fieldkit.weather`, BSRN's monthly station-to-archive files by
pvlib, which the `lab` extra brings. Both say where the station stands.

BSRN labels the *start* of each averaged minute (GCOS-174, "Update of the Technical Plan for BSRN
Data Management", 2013), or of three where a station averaged longer; `Weather.time_ns` is its middle.
"""

from __future__ import annotations

import gzip
import io
import re
import warnings
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site, zone_by_longitude
from fieldkit.weather import STATIONS, FloatArray, Weather, half_step_ns, read_surfrad

if TYPE_CHECKING:
    import pandas as pd

_MOST_BYTES = 100_000_000  # a month of BSRN with every record is a tenth of it
_SURFRAD_PLACE = re.compile(rb"[^\n]*\n\s*(-?[\d.]+)\s+(-?[\d.]+)\s+-?[\d.]+\s+m\s+version")
_BSRN_START = re.compile(rb"\*[UC]0001")
_NEAR_DEG = 0.1


def is_station_file(path: Path) -> bool:
    """Whether a file is one of SURFRAD's or BSRN's."""
    try:
        head = _content(path, 4096)
    except (OSError, EOFError, zlib.error):
        return False
    return bool(_BSRN_START.match(head) or _SURFRAD_PLACE.match(head))


def read_station_file(path: Path) -> Weather:
    """Weather from a file of SURFRAD or BSRN, NaN where not measured or marked bad.

    Raises `ConfigError` if the file is neither, is damaged, or pvlib is not installed.
    """
    try:
        content = _content(path, _MOST_BYTES)
        if len(content) == _MOST_BYTES:
            raise ConfigError(
                f"{path} has more than {_MOST_BYTES // 10**6} MB", fix="take one day, or one month"
            )
        if _BSRN_START.match(content):
            return _bsrn(path, content.decode("ascii", errors="replace"))
        station = _surfrad_station(path, content)
        if not path.read_bytes().startswith(content[:2]):
            raise ConfigError(f"{path} is packed", fix=f"unpack it first: gunzip {path}")
        return read_surfrad(path, station)
    except ConfigError:
        raise
    except (OSError, EOFError, zlib.error, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> ConfigError:
    return ConfigError(
        f"{path} is damaged: {error}", fix="fetch it again from SURFRAD or BSRN, and do not edit it"
    )


def _content(path: Path, most: int) -> bytes:
    """The first `most` bytes, uncompressed."""
    with path.open("rb") as file:
        if file.read(2) != b"\x1f\x8b":
            file.seek(0)
            return file.read(most)
    with gzip.open(path) as packed:
        return packed.read(most)


def _surfrad_station(path: Path, content: bytes) -> str:
    """Whose file it is, by the place in its second line; the sign of a longitude cannot be relied on."""
    found = _SURFRAD_PLACE.match(content)
    if found is None:
        raise ConfigError(
            f"{path} is not a SURFRAD daily file, nor one of BSRN",
            fix="give a file as the network names it, like slv16001.dat or tat0624.dat.gz",
        )
    latitude, longitude = float(found[1]), float(found[2])
    for name, site in STATIONS.items():
        apart = abs(latitude - site.latitude_deg), abs(abs(longitude) - abs(site.longitude_deg))
        if max(apart) <= _NEAR_DEG:
            return name
    raise ConfigError(f"{path} is of no SURFRAD station known here", fix=f"known: {', '.join(STATIONS)}")


def _bsrn(path: Path, text: str) -> Weather:
    try:
        from pvlib.iotools import read_bsrn
    except ImportError as error:
        raise ConfigError("files of BSRN need pvlib", fix="pip install 'fieldkit[lab]'") from error
    records = ("0100", "0300") if re.search(r"^\*[UC]0300", text, re.MULTILINE) else ("0100",)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pvlib still asks pandas for what pandas is about to drop
            table, about = read_bsrn(io.StringIO(text), logical_records=records)
    except Exception as error:  # pandas has exceptions of its own for whatever it stumbles over
        raise _damaged(path, error) from error
    if table.empty or not about:
        raise ConfigError(
            f"{path} has no basic radiation (logical record 0100)", fix="fetch the whole month from BSRN"
        )
    latitude, longitude, elevation = (float(about[key]) for key in ("latitude", "longitude", "altitude"))
    site = Site(latitude, longitude, elevation, zone_by_longitude(longitude))
    return _weather(table, site, f"BSRN, {path.name}")


def _weather(table: pd.DataFrame, site: Site, source: str) -> Weather:
    import pandas as pd

    # pvlib puts minutes that only a further record has behind all others
    table = table[~table.index.duplicated()].sort_index()

    def column(name: str) -> FloatArray:
        known = table[name] if name in table else np.full(len(table), np.nan)
        return np.asarray(known, np.float64)

    labels = pd.DatetimeIndex(table.index).tz_localize(None).to_numpy().astype("datetime64[ns]")
    starts_ns = labels.astype(np.int64)
    return Weather(
        time_ns=starts_ns + half_step_ns(starts_ns),
        dni=column("dni"),
        dhi=column("dhi"),
        longwave_down_w_m2=column("lwd"),
        air_temperature_k=column("temp_air") + 273.15,
        wind_m_s=np.full(len(table), np.nan),
        pressure_pa=column("pressure") * 100.0,
        ghi=column("ghi"),
        longwave_up_w_m2=column("lwu"),
        site=site,
        source=source,
    )
