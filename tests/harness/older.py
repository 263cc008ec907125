"""Session files as earlier versions of fieldkit left them, made of one of today."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fieldkit.sessions.file_tree import LIBVER, attach, labels, put_digests, put_scale
from fieldkit.sessions.guarded_file import write_in_place
from fieldkit.sessions.layout import entry_columns
from fieldkit.sessions.reader import open_session

_SINCE_1_1 = ("integrity/object_sha256", "integrity/object", "integrity/columns_crc32", "time_map/crc32")
_SINCE_1_2 = ("learnt",)
_SINCE_1_3 = ("later_estimates", "regions/removed")


def as_version_1_0(path: Path, without: Sequence[str] = ()) -> None:
    """Take out what later versions added (and columns that came `without` a new version), and seal it so."""
    with h5py.File(path, "r+", libver=LIBVER, track_order=True) as file:
        _take_out(file, (*_SINCE_1_1, *_SINCE_1_2, *_SINCE_1_3, *without), "1.0")
    _seal_tables(path)


def as_version_1_1(path: Path) -> None:
    """Take out what later versions added, and seal it so."""
    _as_version(path, "1.1", (*_SINCE_1_2, *_SINCE_1_3))


def as_version_1_2(path: Path) -> None:
    """Take out what version 1.3 added, and seal it so."""
    _as_version(path, "1.2", _SINCE_1_3)


def _as_version(path: Path, version: str, without: Sequence[str]) -> None:
    with h5py.File(path, "r+", libver=LIBVER, track_order=True) as file:
        _take_out(file, (*without, "integrity/object", "integrity/object_sha256"), version)
        put_digests(file)
    _seal_tables(path)
    with open_session(path) as session:
        digests = [session.object_digest(name) for name in session.sealed_objects()]
    write_in_place(path, {"integrity/object_sha256": digests})


def _take_out(file: h5py.File, names: Sequence[str], version: str) -> None:
    tables = [table for table in file["integrity/table"].asstr()[:] if table not in names]
    for name in (*names, "integrity/table", "integrity/table_crc32"):
        del file[name]
    group = file["integrity"]
    put_scale(group, "table", labels(tables))
    group.create_dataset("table_crc32", data=np.zeros(len(tables), "<u4"), track_order=True)
    attach(group, group["table_crc32"], "table")
    file.attrs["fieldkit_format_version"] = np.bytes_(version)


def _seal_tables(path: Path) -> None:
    with open_session(path) as session:
        columns, tables = entry_columns(session.header), session.tables
    with h5py.File(path) as file:
        checksums = [
            _checksum([file[name][column.name][:] for column in columns[name] if column.name in file[name]])
            for name in tables
        ]
    write_in_place(path, {"integrity/table_crc32": checksums})


def _checksum(columns: list[np.ndarray]) -> int:
    """CRC-32 over the columns of a table as version 1.0 knew them, one after the other."""
    return zlib.crc32(b"".join(values.tobytes() for values in columns))
