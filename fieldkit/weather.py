"""Weather of one station, minute by minute: the packaged day, and files of networks and services.

The package carries one day (NOAA SURFRAD, Alamosa, 2016-01-01). `read_station_file` recognises a file by
its content: SURFRAD's daily files, and those that pvlib reads (``files``): BSRN's monthly station-to-archive
files, SOLRAD, and the modelled weather of EnergyPlus, TMY3, NSRDB, PVGIS and CAMS.
The packaged table is made from a SURFRAD file by::

    python -m fieldkit.weather slv16001.dat --out fieldkit/data/alamosa-20160101.csv

Not here: what a sky does to a surface (`fieldkit.simulation`) and skies without a file.

SURFRAD stamps the *end* of each averaged interval, three minutes before 2009 and one since (SURFRAD README);
BSRN stamps the *start* (GCOS-174, "Update of the Technical Plan for BSRN Data Management", 2013); of the
others `_PROGRAMS` has the rule.
`Weather.time_ns` is the *middle*, so that linear interpolation passes through the means where they belong.
Missing minutes are missing rows in SURFRAD and stay so here.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import re
import warnings
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fieldkit.disk import unpacked
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra
from fieldkit.model.site import Site, zone_by_longitude
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS

if TYPE_CHECKING:
    import pandas as pd


Rows = list[tuple[str, ...]]

PACKAGED = "alamosa-20160101.csv"

STATIONS = {
    # The sign of the longitude differs between SURFRAD headers (Alamosa: +105.92, meaning
    # west), so the place is taken from here and the header only has to agree in size.
    "alamosa": Site(37.70, -105.92, 2317.0, "America/Denver"),
    "bondville": Site(40.05, -88.37, 230.0, "America/Chicago"),
    "boulder": Site(40.125, -105.237, 1689.0, "America/Denver"),
    "desert-rock": Site(36.624, -116.019, 1007.0, "America/Los_Angeles"),
    "fort-peck": Site(48.308, -105.102, 634.0, "America/Denver"),
    "goodwin-creek": Site(34.255, -89.873, 98.0, "America/Chicago"),
    "penn-state": Site(40.72, -77.931, 376.0, "America/New_York"),
    "sioux-falls": Site(43.734, -96.623, 473.0, "America/Chicago"),
}
"""Places of the stations, by the network's station list; west is negative."""

_MISSING = -9999.9
_FIRST_VALUE = 8  # year, day of year, month, day, hour, minute, decimal hour, zenith come before
_WORDS = _FIRST_VALUE + 2 * 20
_FIRST_YEAR, _LAST_YEAR = 1992, 2261  # BSRN's first, before SURFRAD's; 64 bits of nanoseconds end in 2262
_COLUMNS = {
    # our column: which of SURFRAD's 20 value/quality pairs
    "dni_w_m2": 2,
    "dhi_w_m2": 3,
    "longwave_down_w_m2": 4,
    "air_temperature_c": 15,
    "wind_m_s": 17,
    "pressure_hpa": 19,
    "ghi_w_m2": 0,
    "longwave_up_w_m2": 7,
}

_HEAD_BYTES = 16_384
_MOST_BYTES = 100_000_000  # a month of BSRN with every record is a tenth of it
_SURFRAD_PLACE = re.compile(rb"[^\n]*\n\s*(-?[\d.]+)\s+(-?[\d.]+)\s+-?[\d.]+\s+m\s+version")
_NEAR_DEG = 0.1


class _Program(NamedTuple):
    """Files that pvlib reads, recognised by their beginning.

    `middle` is from a stamp to the middle of its interval, in intervals; `pressure_pa` that of its unit.
    """

    name: str
    start: bytes
    reader: str
    middle: float
    pressure_pa: float = 100.0


