"""A session as tables: CSV for anybody, Parquet for programs. Tidy: one row a sample, units in the header."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError, IncompleteError, SessionError, message_of
from fieldkit.model.installation import install_extra
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.sessions.analysis import as_frame, region_series, stream_columns
from fieldkit.sessions.chunks import corners, pack
from fieldkit.sessions.entry_rows import event_columns
from fieldkit.sessions.file_tree import put_rows
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stream_reader import StreamReader

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


Columns = Mapping[str, NDArray[Any]]
"""A table: columns of one length by their names, ``time`` (datetime64[ns], UTC) first."""


def export_csv(session: SessionReader, folder: Path) -> list[Path]:
    """Write every table of a session as CSV; returns the files.

    Raises `IncompleteError`, when all the others are written, for a table that cannot be read.
    """
    return _export(session, folder, "csv", _csv)


def export_parquet(session: SessionReader, folder: Path) -> list[Path]:
    """The same tables as Parquet; raises `ConfigError` where pandas or pyarrow is not installed."""
    return _export(session, folder, "parquet", _parquet)


def _export(
    session: SessionReader, folder: Path, kind: str, write: Callable[[Columns, Path], None]
) -> list[Path]:
    def table(make: Callable[[], Columns], path: Path) -> Path:
        with replacing(path, synced=False) as draft:
            write(make(), draft)
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


# --- streams as netCDF files of their own, for programs that do not look into groups

# A session is a netCDF-4 file already; here each group becomes the root of a file, its flags verified.
_SCALE_MARKS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
_PLAIN_KINDS = "biufSU"  # references, among others, mean nothing in another file


def export_netcdf(session: SessionReader, folder: Path) -> list[Path]:
    """One ``.nc`` for each stream and table, times and marks as corrected since.

    The flags are verified: a sample that does not match its checksum is flagged. Frames that cannot be
    read are the fill value. Raises `IncompleteError`, when all the others are written, for a group that
    cannot be read or leads out of the session's file.
    """
    groups = (*session.streams, *session.tables)
    return all_but_unreadable(
        (name, partial(_netcdf, session, name, folder / f"{session.path.stem}-{name}.nc")) for name in groups
    )


def _netcdf(session: SessionReader, name: str, path: Path) -> Path:
    source = session.group(name)
    datasets = session.datasets(name)
    with (
        replacing(path, synced=False) as draft,
        (guarded := GuardedFile(draft, "w", track_order=True)) as file,
    ):
        _copy_attributes(source.file, file)
        _copy_attributes(source, file)
        for own, dataset in datasets.items():
            _copy(dataset, file, own, guarded.check)
        for own, dataset in datasets.items():
            _attach(dataset, file, own)
        if name in session.streams:
            _verify(session.stream(name), file)
        if session.time_map() or session.has_corrected_marks:
            _correct(session, name, file)
    return path


def _correct(session: SessionReader, name: str, file: h5py.File) -> None:
    """Times as the active time map corrects them, and events as they are now."""
    if name == "events":
        put_rows(file, event_columns(session.events()))
        return
    is_stream = name in session.streams
    times = {"time_ns": session.times_ns(name)} if is_stream else session.timed_table(name)
    for column in ("time", "window_start"):
        if column in file:
            file[column][:] = times[f"{column}_ns"] // 1000


def _verify(reader: StreamReader, file: h5py.File) -> None:
    """Verified flags in place of those stored, and chunks that cannot be read replaced by the fill value."""
    file["flags"][:] = reader.flags()
    rows = np.array(sorted(reader.damaged), np.int64)
    for frames in reader.frame_datasets:
        copy = file[frames.name.rsplit("/", 1)[1]]
        depth = copy.chunks[0]
        missing = pack(np.full(copy.chunks, copy.fillvalue, np.uint16))
        for first in np.unique(rows // depth * depth).tolist():
            for y, x in corners(copy):
                try:
                    copy[first, y, x]
                except (OSError, RuntimeError):
                    copy.id.write_direct_chunk((first, y, x), missing)


def _copy(dataset: h5py.Dataset, file: h5py.File, name: str, check: Callable[[], None]) -> None:
    """The dataset under its own name: its chunks as they are, its attributes but for the scales'.

    Chunk by chunk: what the disk does not take stays in memory, so `check` is called in between.
    """
    if dataset.chunks:
        kind = dataset.id.get_type(), dataset.id.get_space(), dataset.id.get_create_plist()
        copy, places = h5py.h5d.create(file.id, name.encode(), *kind), list[tuple[int, ...]]()
        dataset.id.chunk_iter(lambda chunk: places.append(chunk.chunk_offset))
        for place in places:
            skipped_filters, data = dataset.id.read_direct_chunk(place)
            copy.write_direct_chunk(place, data, skipped_filters)
            check()
    else:
        dataset.file.copy(dataset, file, name, without_attrs=True)
    _copy_attributes(dataset, file[name])
    if dataset.is_scale:
        file[name].make_scale(name)


def _copy_attributes(source: h5py.Group | h5py.Dataset, target: h5py.Group | h5py.Dataset) -> None:
    for key, value in source.attrs.items():
        if key not in _SCALE_MARKS and np.asarray(value).dtype.kind in _PLAIN_KINDS:
            # with its type, which marks text as UTF-8
            target.attrs.create(key, value, dtype=source.attrs.get_id(key).dtype)


def _attach(dataset: h5py.Dataset, file: h5py.File, name: str) -> None:
    """The scales of a dataset's axes that lie in the same group."""
    if dataset.is_scale:
        return
    for axis, scales in enumerate(dataset.dims):
        for scale in scales.values():
            own = str(scale.name).rsplit("/", 1)[-1]
            if own in file:
                file[name].dims[axis].attach_scale(file[own])


# --- both


def all_but_unreadable(parts: Iterable[tuple[str, Callable[[], Path]]]) -> list[Path]:
    """Write one part after the other, each of them a file.

    Raises `IncompleteError`, when all the others are written, with the names of those that cannot be read.
    """
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
    if missing:
        raise IncompleteError("not exported: " + "; ".join(missing), files)
    return files
