"""What ``fieldkit import`` can read: each source by what stands in it, where that can be told."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import click

from fieldkit.model.durations import parse_offset
from fieldkit.model.errors import ConfigError

if TYPE_CHECKING:
    from fieldkit.sessions.formats.imported import ImportedRecording
    from fieldkit.sessions.formats.stills import Scale

TABLES = (".csv", ".txt", ".tsv", ".dat")
AUTO = "auto"


def read_source(source: Path, given: dict[str, Any]) -> ImportedRecording:
    """SOURCE as streams and samples; `given` by the names of the options. Raises `ConfigError`."""
    for is_kind, read in _KINDS:
        if is_kind(source):
            return read(source, given)
    raise ConfigError(
        f"{source} is nothing that fieldkit knows",
        fix="it reads .raw.y16.gz, .fff, .seq, radiometric .jpg, 16-bit TIFF and .irg pictures, "
        "tables of loggers, files of SURFRAD, BSRN and the Japan Meteorological Agency",
    )


def _is_flir(source: Path) -> bool:
    """A folder with other pictures too has those; JPEGs beside them are to look at."""
    from fieldkit.cli.import_flir import SUFFIXES, files_in
    from fieldkit.sessions.formats.stills import pictures_in

    if source.is_dir():
        return bool(files_in(source)) and not pictures_in(source)
    return source.suffix.lower() in SUFFIXES


def _is_stills(source: Path) -> bool:
    from fieldkit.sessions.formats.stills import SUFFIXES

    return source.is_dir() or source.suffix.lower() in SUFFIXES


def _stills(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.sessions.formats.stills import read_stills

    return read_stills(
        source, _scale(given["kelvin_per_count"], given["kelvin_at_zero"]), name=given["name"] or "camera",
        times=given["times"], time_format=given["time_format"], zone=_zone(given),
    )  # fmt: skip


def _flir(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.cli.import_flir import read_flir

    return read_flir(source, given["name"] or "camera")


def _is_station(source: Path) -> bool:
    from fieldkit.weather import is_station_file

    return is_station_file(source)


def _station(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.sessions.formats.stations import read_station

    return read_station(source, given["name"] or "station")


def _is_jma(source: Path) -> bool:
    from fieldkit.sessions.formats.jma import is_obsdl, is_radiation_table

    return is_radiation_table(source) or is_obsdl(source)


def _jma(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.sessions.formats.jma import is_radiation_table, read_obsdl, read_radiation_table

    read = read_radiation_table if is_radiation_table(source) else read_obsdl
    return read(source, given["name"] or "station")


def _is_purethermal(source: Path) -> bool:
    from fieldkit.sessions.formats.purethermal_files import is_purethermal

    return is_purethermal(source)


def _purethermal(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.sessions.formats.purethermal_files import read_purethermal

    return read_purethermal(source, given["name"] or "camera")


def _table(source: Path, given: dict[str, Any]) -> ImportedRecording:
    from fieldkit.sessions.formats.logs import LogColumns, read_log

    return read_log(
        source, given["name"] or "logger", zone=_zone(given), time_format=given["time_format"],
        unit=given["unit"], offset_ns=0 if given["offset"] == AUTO else offset_ns(given["offset"]),
        columns=LogColumns(values=given["columns"]), encoding=given["encoding"],
        measures=given["measures"] or "",
    )  # fmt: skip


_KINDS = (
    (_is_flir, _flir),
    (_is_stills, _stills),
    (_is_station, _station),
    (_is_jma, _jma),
    (_is_purethermal, _purethermal),
    (lambda source: source.suffix.lower() in TABLES, _table),
)
"""Whether a source is of a kind, and how it is read; tables last, whose endings others have too."""


def offset_ns(text: str) -> int:
    """``+12s``, ``-0.5s`` or ``+2m`` in nanoseconds."""
    try:
        return round(parse_offset(text) * 1e9)
    except ConfigError as error:
        raise click.BadParameter(f"{error.message}, or auto", param_hint="--offset") from None


def _zone(given: dict[str, Any]) -> ZoneInfo | None:
    return ZoneInfo(given["zone"]) if given["zone"] else None


def _scale(kelvin_per_count: str | None, kelvin_at_zero: float) -> Scale | None:
    """What a count means, as it was said; None where it was not."""
    from fieldkit.sessions.formats.stills import Scale

    if kelvin_per_count is None:
        return None
    try:
        return Scale(float("nan") if kelvin_per_count == "none" else float(kelvin_per_count), kelvin_at_zero)
    except ValueError:
        raise click.BadParameter(f"{kelvin_per_count!r} is no number, nor none") from None
