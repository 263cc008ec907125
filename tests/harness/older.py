"""Session files as earlier versions of fieldkit left them, made of one of today."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.guarded_file import write_in_place
from fieldkit.sessions.layout import entry_columns
from fieldkit.sessions.reader import open_session

_SINCE_1_1 = ("integrity/object_sha256", "integrity/object", "integrity/columns_crc32", "time_map/crc32")


def as_version_1_0(path: Path, without: Sequence[str] = ()) -> None:
    """Take out what version 1.1 added (and columns that came `without` a new version), and seal it so."""
    with h5py.File(path, "r+", libver=LIBVER, track_order=True) as file:
        for name in (*_SINCE_1_1, *without):
            del file[name]
        file.attrs["fieldkit_format_version"] = np.bytes_("1.0")
    with open_session(path) as session:
        tables = entry_columns(session.header)
    with h5py.File(path) as file:
        checksums = [
            _checksum([file[name][column.name][:] for column in columns if column.name in file[name]])
            for name, columns in tables.items()
        ]
    write_in_place(path, {"integrity/table_crc32": checksums})


def _checksum(columns: list[np.ndarray]) -> int:
    """CRC-32 over the columns of a table as version 1.0 knew them, one after the other."""
    return zlib.crc32(b"".join(values.tobytes() for values in columns))