_BSRN = _Program("BSRN", rb"\*[UC]0001", "read_bsrn", 0.5)
_PROGRAMS = (
    _BSRN,
    _Program("EnergyPlus", rb"LOCATION,", "read_epw", 0.5, 1.0),
    _Program("TMY3", rb"[^\n]*,[^\n]*\n\W*Date \(MM/DD/YYYY\),Time \(HH:MM\)", "read_tmy3", -0.5),
    _Program("NSRDB", rb"Source,Location ID,", "read_nsrdb_psm4", 0.0),
    _Program("PVGIS", rb"Latitude [^\n]*\n(?s:.*)\n\W*time\(UTC\),", "read_pvgis_tmy", 0.0, 1.0),
    _Program("PVGIS", rb"Latitude [^\n]*\n(?s:.*)\n\W*time,", "read_pvgis_hourly", 0.0, 1.0),
    _Program("CAMS", rb"#(?s:.*)\n# Observation period;", "read_cams", 0.5),
    _Program("SOLRAD", rb"[^\n]*\n\s*-?\d+\.\d+\s+-?\d+\.\d+\s+\d+\s+-?\d+\s", "read_solrad", -0.5),
)


@dataclass(frozen=True, slots=True)
class Weather:
    """Measured weather at one station; every array has shape (n,), NaN where not measured.

    The last three are not needed for temperatures of surfaces, and empty where they are not given.

    `time_ns` is the middle of each averaging interval, UTC nanoseconds since 1970. Direct normal, diffuse
    horizontal and global horizontal irradiance and both longwave fluxes are in W/m², pressure in Pa.

    Examples
    --------
    >>> import numpy as np, fieldkit.weather
    >>> hours = np.datetime64("2026-06-21T10", "ns").astype(int) + 3_600_000_000_000 * np.arange(5)
    >>> dni, dhi, longwave, air, wind = (np.full(5, value) for value in (850.0, 90.0, 320.0, 293.0, 2.0))
    >>> site = fieldkit.Site(47.87, 11.73, 680.0)
    >>> weather = fieldkit.weather.Weather(hours, dni, dhi, longwave, air, wind, site)
    >>> fieldkit.predict([(30, 180)], weather).surface_k[-1].round(1).tolist()
    [320.3]
    """

    time_ns: IntArray
    dni_w_m2: FloatArray
    dhi_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    air_temperature_k: FloatArray
    wind_m_s: FloatArray
    site: Site
    source: str = "given weather"
    pressure_pa: FloatArray = field(default_factory=partial(np.zeros, 0))
    ghi_w_m2: FloatArray = field(default_factory=partial(np.zeros, 0))
    longwave_up_w_m2: FloatArray = field(default_factory=partial(np.zeros, 0))
    notes: tuple[str, ...] = ()
    """Parts of the file that were not used, and why."""


def packaged_day() -> Weather:
    """The packaged day: Alamosa, Colorado, 2016-01-01, clear all day."""
    text = (resources.files("fieldkit") / "data" / PACKAGED).read_text(encoding="utf-8")
    return read_table(io.StringIO(text))


def read_table(lines: Iterable[str]) -> Weather:
    """Weather from a table in the form of `write_table`.

    Parameters
    ----------
    lines
        Lines of the table.

    Returns
    -------
    The weather.

    Raises
    ------
    ConfigError
        If a header line or a column is missing.
    """
    about: dict[str, str] = {}
    body: list[str] = []
    for line in lines:
        if line.startswith("#"):
            key, _, value = line[1:].partition(":")
            about[key.strip()] = value.strip()
        else:
            body.append(line)
    rows = list(csv.DictReader(body))
    try:
        place = (float(about[name]) for name in ("latitude_deg", "longitude_deg", "elevation_m"))
        latitude_deg, longitude_deg, elevation_m = place
        site = Site(latitude_deg, longitude_deg, elevation_m, about["timezone"])
        ends_ns = np.array([row["end_utc"].rstrip("Z") for row in rows], "datetime64[ns]").astype(np.int64)
        values = {name: np.array([float(row[name] or "nan") for row in rows]) for name in _COLUMNS}
    except KeyError as missing:
        fix = "make it again: python -m fieldkit.weather"
        raise ConfigError(f"the weather table lacks {missing}", fix=fix) from None
    values["air_temperature_k"] = values.pop("air_temperature_c") + CELSIUS_ZERO_K
    values["pressure_pa"] = values.pop("pressure_hpa") * 100.0
    time_ns, source = ends_ns - half_step_ns(ends_ns), about.get("source", "")
    return Weather(time_ns=time_ns, site=site, source=source, notes=(), **values)


