"""Streams as netCDF files of their own, for programs that do not look into groups.

A session is a netCDF-4 file already; here each group becomes the root of a file, unchanged.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from fieldkit.sessions.datasets import LIBVER
from fieldkit.sessions.layout import entry_columns
from fieldkit.sessions.reader import Session

_SCALE_MARKS = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}


def export_netcdf(session: Session, folder: Path) -> list[Path]:
    """One ``.nc`` for each stream and table."""
    written = []
    for name in (*session.streams, *entry_columns(session.header)):
        path = folder / f"{session.path.stem}-{name}.nc"
        with h5py.File(path, "w", libver=LIBVER, track_order=True) as file:
            source = session.group(name)
            for key, value in (*source.file.attrs.items(), *source.attrs.items()):
                file.attrs[key] = value
            datasets = [item for item in source.values() if isinstance(item, h5py.Dataset)]
            for dataset in datasets:
                _copy(dataset, file)
            for dataset in datasets:
                _attach(dataset, file)
        written.append(path)
    return written


def _copy(dataset: h5py.Dataset, file: h5py.File) -> None:
    """The dataset under its own name: its chunks as they are, its attributes but for the scales'."""
    name = _name(dataset)
    dataset.file.copy(dataset, file, name, without_attrs=True)
    for key, value in dataset.attrs.items():
        if key not in _SCALE_MARKS:
            file[name].attrs[key] = value
    if dataset.is_scale:
        file[name].make_scale(name)


def _attach(dataset: h5py.Dataset, file: h5py.File) -> None:
    if not dataset.is_scale:
        for axis, scales in enumerate(dataset.dims):
            for scale in scales.values():
                file[_name(dataset)].dims[axis].attach_scale(file[_name(scale)])


def _name(dataset: h5py.Dataset) -> str:
    return str(dataset.name).rsplit("/", 1)[1]
