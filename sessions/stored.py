"""Content of a session file itself: the one way from a path to an object and to its data.

A file may come from anywhere. Nothing here follows a link out of it, reads data stored in another file,
or takes more memory than the file has bytes to fill.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray, IntArray
from fieldkit.model.errors import FormatError, SessionError, message_of
from fieldkit.model.next_step import Action
from fieldkit.sessions.layout import Column, decode_text
from fieldkit.sessions.superblock import real_bytes

MOST_CHUNK_BYTES = 16_777_216
"""A chunk of a table; the writer's have a few hundred kilobytes at most."""

DEFLATE_RATIO = 1032
"""Nothing that deflate packs is larger: zlib's technical details."""


def explain(path: Path, error: Exception) -> SessionError:
    """Error with the session and the next step."""
    if isinstance(error, FormatError):  # another error of it: none may be its own cause
        return FormatError(error.problem, place=error.place, fix=error.fix)
    text = message_of(error)
    names_path = isinstance(error, SessionError) and str(path) in text
    fix = getattr(error, "fix", None) or Action.RECOVER(path)
    return SessionError(text if names_path else f"{path} is damaged: {text}", fix=fix)


def closed_error(path: Path) -> SessionError:
    """Error of reading a session that was closed."""
    return SessionError("closed", place=path, fix=f'open it again: fieldkit.open_session("{path}")')


def stored_here(group: h5py.Group, path: str) -> Any:
    """Object at a path within this very file; raises `SessionError` where there is nothing, or a link."""
    node: Any = group
    for name in path.split("/"):
        if node.__class__ is h5py.Dataset or link_of(node, name).__class__ is not h5py.HardLink:
            raise SessionError("missing, or points somewhere else", place=path)
        try:
            node = node[name]
        except (KeyError, OSError, RuntimeError) as error:
            raise SessionError(f"cannot be read: {error}", place=path) from error
    if node.__class__ is h5py.Dataset and (node.is_virtual or node.external):
        raise SessionError("does not hold its data itself", place=node.name)
    return node


def group_of(file: h5py.File, name: str) -> h5py.Group:
    """The group of a stream or table within this very file; raises `SessionError` where there is none."""
    group = stored_here(file, name)
    if not isinstance(group, h5py.Group):
        raise SessionError("is not a group", place=name)
    return group


def link_of(group: h5py.Group, name: str) -> object:
    """Object behind a name of a group, None if it has none; raises `SessionError` if the group is damaged."""
    try:
        return group.get(name, getlink=True)
    except RuntimeError as error:
        raise SessionError(f"cannot be read: {error}", place=group.name) from error


def dataset_of(group: h5py.Group, name: str, row_shape: tuple[int, ...], dtype: str) -> h5py.Dataset:
    """A dataset that really lies in this file and has rows as declared, of a dtype; raises `SessionError`."""
    path = f"{group.name.rstrip('/')}/{name}"
    dataset = stored_here(group, name)
    if not isinstance(dataset, h5py.Dataset):
        raise SessionError("a group, not a dataset", place=path)
    is_declared = dataset.ndim == 1 + len(row_shape) and dataset.shape[1:] == row_shape
    if not is_declared or dataset.dtype.str[1:] != dtype:
        problem = f"shape {dataset.shape}, {dataset.dtype}; expected rows of {row_shape}"
        raise SessionError(problem, place=path)
    return dataset


def columns_of(
    group: h5py.Group, columns: Iterable[Column], *, salvage: bool = False
) -> dict[str, h5py.Dataset]:
    """The datasets of columns by their names, without those that the file never had.

    A file of a later minor version may have more of them, one of an earlier version fewer. None has more rows
    than it has bytes for (unless torn: `salvage`).
    """
    datasets: dict[str, h5py.Dataset] = {}
    for column in columns:
        if was_made(group, name := column.name):
            datasets[name] = dataset_of(group, name, column.shape, np.dtype(column.dtype).str[1:])
            check_size(datasets[name], salvage=salvage)
    return datasets


def was_made(group: h5py.Group, name: str) -> bool:
    """True if the file has, or once had, an object of that name: it lists what it was made with."""
    path = f"{group.name}/{name}".lstrip("/")
    return link_of(group, name) is not None or path in texts_of(group.file, "integrity/object")


def texts_of(file: h5py.File, path: str) -> list[str]:
    """The texts of a dataset; raises `SessionError` where it does not hold texts."""
    dataset = stored_here(file, path)
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind != "S" or dataset.ndim != 1:
        raise SessionError("does not hold texts", place=path)
    check_size(dataset)
    return [decode_text(text) for text in dataset[:].tolist()]


def check_size(dataset: h5py.Dataset, *, salvage: bool = False) -> None:
    """Raise `SessionError` where a dataset claims more than it has bytes for.

    One that is torn (`salvage`) may: of it only `whole_rows` are read.
    """
    if not salvage and dataset.size * dataset.dtype.itemsize > stored_bytes(dataset):
        raise SessionError(f"claims {dataset.shape} values that are not there", place=dataset.name)
    most = min(MOST_CHUNK_BYTES, file_bytes(dataset)) if dataset.size and not salvage else MOST_CHUNK_BYTES
    if dataset.chunks and math.prod(dataset.chunks) * dataset.dtype.itemsize > most:
        raise SessionError(f"cut into chunks of {dataset.chunks}", place=dataset.name)


def stored_bytes(dataset: h5py.Dataset) -> int:
    """Bytes of a dataset in the file, at most all of them; raises `SessionError` without an index."""
    try:
        return min(int(dataset.id.get_storage_size()), file_bytes(dataset))
    except RuntimeError as error:
        raise SessionError(f"its index is damaged: {error}", place=dataset.name) from error


def file_bytes(node: h5py.Group | h5py.Dataset) -> int:
    """Bytes of the file that an object lies in, without those that it has lost but counts."""
    file = h5py.h5i.get_file_id(node.id)
    return real_bytes(file.name) or int(file.get_filesize())


def unknown_rows(group: h5py.Group, column: Column, rows: int) -> AnyArray:
    """Rows of a column that a file never had; raises `SessionError` where no such file could have them.

    That so many rows are there is known of other columns, which may be a thousand times as narrow.
    """
    if rows * column.row_bytes > file_bytes(group):
        raise SessionError(f"lacks {rows} rows of {column.shape}", place=f"{group.name}/{column.name}")
    return column.unknown(rows)


def whole_rows(dataset: h5py.Dataset, end: int) -> IntArray:
    """Rows of an uncompressed growing dataset whose bytes lie in the first `end` bytes of the file."""
    spans: list[tuple[int, int]] = []
    row_bytes = dataset.dtype.itemsize * math.prod(dataset.shape[1:])

    def visit(chunk: Any) -> None:
        first = int(chunk.chunk_offset[0])
        rows = min((end - chunk.byte_offset) // row_bytes, dataset.chunks[0], dataset.shape[0] - first)
        spans.append((first, first + max(0, rows)))

    with contextlib.suppress(RuntimeError, OSError):  # a part of the index is gone: so are its chunks
        dataset.id.chunk_iter(visit)
    if sum(last - first for first, last in spans) * row_bytes > end:  # many chunks at one place
        raise SessionError("its index is damaged", place=dataset.name)
    return np.sort(np.concatenate([np.empty(0, np.int64), *(np.arange(*span) for span in spans)]))