def half_step_ns(stamps_ns: IntArray) -> int:
    """Half of the averaging interval, from the median of the intervals; half a minute for a single row."""
    intervals = np.diff(np.unique(stamps_ns))
    return int(np.median(intervals)) // 2 if intervals.size else MINUTE_NS // 2


def is_station_file(path: Path) -> bool:
    """True if a file is one of these, by its content."""
    try:
        head = unpacked(path, _HEAD_BYTES)
    except (OSError, EOFError, zlib.error):
        return False
    return _SURFRAD_PLACE.match(head) is not None or _program_of(head) is not None


def _program_of(content: bytes) -> _Program | None:
    return next((program for program in _PROGRAMS if re.match(program.start, content)), None)


def read_station_file(path: Path) -> Weather:
    """Weather from a file of SURFRAD, BSRN, SOLRAD, EnergyPlus, TMY3, NSRDB, PVGIS or CAMS.

    Parameters
    ----------
    path
        The file; those of BSRN also gzipped.

    Returns
    -------
    The weather, NaN where not measured or marked bad.

    Raises
    ------
    ConfigError
        If the file is neither, is damaged, or needs pvlib, which is not installed.
    """
    try:
        content = unpacked(path, _MOST_BYTES)
        if len(content) == _MOST_BYTES:
            fix = "use one day, or one month"
            raise ConfigError(f"more than {_MOST_BYTES // 10**6} MB", place=path, fix=fix)
        program = _program_of(content[:_HEAD_BYTES])
        if program is _BSRN:
            return _bsrn(path, content.decode("ascii", errors="replace"))
        if program is None:
            _surfrad_site(path, content)
        if not path.read_bytes().startswith(content[:2]):
            raise ConfigError("compressed", place=path, fix=f"unpack it first: gunzip {path}")
        return _by_pvlib(program, path, path) if program else read_surfrad(path)
    except ConfigError:
        raise
    except Exception as error:  # pandas raises exceptions of its own
        fix = "download it again, and do not edit it"
        raise ConfigError(f"damaged: {error}", place=path, fix=fix) from error


def _surfrad_site(path: Path, content: bytes) -> Site:
    """The station, by the position in the second line; the sign of its longitude is unreliable."""
    if (place := _SURFRAD_PLACE.match(content)) is None:
        fix = "give a file as the network names it, like slv16001.dat or tat0624.dat.gz"
        raise ConfigError("not a SURFRAD daily file, nor one of BSRN", place=path, fix=fix)
    latitude, longitude = float(place[1]), float(place[2])
    for site in STATIONS.values():
        apart = abs(latitude - site.latitude_deg), abs(abs(longitude) - abs(site.longitude_deg))
        if max(apart) <= _NEAR_DEG:
            return site
    fix = f"name a known station: {', '.join(STATIONS)}"
    raise ConfigError("an unknown SURFRAD station", place=path, fix=fix)


def read_surfrad(path: Path) -> Weather:
    """Weather from a daily file of NOAA's SURFRAD network.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    The weather; bad values (quality 1) are NaN. A last row that is cut off is excluded, with a note.

    Raises
    ------
    ConfigError
        If the file is not one of SURFRAD, has a damaged row, or is of none of the `STATIONS`.
    """
    site, rows, notes = _surfrad_rows(path)
    return replace(read_table(_table_lines(rows, site, path.name)), notes=notes)


