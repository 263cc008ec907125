"""A session as one netCDF file: a group for each stream and table, values under their names.

A session is a netCDF-4 file already. Here values have the names of their quantities, frames are temperatures
whatever the camera's law, flags are verified, and times, corrected as they are known now, are exact to the
nanosecond.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.disk import replacing
from fieldkit.physics.camera_laws import has_temperatures
from fieldkit.sessions.analysis import kelvin
from fieldkit.sessions.chunks import corners, pack
from fieldkit.sessions.entry_rows import event_columns
from fieldkit.sessions.file_tree import put_group, put_rows, put_scale, set_attributes
from fieldkit.sessions.formats.tables_out import all_but_unreadable, whole_export
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.layout import FRAME_DATASETS, TIME_UNITS
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stream_reader import StreamReader

NANOSECONDS = TIME_UNITS.replace("microseconds", "nanoseconds")
KELVIN = {"units": "K", "standard_name": "brightness_temperature", "units_metadata": "temperature: on_scale"}
BY_ROW = ("estimates", "regions", "events")
"""Tables in which a time may stand in several rows: CF wants another dimension than time."""
_SCALE_MARKS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
_PLAIN_KINDS = "biufSU"  # references, among others, mean nothing in another file


def export_netcdf(session: SessionReader, folder: Path) -> list[Path]:
    """Write ``NAME.nc`` with all streams and tables, times and marks as corrected since.

    The flags are verified: a sample that does not match its checksum is flagged. Frames that cannot be
    read are the fill value. Raises `IncompleteError`, when all the others are written, for a group that
    cannot be read or leads out of the session's file.
    """
    path = folder / f"{session.path.stem}.nc"
    with (
        replacing(path, synced=False) as draft,
        (guarded := GuardedFile(draft, "w", track_order=True)) as file,
    ):
        _copy_attributes(session.group("entry").file, file)
        set_attributes(file, {f"site_{name}": value for name, value in asdict(session.site).items()})
        for name in ("default", "fieldkit_format", "fieldkit_format_version"):  # of a session's own file
            del file.attrs[name]
        groups = (*session.streams, *session.tables)
        parts = ((name, partial(_put_group, session, name, file, guarded.check)) for name in groups)
        _, missing = all_but_unreadable(parts)
    return whole_export([path], missing)


def _put_group(session: SessionReader, name: str, file: h5py.File, check: Callable[[], None]) -> Path:
    try:
        _fill_group(session, name, put_group(file, name, "NXdata"), check)
    except BaseException:
        del file[name]
        raise
    return Path(name)


def _fill_group(session: SessionReader, name: str, group: h5py.Group, check: Callable[[], None]) -> None:
    source, datasets = session.group(name), session.datasets(name)
    names = {own: _name_of(dataset, own) for own, dataset in datasets.items()}
    info, counts = session.streams.get(name), datasets.get("counts")
    if info and counts and has_temperatures(info) and names["counts"] == "counts":  # no scale gives kelvin
        names["counts"] = KELVIN["standard_name"]
        _put_kelvin(session, datasets.pop("counts"), name, group, check)
    _copy_attributes(source, group)
    if signal := group.attrs.get("signal"):
        set_attributes(group, {"signal": names[signal.decode()]})
    for own, dataset in datasets.items():
        _copy(dataset, group, names[own], check)
    if name == "events" and (session.time_map() or session.has_corrected_marks):
        put_rows(group, event_columns(session.events()))
    if name in BY_ROW:
        put_scale(group, "row", np.arange(len(group["time"]), dtype="<i4"), units="1", long_name="row")
    for own, dataset in session.datasets(name).items():
        _attach(dataset, group, names[own])
    if info:
        _verify(session.stream(name), {own: group[names[own]] for own in datasets})
    _put_times(session, name, group)


def _name_of(dataset: h5py.Dataset, name: str) -> str:
    """The name of a dataset here: values and frames of known temperatures have that of their quantity."""
    quantity = {"value": "long_name", "counts": "standard_name"}.get(name, "")
    return re.sub(r"\W+", "_", dataset.attrs.get(quantity, name.encode()).decode())


def _put_kelvin(
    session: SessionReader, counts: h5py.Dataset, name: str, group: h5py.Group, check: Callable[[], None]
) -> None:
    """Kelvin in place of counts whose law is more than a scale."""
    attributes = {**KELVIN, "ancillary_variables": "flags", "_FillValue": np.float32(np.nan)}
    frames = group.create_dataset(
        KELVIN["standard_name"], counts.shape, "<f4", chunks=counts.chunks, fillvalue=np.nan,
        shuffle=True, compression="gzip", compression_opts=1,
    )  # fmt: skip
    set_attributes(frames, attributes)
    for start in range(0, len(counts), counts.chunks[0]):
        stop = min(start + counts.chunks[0], len(counts))
        frames[start:stop] = kelvin(session, start, stop, stream=name, damaged="nan")
        check()


def _put_times(session: SessionReader, name: str, group: h5py.Group) -> None:
    """UTC in nanoseconds, as the active time map corrects it."""
    times: dict[str, Any] = {"time_ns": session.times_ns(name)} if name in session.streams else {}
    times = times or session.timed_table(name)
    if name == "events":
        times["time_ns"] = np.array([event.time_ns for event in session.events()], np.int64)
    for own, dataset in group.items():
        if f"{own}_ns" in times and dataset.attrs.get("units") == TIME_UNITS.encode():
            dataset[:] = times[f"{own}_ns"]
            set_attributes(dataset, {"units": NANOSECONDS})


def _verify(reader: StreamReader, copies: Mapping[str, h5py.Dataset]) -> None:
    """Verified flags in place of those stored, and chunks that cannot be read replaced by the fill value."""
    copies["flags"][:] = reader.flags()
    rows = np.array(sorted(reader.damaged), np.int64)
    frames = [copies[name] for name in FRAME_DATASETS if name in copies]
    for copy in frames:
        depth = copy.chunks[0]
        missing = pack(np.full(copy.chunks, copy.fillvalue, np.uint16))
        for first in np.unique(rows // depth * depth).tolist():
            for y, x in corners(copy):
                try:
                    copy[first, y, x]
                except (OSError, RuntimeError):
                    copy.id.write_direct_chunk((first, y, x), missing)


def _copy(dataset: h5py.Dataset, file: h5py.Group, name: str, check: Callable[[], None]) -> None:
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
    if not {"long_name", "standard_name"} & set(file[name].attrs):
        set_attributes(file[name], {"long_name": name.replace("_", " ")})
    if dataset.is_scale and not (name == "time" and file.name.strip("/") in BY_ROW):
        file[name].make_scale(name)


def _copy_attributes(source: h5py.Group | h5py.Dataset, target: h5py.Group | h5py.Dataset) -> None:
    for key, value in source.attrs.items():
        if key not in _SCALE_MARKS and np.asarray(value).dtype.kind in _PLAIN_KINDS:
            # with its type, which marks text as UTF-8
            target.attrs.create(key, value, dtype=source.attrs.get_id(key).dtype)


def _attach(dataset: h5py.Dataset, group: h5py.Group, name: str) -> None:
    """Give the axes of a dataset their scales, those of the same group; rows of a table the row."""
    if group[name].is_scale:
        return
    scales = [next(iter(scales.values()), dataset) for scales in dataset.dims]
    for axis, own in enumerate(str(scale.name).rsplit("/", 1)[-1] for scale in scales):
        own = "row" if own == "time" and "row" in group else own
        if own in group and group[own].is_scale:
            group[name].dims[axis].attach_scale(group[own])
