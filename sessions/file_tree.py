"""Makes the tree of a session file: groups, datasets, scales and attributes, all before the first sample."""

from __future__ import annotations

import io
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from hashlib import sha256
from importlib import metadata
from typing import Any

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.version import __version__
from fieldkit.sessions import layout
from fieldkit.sessions.digests import DIGEST_CHARS, object_paths
from fieldkit.sessions.journal import SessionIdentity

ISO_WIDTH = 32

_INSTRUMENT = (
    "vendor", "model", "serial_number", "firmware", "port", "identity", "driver", "rate_hz", "accuracy",
    "latency_s", "wire_time_s", "response_s", "law", "scale", "offset", "unit",
)  # fmt: skip
"""Attributes of an instrument's group, as in `StreamInfo`."""

_STATES = "recording_or_interrupted sealed recovered"

_PACKAGES = ("h5py", "numpy", "scipy", "astropy", "opencv-python-headless", "pyserial", "pyusb")


def file_image(identity: SessionIdentity) -> bytes:
    """The bytes of a session file without samples, made in memory: there no disk can fail."""
    memory = io.BytesIO()  # HDF5 1.14's own image of a file in memory fails its checksum
    with h5py.File(memory, "w", libver=LIBVER) as file:
        _root_attributes(file, identity)
        _entry(file, identity)
        for info in identity.header.streams:
            _stream_group(file, info)
        for name, columns in layout.entry_columns(identity.header).items():
            _entry_group(file, name, columns, identity.header)
        _config(file, identity.header)
        # corrections of the clock are written afterwards and only when asked: data, not edits
        put_columns(put_group(file, "time_map", "NXcollection"), layout.TIME_MAP_COLUMNS)
        _integrity(file)
    return memory.getvalue()


def _root_attributes(file: h5py.File, identity: SessionIdentity) -> None:
    header = identity.header
    set_attributes(
        file,
        {
            "NX_class": "NXroot", "default": "entry", "Conventions": "CF-1.11",
            "title": header.title, "institution": header.operator, "license": header.license,
            "source": "; ".join(f"{info.name}: {info.vendor} {info.model}" for info in header.streams),
            "history": f"{iso_utc(identity.start_ns)} recorded by fieldkit {__version__}",
            "references": header.references, "comment": header.description,
            "fieldkit_format": layout.FORMAT_NAME, "fieldkit_format_version": layout.FORMAT_VERSION,
            "fieldkit_version": __version__, "h5py_version": h5py.version.version,
            "hdf5_version": h5py.version.hdf5_version, "session_id": identity.session_id,
        },
    )  # fmt: skip


def _entry(file: h5py.File, identity: SessionIdentity) -> None:
    header = identity.header
    entry = put_group(file, "entry", "NXentry", default="data")
    # NeXus looks for what is plotted inside the entry; netCDF wants each group in one place only
    cameras_first = sorted(header.streams, key=lambda info: not info.is_camera)
    for plotted in cameras_first[:1]:  # none where nothing was plugged in
        entry["data"] = h5py.SoftLink(f"/{plotted.name}")
    put_text(entry, "title", header.title)
    put_text(entry, "program_name", "fieldkit", version=__version__)
    put_text(entry, "start_time", iso_utc(identity.start_ns), ISO_WIDTH)
    put_text(entry, "end_time", "", ISO_WIDTH)
    meanings = {"flag_values": np.arange(3, dtype="u1"), "flag_meanings": _STATES}
    put_data(entry, "complete", np.uint8(layout.RECORDING), **meanings)
    about_anchor = "UTC less host monotonic clock, taken at the start"
    put_data(entry, "utc_minus_mono_ns", np.int64(identity.anchor_ns), units="ns", long_name=about_anchor)
    put_text(put_group(entry, "user", "NXuser"), "name", header.operator)
    put_group(entry, "site", "NXcollection", **asdict(header.site))
    instrument = put_group(entry, "instrument", "NXinstrument")
    for info in header.streams:
        about = {name: getattr(info, name) for name in _INSTRUMENT}
        put_group(instrument, info.name, "NXdetector" if info.is_camera else "NXsensor", **about)