def write_table(surfrad: Path, out: Path) -> None:
    """Write the attributed table of a SURFRAD day, comma-separated, one row per minute."""
    site, rows, _ = _surfrad_rows(surfrad)
    out.write_text("".join(_table_lines(rows, site, surfrad.name)), encoding="utf-8")


def _surfrad_rows(path: Path) -> tuple[Site, Rows, tuple[str, ...]]:
    """The site of the station, the rows of the table as text in order of time, and notes on others."""
    content = path.read_bytes()
    site = _surfrad_site(path, content)
    lines = content.decode("ascii", errors="replace").splitlines()
    try:
        rows, notes = _whole_rows([line.split() for line in lines[2:] if line.strip()])
    except ValueError as cause:
        fix = "give a file as NOAA names it, like slv16001.dat"
        raise ConfigError(f"not a SURFRAD daily file: {cause}", place=path, fix=fix) from cause
    return site, rows, tuple(f"{path.name}: {note}" for note in notes)


def _whole_rows(body: list[list[str]]) -> tuple[Rows, list[str]]:
    """The rows in order of time, each minute once, and notes; raises `ValueError`."""
    notes = []
    if body and len(body[-1]) < _WORDS:  # the file is still being written, or its download broke off
        notes.append(f"its last row is cut off and was excluded, after {len(body) - 1} whole rows")
        body = body[:-1]
    if not body:
        raise ValueError("it has no whole row")
    rows = [_surfrad_row(number, words) for number, words in enumerate(body, start=1)]
    minutes = {row[0]: row for row in reversed(rows)}
    if len(minutes) < len(rows):
        notes.append(f"{len(rows) - len(minutes)} rows of minutes that stand before were excluded")
    return [minutes[minute] for minute in sorted(minutes)], notes


def _surfrad_row(number: int, words: list[str]) -> tuple[str, ...]:
    if len(words) < _WORDS:
        raise ValueError(f"row {number} has {len(words)} words, not {_WORDS}")
    year, month, day, hour, minute = (int(words[i]) for i in (0, 2, 3, 4, 5))
    _refuse_year(year)
    cells = [f"{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}Z"]
    for pair in _COLUMNS.values():
        value, quality = words[_FIRST_VALUE + 2 * pair], int(words[_FIRST_VALUE + 2 * pair + 1])
        cells.append("" if quality == 1 or float(value) <= _MISSING else value)
    return tuple(cells)


def _refuse_year(year: int) -> None:
    if not _FIRST_YEAR <= year <= _LAST_YEAR:
        raise ValueError(f"its year {year} is not from {_FIRST_YEAR} on, in four digits")


def _table_lines(rows: Rows, site: Site, file_name: str) -> Iterable[str]:
    yield f"# source: NOAA Global Monitoring Laboratory, SURFRAD, {file_name}\n"
    yield "# terms: U.S. Government data, public domain\n"
    yield (
        "# cite: Augustine, J. A., DeLuisi, J. J. and Long, C. N. (2000). SURFRAD - a national surface"
        " radiation budget network for atmospheric research. Bull. Amer. Meteor. Soc. 81, 2341-2357\n"
    )
    yield "# made by: python -m fieldkit.weather\n"
    yield from (f"# {name}: {value}\n" for name, value in asdict(site).items() if name != "body")
    yield "# end_utc: end of the averaged minute; air temperature at 10 m\n"
    yield ",".join(("end_utc", *_COLUMNS)) + "\n"
    yield from (",".join(row) + "\n" for row in rows)


def _bsrn(path: Path, text: str) -> Weather:
    lines = text.splitlines()
    notes: tuple[str, ...] = ()
    # columns are fixed, and a minute of record 0100 has two lines: a whole one is as long as the one but last
    if len(lines) > 2 and not text.endswith("\n") and len(lines[-1]) < len(lines[-3].rstrip()):
        text = "\n".join(lines[:-1])
        notes = (f"{path.name}: its last line is cut off and was excluded",)
    records = ("0100", "0300") if re.search(r"^\*[UC]0300", text, re.MULTILINE) else ("0100",)
    return replace(_by_pvlib(_BSRN, path, io.StringIO(text), logical_records=records), notes=notes)


