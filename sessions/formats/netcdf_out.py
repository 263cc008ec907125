"""Streams as netCDF files of their own, for programs that do not look into groups.

A session is a netCDF-4 file already; here each group becomes the root of a file, its flags verified.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import h5py
import numpy as np

from fieldkit.sessions.bricks import corners, pack
from fieldkit.sessions.datasets import LIBVER
from fieldkit.sessions.formats.unreadable import all_but_unreadable
from fieldkit.sessions.layout import entry_columns
from fieldkit.sessions.reader import Session
from fieldkit.sessions.stream_reader import StreamReader

_SCALE_MARKS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
_PLAIN_KINDS = "biufSU"  # references, among others, mean nothing in another file


def export_netcdf(session: Session, folder: Path) -> list[Path]:
    """One ``.nc`` for each stream and table.

    The flags are verified, so that a sample which does not match its checksum says so; frames that cannot be
    read are the fill value. Raises `IncompleteError`, when all the others are written, for a group that
    cannot be read or leads out of the session's file.
    """
    groups = (*session.streams, *entry_columns(session.header))
    return all_but_unreadable(
        (name, partial(_export, session, name, folder / f"{session.path.stem}-{name}.nc")) for name in groups
    )


def _export(session: Session, name: str, path: Path) -> Path:
    source = session.group(name)
    datasets = session.datasets(name)
    with h5py.File(path, "w", libver=LIBVER, track_order=True) as file:
        _copy_attributes(source.file, file)
        _copy_attributes(source, file)
        for own, dataset in datasets.items():
            _copy(dataset, file, own)
        for own, dataset in datasets.items():
            _attach(dataset, file, own)
        if name in session.streams:
            _verify(session.stream(name), file)
    return path


def _verify(reader: StreamReader, file: h5py.File) -> None:
    """Verified flags in place of those stored, and chunks that cannot be read replaced by the fill value."""
    file["flags"][:] = reader.flags()
    rows = np.array(sorted(reader.damaged), np.int64)
    for brick in reader.bricks:
        copy = file[brick.name.rsplit("/", 1)[1]]
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
            # with its type, which says that text is UTF-8
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