def _stream_group(file: h5py.File, info: StreamInfo) -> None:
    columns = layout.stream_columns(info)
    signal, axes = "counts", ["y", "x"]
    if not info.is_camera:
        signal, axes = "value", [axis for column in columns if column.name == "value" for axis in column.dims]
    group = put_group(file, info.name, "NXdata", signal=signal, axes=labels(["time", *axes]))
    if info.is_camera:
        rows, cols = info.shape
        put_scale(group, "y", np.arange(rows, dtype="<i4"), units="1", long_name="row, downwards")
        put_scale(group, "x", np.arange(cols, dtype="<i4"), units="1", long_name="column, to the right")
    put_columns(group, columns, 0.0 if info.burst_frames else info.rate_hz)
    if info.is_camera:
        _frames(group, info)
    elif axes:
        is_named = len(info.channels) == info.shape[0]
        put_data(group, "label", labels(info.channels), *(axes if is_named else ()))


def _frames(group: h5py.Group, info: StreamInfo) -> None:
    counts = put_frames(group, "counts", layout.chunk_shape(info), info.shape, layout.FILL_COUNT)
    attach(group, counts, "time", "y", "x")
    linear = info.law == "linear" and np.isfinite(info.scale)
    scaled = {"scale_factor": float(info.scale), "add_offset": float(info.offset), "units": "K"}
    about_kelvin = {"standard_name": "brightness_temperature", "units_metadata": "temperature: on_scale"}
    plain = {"units": "1", "long_name": f"camera counts, law {info.law}"}
    flags = {"ancillary_variables": "flags", "_FillValue": np.uint16(layout.FILL_COUNT)}
    set_attributes(counts, {**({**scaled, **about_kelvin} if linear else plain), **flags})
    if info.metadata_shape[0]:
        put_scale(group, "metadata_row", np.arange(info.metadata_shape[0], dtype="<i4"), units="1")
        depth = layout.chunk_shape(info)[0]
        rows = put_frames(group, "metadata_rows", (depth, *info.metadata_shape), info.metadata_shape, None)
        set_attributes(rows, {"long_name": "rows the camera sent with the frame", "units": "1"})
        same_width = info.metadata_shape[1] == info.shape[1]
        attach(group, rows, "time", "metadata_row", *(("x",) if same_width else ()))


def _entry_group(
    file: h5py.File, name: str, columns: list[layout.Column], header: layout.SessionHeader
) -> None:
    signal = {"signal": "value", "axes": labels(["time"])} if name == "irradiance" else {}
    nx_class = {"irradiance": "NXdata", "events": "NXlog"}.get(name, "NXcollection")
    group = put_group(file, name, nx_class, **signal)
    regions, streams = labels(header.region_names, 64), labels(info.name for info in header.streams)
    xy, enu = labels(["x", "y"], 1), labels(["east", "north", "up"], 5)
    rate_hz = 1.0 if name == "health" else 0.0
    put_columns(group, columns, rate_hz, region=regions, stream=streams, xy=xy, enu=enu)


def _config(file: h5py.File, header: layout.SessionHeader) -> None:
    group = put_group(file, "config", "NXcollection")
    digest = sha256(header.config_toml.encode(errors="replace")).hexdigest()
    put_text(group, "session_toml", header.config_toml, sha256=digest)
    put_text(group, "header", header.to_json(), long_name="everything declared before the first sample, JSON")
    put_text(group, "command_line", header.command_line)
    put_text(group, "packages", _packages())
    put_text(group, "platform", f"{platform.platform()}, Python {platform.python_version()}")


@cache  # what is installed is read from a file of each
def _packages() -> str:
    return "\n".join([f"fieldkit {__version__}", *(f"{name} {_version(name)}" for name in _PACKAGES)])


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _integrity(file: h5py.File) -> None:
    """Room for the digests of all objects, these included; last, when everything else is there."""
    group = put_group(file, "integrity", "NXcollection")
    paths = [*object_paths(file), "integrity/object", "integrity/object_sha256"]
    put_scale(group, "object", labels(paths, max(len(path.encode()) for path in paths)))
    empty = labels([""] * len(paths), DIGEST_CHARS)
    about = "SHA-256 over what a reader gets of the object, hexadecimal"
    put_data(group, "object_sha256", empty, "object", long_name=about)


# --- groups and datasets as readers of netCDF and CF expect them

# The format level is pinned to HDF5 1.10: newer levels cannot be read by older tools, older ones have no
# single-writer-multiple-reader mode. Filters are shuffle and gzip only.
LIBVER = ("v110", "v110")


def iso_utc(time_ns: int) -> str:
    """UTC of nanoseconds since 1970 as ISO 8601 with microseconds."""
    seconds, rest_ns = divmod(time_ns, 10**9)
    moment = datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest_ns // 1000)
    return moment.isoformat(timespec="microseconds")