def _by_pvlib(program: _Program, path: Path, source: Path | io.StringIO, **options: Any) -> Weather:
    try:
        from pvlib import iotools
    except ImportError as error:
        problem = f"files of {program.name} need pvlib"
        raise ConfigError(problem, place=path, fix=install_extra("files")) from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pvlib uses pandas features that are deprecated
        table, about = getattr(iotools, program.reader)(source, **options)
    if table.empty or not about:
        problem = f"no radiation of {program.name} in it"
        raise ConfigError(problem, place=path, fix="download the whole file again")
    place = {**about, **about.get("inputs", {})}
    latitude, longitude = float(place["latitude"]), float(place["longitude"])
    elevation = float(place["altitude"] if "altitude" in place else place["elevation"])
    site = Site(latitude, longitude, elevation, zone_by_longitude(longitude))
    if str(place.get("Slope")).startswith("0"):  # PVGIS' plane of the array is horizontal
        parts = table.filter(like="poa_")
        table = table.assign(ghi=parts.sum(axis=1, min_count=1), dhi=parts.get("poa_sky_diffuse", math.nan))
    return _weather_of(table, site, program, path)


_NAMES = {
    # ours, and those of pvlib's readers
    "dni_w_m2": ("dni",),
    "dhi_w_m2": ("dhi",),
    "ghi_w_m2": ("ghi",),
    "longwave_down_w_m2": ("lwd", "ghi_infrared", "IR(h)"),
    "longwave_up_w_m2": ("lwu",),
    "air_temperature_k": ("temp_air",),
    "wind_m_s": ("wind_speed",),
    "pressure_pa": ("pressure", "atmospheric_pressure"),
}


def _weather_of(table: pd.DataFrame, site: Site, program: _Program, path: Path) -> Weather:
    import pandas as pd

    if program is not _BSRN and table.index.has_duplicates:
        raise ValueError(f"{table.index[table.index.duplicated()][0]} comes twice")
    # pvlib appends minutes of BSRN that occur only in a further record; typical years are of several
    is_typical = not table.index.is_monotonic_increasing and program is not _BSRN
    table = table[~table.index.duplicated()].sort_index()

    columns = {}
    for ours, names in _NAMES.items():
        values = next((table[name] for name in names if name in table), math.nan)
        is_bad = table.get(f"{names[0]}_flag") == 1
        numbers = np.broadcast_to(np.asarray(values, np.float64), len(table))
        columns[ours] = np.where(is_bad, math.nan, numbers)
    columns["air_temperature_k"] += CELSIUS_ZERO_K
    columns["pressure_pa"] *= program.pressure_pa
    labels = pd.DatetimeIndex(table.index).tz_convert("UTC").tz_localize(None)
    for year in set(labels.year):
        _refuse_year(year)
    stamps_ns = labels.to_numpy().astype("datetime64[ns]").astype(np.int64)
    notes = []
    if is_typical:
        notes.append("its months are of several years: a typical year, not a measured one")
    if "ghi" not in table and "poa_direct" in table:
        notes.append("irradiance on a tilted plane is excluded")
    return Weather(
        time_ns=stamps_ns + round(2.0 * program.middle) * half_step_ns(stamps_ns),
        site=site,
        source=f"{program.name}, {path.name}",
        notes=tuple(f"{path.name}: {note}" for note in notes),
        **columns,
    )


def _main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m fieldkit.weather",
        description="Make the table of a measured day from a SURFRAD daily file.",
    )
    parser.add_argument("surfrad_file", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    chosen = parser.parse_args()
    write_table(chosen.surfrad_file, chosen.out)


if __name__ == "__main__":
    _main()
