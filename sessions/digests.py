"""Digests of the objects of a session file: all that gives its numbers their meaning is sealed under them.

An object is a group or a dataset. Its digest is SHA-256 over what a reader gets of it (names of members,
type, shape, values, scales, attributes), not over how HDF5 lays it out. Three kinds of values are excluded:
frames, each of which has a checksum of its own; the corrections of the clock and of marks, which are added
after the seal and have a checksum per row; and what sealing itself writes last.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from itertools import chain
from typing import Any

import h5py
import numpy as np

from fieldkit.sessions.layout import FRAME_DATASETS, LATER_EVENTS
from fieldkit.sessions.stored import check_size, stored_here

ROOT = "/"
DIGEST_CHARS = 64
NOT_YET = {"entry/complete", "integrity/object_sha256"}
"""Written after the digests were taken."""

_LATER = "time_map/"
_REFERENCES = {"DIMENSION_LIST", "REFERENCE_LIST"}  # places in this very file
_BLOCK_BYTES = 1_048_576


def object_paths(file: h5py.File) -> list[str]:
    """Paths of all groups and datasets of a file, in the order of their names; links are not followed."""
    paths = [ROOT]
    h5py.h5o.visit(file.id, lambda path: paths.append(path.decode()))
    return paths


def object_digest(file: h5py.File, path: str) -> str:
    """The digest of one object, in hexadecimal.

    Raises `SessionError` where there is none, or it claims what is not there; `OSError`, `RuntimeError` or
    `KeyError` where HDF5 cannot read it.
    """
    node = file if path == ROOT else stored_here(file, path)
    members = {*node} - {LATER_EVENTS} if isinstance(node, h5py.Group) else None
    content = _data(node, path) if members is None else map(_with_end, sorted(members))
    digest = sha256()
    for part in chain(_attributes(node), content):
        digest.update(part)
    return digest.hexdigest()


def set_attribute(file: h5py.File, name: str, value: int) -> None:
    """Set an attribute of a sealed file, and with it the digest of those, if this was that of the file."""
    before, digests = object_digest(file, ROOT).encode(), file["integrity/object_sha256"]
    file.attrs[name] = value
    for place in np.flatnonzero(digests[:] == before):
        digests[place] = object_digest(file, ROOT).encode()


def _attributes(node: h5py.Group | h5py.Dataset) -> Iterator[bytes]:
    attributes = node.attrs
    for name in sorted(set(attributes) - _REFERENCES):
        value = np.asarray(attributes[name])
        yield _head(f"@{name}", value)
        yield value.tobytes()


def _data(dataset: h5py.Dataset, path: str) -> Iterator[bytes]:
    """Description and content of a dataset; of one that grows after the seal, without how long it is."""
    grows = path.startswith(_LATER)
    yield _head("", dataset if not grows else np.empty(dataset.shape[1:], dataset.dtype))
    for axis in range(dataset.ndim):
        scales: list[h5py.h5d.DatasetID] = []
        if h5py.h5ds.get_num_scales(dataset.id, axis):  # HDF5 takes it for a mistake to go through none
            h5py.h5ds.iterate(dataset.id, axis, scales.append, 0)
        for scale in scales:
            yield h5py.h5ds.get_scale_name(scale) + b"\0"
    if not (grows or path in NOT_YET or path.rsplit("/", 1)[-1] in FRAME_DATASETS):
        yield from _values(dataset)


def _values(dataset: h5py.Dataset) -> Iterator[bytes]:
    check_size(dataset)
    if not dataset.ndim:
        yield np.asarray(dataset[()]).tobytes()
        return
    row_bytes = max(1, dataset.dtype.itemsize * int(np.prod(dataset.shape[1:])))
    step = max(1, _BLOCK_BYTES // row_bytes)
    for start in range(0, len(dataset), step):
        yield dataset[start : start + step].tobytes()


def _head(name: str, value: Any) -> bytes:
    return _with_end(f"{name} {value.dtype.str} {tuple(value.shape)}")


def _with_end(text: str) -> bytes:
    """Text after which no other can begin."""
    return text.encode(errors="surrogateescape") + b"\0"