def put_group(parent: h5py.Group, name: str, nx_class: str, **attributes: Any) -> h5py.Group:
    """A group of a NeXus class."""
    properties = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
    properties.set_attr_phase_change(64, 48)  # in the group's own header: elsewhere they would take 2 kB more
    group = h5py.Group(h5py.h5g.create(parent.id, name.encode(), gcpl=properties))
    set_attributes(group, {"NX_class": nx_class, **attributes})
    return group


def put_text(group: h5py.Group, name: str, text: str, width: int = 0, **attributes: Any) -> h5py.Dataset:
    """A scalar dataset of UTF-8 text of fixed width."""
    data = layout.encode_text(text, width) if width else text.encode(errors="replace")
    kind = h5py.string_dtype("utf-8", width or max(1, len(data)))
    dataset = group.create_dataset(name, data=np.array(data, kind), dtype=kind)
    set_attributes(dataset, attributes)
    return dataset


def put_data(group: h5py.Group, name: str, values: Any, *axes: str, **attributes: Any) -> h5py.Dataset:
    """A dataset of given values; the scales of its axes stand in the same group."""
    dataset = group.create_dataset(name, data=values)
    set_attributes(dataset, attributes)
    attach(group, dataset, *axes)
    return dataset


def put_scale(group: h5py.Group, name: str, values: Any, **attributes: Any) -> None:
    """A dimension scale of given values."""
    put_data(group, name, values, **attributes).make_scale(name)


def put_columns(
    group: h5py.Group, columns: Sequence[layout.Column], rate_hz: float = 0.0, **names: AnyArray
) -> None:
    """The empty, growing datasets of a table; their axes beside time have `names`, or numbers from 0."""
    sizes = {dim: size for column in columns for dim, size in zip(column.dims, column.shape, strict=True)}
    for dim, size in sizes.items():
        about = {} if dim in names else {"units": "1"}
        put_scale(group, dim, names.get(dim, np.arange(size, dtype="<i4")), **about)
    rows = layout.chunk_rows(columns, rate_hz)
    for column in columns:
        dtype = h5py.string_dtype("utf-8", int(column.dtype[1:])) if column.is_text else column.dtype
        dataset = group.create_dataset(
            column.name, (0, *column.shape), dtype, maxshape=(None, *column.shape),
            chunks=(rows, *column.shape), fillvalue=column.fill,
        )  # fmt: skip
        set_attributes(dataset, column.attributes)
        if column.fill is not None and column.fill == column.fill:  # NaN is known without
            dataset.attrs["_FillValue"] = np.array(column.fill, dataset.dtype)
        if column.name == "time":
            dataset.make_scale("time")
        else:
            attach(group, dataset, "time", *column.dims)


def put_rows(group: h5py.Group, rows: Mapping[str, AnyArray]) -> None:
    """Fill the empty columns of a table."""
    for name, values in rows.items():
        group[name].resize((len(values),))
        group[name][:] = values


def put_frames(
    group: h5py.Group, name: str, chunks: tuple[int, ...], shape: tuple[int, ...], fill: int | None
) -> h5py.Dataset:
    """A growing dataset of frames, empty, cut into chunks."""
    return group.create_dataset(
        name, (0, *shape), "<u2", maxshape=(None, *shape), chunks=chunks, fillvalue=fill,
        shuffle=True, compression="gzip", compression_opts=1,
    )  # fmt: skip


def attach(group: h5py.Group, dataset: h5py.Dataset, *names: str) -> None:
    """Give the axes of a dataset of `group` their scales, which stand there too."""
    for axis, name in enumerate(names):
        dataset.dims[axis].attach_scale(group[name])


def set_attributes(node: h5py.Group | h5py.Dataset, attributes: Mapping[str, Any]) -> None:
    """Attributes, text as fixed-length UTF-8 because every reader supports it."""
    for name, value in attributes.items():
        if isinstance(value, str):
            data = value.encode(errors="replace") or b" "
            node.attrs.create(name, np.array(data, h5py.string_dtype("utf-8", len(data))))
        else:
            node.attrs[name] = value


def labels(names: Iterable[str], width: int = 32) -> np.ndarray[Any, Any]:
    """Names as UTF-8 text of fixed width; at least one, as no scale may be empty."""
    texts = [layout.encode_text(name, width) for name in names] or [b""]
    return np.array(texts, h5py.string_dtype("utf-8", width))
