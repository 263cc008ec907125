"""A session as tables: CSV for anybody, Parquet for programs. Tidy: one row a sample, units in the header."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError, IncompleteError, SessionError, message_of
from fieldkit.model.installation import install_extra
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.sessions.analysis import as_frame, region_series, stream_columns
from fieldkit.sessions.reader import SessionReader

_NUMBER = "%.12g"
"""Twelve digits are more than any sensor has, and leave out what binary fractions add: 280.55."""

_NOT_A_TIME_NS = np.iinfo(np.int64).min  # numpy's NaT
_UNSEEN = r"\s\x00-\x1f\x7f-\x9f\xad\u180e\u200b-\u200f\u202a-\u202e\u2060-\u2064\ufeff"
_SYSTEM_ERROR = re.compile("error message = '([^']+)'")
"""The system's error in the text of HDF5's, such as that of a full disk."""
_FORMULA = re.compile(rf"[\t\r\n]|[{_UNSEEN}]*[=+\-@\uff1d\uff0b\uff0d\uff20]")
"""Beginnings of cells that a spreadsheet may compute, text or not (OWASP, CSV injection).

Spreadsheets skip leading blanks and characters without width; the last four are ``=+-@`` in full width.
"""


PACKAGE = "datapackage.json"
_TYPES = {"M": "datetime", "f": "number", "i": "integer", "u": "integer", "O": "string"}
_UNIT = re.compile(r"\[(.+)\]$")
Columns = Mapping[str, NDArray[Any]]
"""A table: columns of one length by their names, ``time`` (datetime64[ns], UTC) first."""


def export_csv(session: SessionReader, folder: Path) -> list[Path]:
    """Write every table of a session as CSV, described by ``datapackage.json``; returns the files.

    That is a Data Package of Frictionless Data: types and units of the columns. Raises `IncompleteError`,
    when all the others are written, for a table that cannot be read.
    """
    resources: list[dict[str, Any]] = []
    files, unread = _export(
        session, folder, "csv", _csv, lambda path, table: resources.append(_resource(path, table))
    )
    about = {"profile": "tabular-data-package", "resources": resources}
    return whole_export([*files, write_json(folder / PACKAGE, about)], unread)


def write_json(path: Path, document: Mapping[str, Any]) -> Path:
    """Write a document for people and programs; returns the path."""
    with replacing(path, synced=False) as draft:
        draft.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def _resource(path: Path, table: Columns) -> dict[str, Any]:
    fields = [{"name": as_text(name), "type": _TYPES[column.dtype.kind]} for name, column in table.items()]
    for field in fields:
        if unit := _UNIT.search(field["name"]):
            field["unit"] = unit[1]
    about = {"name": _slug(path.stem), "path": path.name, "profile": "tabular-data-resource"}
    return {**about, "format": "csv", "encoding": "utf-8", "schema": {"fields": fields}}


def _slug(name: str) -> str:
    """A name as Data Packages allow."""
    return re.sub(r"[^a-z0-9._-]+", "-", name.lower())


def export_parquet(session: SessionReader, folder: Path) -> list[Path]:
    """The same tables as Parquet; raises `ConfigError` where pandas or pyarrow is not installed."""
    return whole_export(*_export(session, folder, "parquet", _parquet))


def _export(
    session: SessionReader,
    folder: Path,
    kind: str,
    write: Callable[[Columns, Path], None],
    on_table: Callable[[Path, Columns], None] = lambda *_: None,
) -> tuple[list[Path], list[str]]:
    def table(make: Callable[[], Columns], path: Path) -> Path:
        columns = make()
        with replacing(path, synced=False) as draft:
            write(columns, draft)
        on_table(path, columns)
        return path

    return all_but_unreadable(
        (name, partial(table, make, folder / f"{session.path.stem}-{name}.{kind}"))
        for name, make in _tables(session)
    )


def _csv(columns: Columns, path: Path) -> None:
    write_csv({name: _cells(column) for name, column in columns.items()}, path)


def write_csv(columns: Mapping[str, Iterable[Any]], path: Path) -> None:
    """Write cells by column as a header and rows."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(as_text, columns))
        writer.writerows(zip(*columns.values(), strict=True))


