"""Inputs of calibrations: of a session streams, regions, minute means and its place in a record; files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fieldkit.config import Config
from fieldkit.disk import replacing
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Region
from fieldkit.model.spelling import did_you_mean
from fieldkit.model.text_file import read_text
from fieldkit.results.result_files import writing
from fieldkit.results.sources import SessionOrFile, Settings, config_for, notify_damage, reading
from fieldkit.sessions import analysis
from fieldkit.sessions.reader import SessionReader


def read_columns(path: Path, names: Sequence[str]) -> FloatArray:
    """The columns of these names of a CSV file of finite numbers, shape (rows, names).

    Raises `ConfigError`.
    """
    rows = list(csv.DictReader(io.StringIO(read_text(path))))
    try:
        table = np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, len(names))
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"not a table of numbers with the columns {', '.join(names)} ({error})",
            place=path,
            fix=f"begin the file with {','.join(names)}",
        ) from error
    for number in np.flatnonzero(~np.isfinite(table).all(axis=1)):
        raise ConfigError(
            "a number is not finite", place=f"{path}, row {number + 2}", fix="correct that row of the table"
        )
    return table


def write_lines(path: Path, lines: Sequence[str]) -> None:
    """Replace a file by these lines; raises `StorageError`."""
    with writing(path), replacing(path, synced=False) as file:
        file.write_text("\n".join([*lines, ""]), encoding="utf-8")


@contextmanager
def open_to_calibrate(
    session: SessionOrFile, settings: Settings, notify: Callable[[str], None]
) -> Iterator[tuple[SessionReader, Config]]:
    """The session with its configuration; its damaged samples are reported when it has been read."""
    with reading(session) as opened:
        try:
            yield opened, config_for(opened, settings)
        finally:
            notify_damage(opened, notify)


def one_region(regions: Sequence[Region], name: str, path: Path) -> Region:
    """The region of that name; raises `ConfigError` with the names there are."""
    for region in regions:
        if region.name == name:
            return region
    fix = did_you_mean(name, (region.name for region in regions)) + "; draw: " + Action.ADD_REGION()
    raise ConfigError(f"no region {name!r}", place=path, fix=fix)


def one_stream(session: SessionReader, quantity: str, name: str | None = None) -> StreamInfo:
    """The only stream of a quantity, or the one of that name; raises `ConfigError` with those there are."""
    candidates = [info for info in session.streams.values() if info.quantity == quantity]
    chosen = [info for info in candidates if name in (None, info.name)]
    if len(chosen) == 1:
        return chosen[0]
    fix = did_you_mean(name or "", (info.name for info in candidates))
    which = f"no {quantity} stream {name!r}" if name else f"which {quantity} stream?"
    raise ConfigError(which, place=session.path, fix=fix)


def light_meter(session: SessionReader, config: Config) -> StreamInfo:
    """The session's light meter: of several the one that ``irradiance.stream`` names.

    Raises `ConfigError` without any, or if none of several is named.
    """
    names = [info.name for info in session.streams.values() if info.quantity == "illuminance"]
    stream_name = config.tables.irradiance.stream
    if len(names) > 1 and stream_name not in names:
        raise ConfigError(
            "several light meters",
            place=session.path,
            fix=f"name one as irradiance.stream: {', '.join(names)}",
        )
    return one_stream(session, "illuminance", stream_name if stream_name in names else None)


def minute_means(
    session: SessionReader, stream: str, *, recorded: bool = False
) -> tuple[IntArray, FloatArray]:
    """Middle and mean of every minute of a meter's first channel; raises `ConfigError` without any.

    `recorded` takes the times as they were recorded, without an active time map.
    """
    minutes, means = analysis.minute_means(session, stream, recorded=recorded)
    if not minutes.size:
        raise ConfigError(f"{stream} has no usable readings", place=session.path, fix=Action.CHECK())
    return minutes, means
