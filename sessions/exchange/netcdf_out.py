"""Streams as netCDF files of their own, for programs that do not look into groups.

A session is a netCDF-4 file already; here each group becomes the root of a file, unchanged.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from fieldkit.sessions.datasets import LIBVER
from fieldkit.sessions.layout import entry_columns
from fieldkit.sessions.reader import Session

_SCALE_MARKS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
_PLAIN_KINDS = "biufSU"  # references, among others, mean nothing in another file


def export_netcdf(session: Session, folder: Path) -> list[Path]:
    """One ``.nc`` for each stream and table.

    Raises `SessionError` where a group of the session leads out of its file.
    """
    written = []
    for name in (*session.streams, *entry_columns(session.header)):
        path = folder / f"{session.path.stem}-{name}.nc"
        source = session.group(name)
        datasets = session.datasets(name)
        with h5py.File(path, "w", libver=LIBVER, track_order=True) as file:
            _copy_attributes(source.file, file)
            _copy_attributes(source, file)
            for own, dataset in datasets.items():
                _copy(dataset, file, own)
            for own, dataset in datasets.items():
                _attach(dataset, file, own)
        written.append(path)
    return written


def _copy(dataset: h5py.Dataset, file: h5py.File, name: str) -> None:
    """The dataset under its own name: its chunks as they are, its attributes but for the scales'."""
    dataset.file.copy(dataset, file, name, without_attrs=True)
    _copy_attributes(dataset, file[name])
    if dataset.is_scale:
        file[name].make_scale(name)


def _copy_attributes(source: h5py.Group | h5py.Dataset, target: h5py.Group | h5py.Dataset) -> None:
    for key, value in source.attrs.items():
        if key not in _SCALE_MARKS and np.asarray(value).dtype.kind in _PLAIN_KINDS:
            target.attrs[key] = value


def _attach(dataset: h5py.Dataset, file: h5py.File, name: str) -> None:
    """The scales of a dataset's axes that lie in the same group."""
    if dataset.is_scale:
        return
    for axis, scales in enumerate(dataset.dims):
        for scale in scales.values():
            own = str(scale.name).rsplit("/", 1)[-1]
            if own in file:
                file[name].dims[axis].attach_scale(file[own])