def _cells(column: NDArray[Any]) -> Iterable[Any]:
    """A column as cells of CSV: times to the microsecond; empty where there is no value."""
    if column.dtype.kind == "M":
        texts = np.datetime_as_string(column.astype("datetime64[us]"))
        return ("" if text == "NaT" else f"{text}Z" for text in texts)
    if column.dtype.kind == "f":
        return ("" if math.isnan(value) else _NUMBER % value for value in column.tolist())
    return map(as_text, column) if column.dtype.kind == "O" else column.tolist()


def as_text(cell: str) -> str:
    """The text of a cell, with an apostrophe before what a spreadsheet would compute."""
    return f"'{cell}" if _FORMULA.match(cell) else cell


def _parquet(columns: Columns, path: Path) -> None:
    try:
        as_frame(columns).to_parquet(path)
    except ImportError as error:
        raise ConfigError("Parquet needs pandas and pyarrow", fix=install_extra("lab")) from error


def _tables(session: SessionReader) -> Iterator[tuple[str, Callable[[], Columns]]]:
    for name, info in session.streams.items():
        if not info.is_camera:
            yield name, partial(stream_columns, session, name)
        elif session.regions:
            yield f"{name}-regions", partial(_regions, session, name)
    yield "slopes", partial(_slopes, session)
    yield "events", partial(_events, session)


def _times(times_ns: Iterable[int]) -> NDArray[np.datetime64]:
    return np.fromiter(times_ns, np.int64).view("datetime64[ns]")


def _texts(texts: Iterable[str]) -> NDArray[Any]:
    return np.array([*texts], object)


def _regions(session: SessionReader, camera: str) -> Columns:
    """One row for each frame and region."""
    series = region_series(session, stream=camera)
    frames, regions = series.mean_k.shape
    columns = {
        "time": np.tile(series.time_ns.view("datetime64[ns]"), regions),
        "region": np.repeat(_texts(series.regions), frames),
        "temperature [K]": series.mean_k.T.ravel(),
        "spread [K]": series.spread_k.T.ravel(),
        "pixels": np.repeat(series.pixels, frames),
        "flags": np.tile(series.flags, regions),
    }
    order = np.argsort(columns["time"], kind="stable")
    return {name: values[order] for name, values in columns.items()}


def _slopes(session: SessionReader) -> Columns:
    estimates = session.estimates()
    values = {
        about.heading: np.array([getattr(estimate, about.key) for estimate in estimates])
        for about in SLOPE_FIELDS.values()
    }
    return {
        "time": _times(estimate.time_ns for estimate in estimates),
        "region": _texts(estimate.region for estimate in estimates),
        "state": _texts(estimate.state.name.lower() for estimate in estimates),
        **values,
        "minutes": np.array([estimate.n_bins for estimate in estimates], int),
        "model": _texts(estimate.model for estimate in estimates),
        "reason": _texts(estimate.reason for estimate in estimates),
    }


def _events(session: SessionReader) -> Columns:
    """One row for each event, with the kind of a mark and where it ends."""
    events = session.events()
    return {
        "time": _times(event.time_ns for event in events),
        "kind": _texts(event.kind.name.lower() for event in events),
        "severity": _texts(event.severity.name.lower() for event in events),
        "stream": _texts(event.stream for event in events),
        "text": _texts(event.text for event in events),
        "label": _texts(str(event.data.get("label", "")) for event in events),
        "end": _times(event.data.get("end_ns", _NOT_A_TIME_NS) for event in events),
    }


def all_but_unreadable(parts: Iterable[tuple[str, Callable[[], Path]]]) -> tuple[list[Path], list[str]]:
    """Write one part after the other, each of them a file; those that cannot be read, and why."""
    files, missing = [], []
    for name, write in parts:
        try:
            files.append(write())
        except (SessionError, OSError, RuntimeError) as error:
            if match := _SYSTEM_ERROR.search(str(error)):
                raise OSError(match[1]) from error
            if "errno" in message_of(error).lower():
                raise
            missing.append(f"{name}: {message_of(error)}")
    return files, missing


def whole_export(files: list[Path], missing: Sequence[str]) -> list[Path]:
    """The files; raises `IncompleteError` with those and what is `missing`, if anything."""
    if missing:
        raise IncompleteError("not exported: " + "; ".join(missing), files)
    return files
