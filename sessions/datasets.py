"""Groups and datasets as readers of netCDF and CF expect them: text, scales, units, growing tables, bricks.

The format level is pinned to HDF5 1.10: newer levels cannot be read by older tools, older
ones know no single-writer-multiple-reader mode. Filters are shuffle and gzip only.
Creation order is tracked everywhere, which netCDF asks for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.sessions.layout import Column, encode_text

LIBVER = ("v110", "v110")


def iso_utc(time_ns: int) -> str:
    """UTC of nanoseconds since 1970 as ISO 8601 with microseconds."""
    seconds, rest_ns = divmod(time_ns, 10**9)
    moment = datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest_ns // 1000)
    return moment.isoformat(timespec="microseconds")


def put_group(parent: h5py.Group, name: str, nx_class: str, **attributes: Any) -> h5py.Group:
    """A group of a NeXus class."""
    group = parent.create_group(name, track_order=True)
    set_attributes(group, {"NX_class": nx_class, **attributes})
    return group


def put_text(group: h5py.Group, name: str, text: str, width: int = 0, **attributes: Any) -> h5py.Dataset:
    """A scalar dataset of UTF-8 text of fixed width."""
    data = encode_text(text, width) if width else text.encode(errors="replace")
    kind = h5py.string_dtype("utf-8", width or max(1, len(data)))
    dataset = group.create_dataset(name, data=np.array(data, kind), dtype=kind, track_order=True)
    set_attributes(dataset, attributes)
    return dataset


def put_scale(group: h5py.Group, name: str, values: Any, **attributes: Any) -> None:
    """A dimension scale of given values."""
    dataset = group.create_dataset(name, data=values, track_order=True)
    set_attributes(dataset, {"long_name": _words(name), **attributes})
    dataset.make_scale(name)


def put_columns(group: h5py.Group, columns: Iterable[Column], time_name: str = "time") -> None:
    """The empty, growing datasets of a table, with their scales."""
    for column in columns:
        dtype = h5py.string_dtype("utf-8", int(column.dtype[1:])) if column.is_text else column.dtype
        dataset = group.create_dataset(
            column.name, (0, *column.shape), dtype, maxshape=(None, *column.shape),
            chunks=(column.chunk_rows, *column.shape), fillvalue=column.fill, track_order=True,
        )  # fmt: skip
        named = {} if "standard_name" in column.attributes else {"long_name": _words(column.name)}
        set_attributes(dataset, {**named, **column.attributes})
        if column.fill is not None:
            dataset.attrs["_FillValue"] = np.array(column.fill, dataset.dtype)
        if column.name == time_name:
            dataset.make_scale(time_name)
        else:
            attach(group, dataset, time_name, *column.dims)


def put_rows(group: h5py.Group, rows: Mapping[str, NDArray[Any]]) -> None:
    """Fill the empty columns of a table."""
    for name, values in rows.items():
        group[name].resize((len(values),))
        group[name][:] = values


def put_bricks(
    group: h5py.Group, name: str, bricks: tuple[int, ...], shape: tuple[int, ...], fill: int | None
) -> h5py.Dataset:
    """A growing dataset of pictures, empty, cut into bricks."""
    return group.create_dataset(
        name, (0, *shape), "<u2", maxshape=(None, *shape), chunks=bricks, fillvalue=fill,
        shuffle=True, compression="gzip", compression_opts=1, track_order=True,
    )  # fmt: skip


def attach(group: h5py.Group, dataset: h5py.Dataset, *names: str) -> None:
    """Give the axes of a dataset of `group` their scales, which stand there too."""
    for axis, name in enumerate(names):
        dataset.dims[axis].attach_scale(group[name])


def set_attributes(node: h5py.Group | h5py.Dataset, attributes: Mapping[str, Any]) -> None:
    """Attributes, text as fixed-length UTF-8 because every reader knows that kind."""
    for name, value in attributes.items():
        if isinstance(value, str):
            data = value.encode(errors="replace") or b" "
            node.attrs.create(name, np.array(data, h5py.string_dtype("utf-8", len(data))))
        else:
            node.attrs[name] = value


def labels(names: Iterable[str], width: int = 32) -> np.ndarray[Any, Any]:
    """Names as UTF-8 text of fixed width; at least one, as no scale may be empty."""
    data = [encode_text(name, width) for name in names] or [b""]
    return np.array(data, h5py.string_dtype("utf-8", width))


def _words(name: str) -> str:
    """A name in words, its unit left to the units attribute."""
    for unit in ("_deg", "_ns", "_us", "_ms", "_bytes"):
        name = name.removesuffix(unit)
    return name.replace("_", " ")
