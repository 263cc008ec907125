"""A session as tables: CSV for anybody, Parquet for programs. Tidy: one row a sample, units in the header."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError, IncompleteError, SessionError, message_of
from fieldkit.model.installation import install_extra
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.sessions.analysis import region_series, to_pandas
from fieldkit.sessions.chunks import corners, pack
from fieldkit.sessions.entry_rows import event_columns
from fieldkit.sessions.file_tree import LIBVER, put_rows
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stream_reader import StreamReader

if TYPE_CHECKING:
    import pandas as pd

_NUMBER = "%.12g"
"""Twelve digits are more than any sensor has, and leave out what binary fractions add: 280.55."""

_UNSEEN = r"\s\x00-\x1f\x7f-\x9f\xad\u180e\u200b-\u200f\u202a-\u202e\u2060-\u2064\ufeff"
_SYSTEM_ERROR = re.compile("error message = '([^']+)'")
"""The system's error in the text of HDF5's, such as that of a full disk."""
_FORMULA = re.compile(rf"[\t\r\n]|[{_UNSEEN}]*[=+\-@\uff1d\uff0b\uff0d\uff20]")
"""Beginnings of cells that a spreadsheet may compute, text or not (OWASP, CSV injection).

Spreadsheets skip leading blanks and characters without width; the last four are ``=+-@`` in full width.
"""


def export_tables(session: SessionReader, folder: Path, kind: str) -> list[Path]:
    """Write every table of a session as `kind` ("csv" or "parquet"); returns the files.

    Raises `ConfigError` where pandas (or pyarrow) is not installed, and `IncompleteError`, when all the
    others are written, for a table that cannot be read.
    """
    if find_spec("pandas") is None:
        raise ConfigError("tables need pandas", fix=install_extra("lab"))
    write = _csv if kind == "csv" else _parquet
    return all_but_unreadable(
        (name, partial(_export, make, folder / f"{session.path.stem}-{name}.{kind}", write))
        for name, make in _tables(session)
    )


export_csv, export_parquet = partial(export_tables, kind="csv"), partial(export_tables, kind="parquet")


def _export(
    make: Callable[[], pd.DataFrame], path: Path, write: Callable[[pd.DataFrame, Path], None]
) -> Path:
    with replacing(path, synced=False) as draft:
        write(make(), draft)
    return path


def _csv(table: pd.DataFrame, path: Path) -> None:
    safe = table.rename(columns=as_text)
    for name in safe:
        if safe[name].dtype.kind == "O":
            safe[name] = safe[name].map(as_text)
    safe.to_csv(path, date_format="%Y-%m-%dT%H:%M:%S.%fZ", float_format=_NUMBER)


def as_text(cell: str) -> str:
    """The text of a cell, with an apostrophe before what a spreadsheet would compute."""
    return f"'{cell}" if _FORMULA.match(cell) else cell


def _parquet(table: pd.DataFrame, path: Path) -> None:
    try:
        table.to_parquet(path)
    except ImportError as error:
        raise ConfigError("Parquet needs pyarrow", fix=install_extra("lab")) from error


def _tables(session: SessionReader) -> Iterator[tuple[str, Callable[[], pd.DataFrame]]]:
    for name, info in session.streams.items():
        if not info.is_camera:
            yield name, partial(to_pandas, session, name)
        elif session.regions:
            yield f"{name}-regions", partial(_regions, session, name)
    yield "slopes", partial(_slopes, session)
    yield "events", partial(_events, session)


def _index(time_ns: object) -> pd.DatetimeIndex:
    import pandas as pd

    return pd.DatetimeIndex(np.asarray(time_ns, np.int64).view("datetime64[ns]"), tz="UTC", name="time")


def _regions(session: SessionReader, camera: str) -> pd.DataFrame:
    """One row for each frame and region."""
    import pandas as pd

    series = region_series(session, stream=camera)
    parts = [
        pd.DataFrame(
            {
                "region": name, "temperature [K]": series.mean_k[:, n], "spread [K]": series.spread_k[:, n],
                "pixels": series.pixels[n], "flags": series.flags,
            },
            index=_index(series.time_ns),
        )
        for n, name in enumerate(series.regions)
    ]  # fmt: skip
    return pd.concat(parts).sort_index(kind="stable")


def _slopes(session: SessionReader) -> pd.DataFrame:
    import pandas as pd

    estimates = session.estimates()
    rows = [
        {
            "region": estimate.region, "state": estimate.state.name.lower(),
            **{about.heading: getattr(estimate, about.key) for about in SLOPE_FIELDS.values()},
            "minutes": estimate.n_bins, "model": estimate.model, "reason": estimate.reason,
        }
        for estimate in estimates
    ]  # fmt: skip
    return pd.DataFrame(rows, index=_index([estimate.time_ns for estimate in estimates]))


def _events(session: SessionReader) -> pd.DataFrame:
    """One row for each event, with the kind of a mark and where it ends."""
    import pandas as pd

    events = session.events()
    rows = [
        {
            "kind": event.kind.name.lower(), "severity": event.severity.name.lower(),
            "stream": event.stream, "text": event.text, "label": str(event.data.get("label", "")),
        }
        for event in events
    ]  # fmt: skip
    table = pd.DataFrame(rows, index=_index([event.time_ns for event in events]))
    table["end"] = _index([event.data.get("end_ns", pd.NaT.value) for event in events])
    return table


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
        h5py.File(draft, "w", libver=LIBVER, track_order=True) as file,
    ):
        _copy_attributes(source.file, file)
        _copy_attributes(source, file)
        for own, dataset in datasets.items():
            _copy(dataset, file, own)
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


def _copy(dataset: h5py.Dataset, file: h5py.File, name: str) -> None:
    """The dataset under its own name: its chunks as they are, its attributes but for the scales'."""
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
    written, missing = [], []
    for name, write in parts:
        try:
            written.append(write())
        except (SessionError, OSError, RuntimeError) as error:
            if found := _SYSTEM_ERROR.search(str(error)):
                raise OSError(found[1]) from error
            if "errno" in message_of(error).lower():
                raise
            missing.append(f"{name}: {message_of(error)}")
    if missing:
        raise IncompleteError("not exported: " + "; ".join(missing), written)
    return written
