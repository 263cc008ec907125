"""From a session to arrays and tables: curves of regions, kelvin, pandas, xarray.

Everything reads only what it needs: a region's curve touches the tiles of the picture that
the region lies in. Kelvin are brightness temperatures, ``counts * scale + offset`` as the
camera declared it, unless another calibration is handed in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.device import StreamInfo
from fieldkit.errors import SessionError
from fieldkit.physics.camera_laws import planck
from fieldkit.sessions.layout import brick_shape
from fieldkit.site import Region

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from fieldkit.sessions.reader import Session

FloatArray = NDArray[np.float64]
Calibration = Callable[[NDArray[np.uint16]], FloatArray]
"""Kelvin from counts of any shape."""

_BLOCK_BYTES = 32_000_000


@dataclass(frozen=True, slots=True)
class RegionSeries:
    """Brightness temperature of regions over time.

    `time_ns` (n,) UTC; `mean_k` and `spread_k` (n, regions), the spread being the standard
    deviation over the pixels; `pixels` (regions,); `flags` (n,) as `Quality`.
    """

    regions: tuple[str, ...]
    time_ns: NDArray[np.int64]
    mean_k: FloatArray
    spread_k: FloatArray
    pixels: NDArray[np.int64]
    flags: NDArray[np.uint16]


def camera_of(session: Session, stream: str | None = None) -> StreamInfo:
    """The camera named, or the only one; raises `SessionError`."""
    cameras = [info for info in session.streams.values() if info.is_camera]
    chosen = [info for info in cameras if stream in (None, info.name)]
    if len(chosen) != 1:
        have = ", ".join(info.name for info in cameras) or "none"
        raise SessionError(f"{session.path}: which camera? It has {have}", fix="name one: stream=...")
    return chosen[0]


def own_scale(info: StreamInfo) -> Calibration:
    """The camera's own scale; NaN where its counts alone give no temperature."""
    if info.law == "planck":
        return lambda counts: planck(counts, counts[:0], info.settings).astype(np.float64)
    scale, offset = (info.scale, info.offset) if info.law == "linear" else (np.nan, np.nan)
    return lambda counts: counts.astype(np.float64) * scale + offset


def kelvin(
    session: Session, start: int = 0, stop: int | None = None, *, stream: str | None = None,
    calibration: Calibration | None = None,
) -> FloatArray:  # fmt: skip
    """Brightness temperature of pictures `start`..`stop`, shape (n, rows, cols)."""
    info = camera_of(session, stream)
    convert = calibration or own_scale(info)
    return convert(session.raw(info.name)[start : session.count(info.name) if stop is None else stop])


def region_series(
    session: Session, regions: Sequence[Region] | None = None, *, stream: str | None = None,
    calibration: Calibration | None = None,
) -> RegionSeries:  # fmt: skip
    """The curve of each region (of the session's, if none are given).

    Raises `SessionError` where a region has no pixel in the picture.
    """
    info = camera_of(session, stream)
    chosen = tuple(session.regions if regions is None else regions)
    reader, convert = session.stream(info.name), calibration or own_scale(info)
    curves = [_curve(session.raw(info.name), len(reader), info, region, convert) for region in chosen]
    shape = (len(reader), len(chosen))
    return RegionSeries(
        tuple(region.name for region in chosen),
        session.times_ns(info.name),
        np.array([mean for mean, _, _ in curves]).T.reshape(shape),
        np.array([spread for _, spread, _ in curves]).T.reshape(shape),
        np.array([pixels for _, _, pixels in curves], np.int64),
        reader.column("flags"),
    )


def _curve(
    counts: Any, length: int, info: StreamInfo, region: Region, convert: Calibration
) -> tuple[FloatArray, FloatArray, int]:
    """Mean and spread of one region over all pictures, a few bricks at a time."""
    mask = region.mask((info.shape[0], info.shape[1]))
    if not mask.any():
        raise SessionError(f"region {region.name!r} has no pixel in the picture of {info.name}")
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    inside = mask[box]
    depth = brick_shape(info)[0]
    step = max(1, _BLOCK_BYTES // (inside.size * depth * 2)) * depth
    means, spreads = np.empty(length), np.empty(length)
    for start in range(0, length, step):
        stop = min(start + step, length)
        pixels = convert(counts[(slice(start, stop), *box)][:, inside])
        means[start:stop], spreads[start:stop] = pixels.mean(axis=1), pixels.std(axis=1)
    return means, spreads, int(inside.sum())


def channel_names(info: StreamInfo) -> tuple[str, ...]:
    """What the values of a meter are called: its channels, or its quantity where it has one value."""
    if info.shape == (1,):
        return (info.quantity,)
    named = len(info.channels) == info.shape[0]
    return info.channels if named else tuple(f"channel {number}" for number in range(info.shape[0]))


def to_pandas(session: Session, stream: str) -> pd.DataFrame:
    """The samples of a stream by UTC: values of a meter, or of a camera all but the pictures.

    Columns carry their unit in brackets; `DataFrame.attrs` what else was declared.
    """
    import pandas as pd

    reader, info = session.stream(stream), session.streams[stream]
    index = pd.DatetimeIndex(session.times_ns(stream).view("datetime64[ns]"), tz="UTC", name="time")
    table = pd.DataFrame(index=index)
    if info.is_camera:
        table["sensor [K]"] = reader.column("fpa_temperature")
    else:
        values = reader.column("value").reshape(len(reader), *info.shape)  # also without a single reading
        for name, column in zip(channel_names(info), values.T, strict=True):
            table[f"{name} [{info.unit}]"] = column
    for name in ("seq", "flags", "mono_ns"):
        table[name] = reader.column(name)
    table.attrs = {"stream": stream, "quantity": info.quantity, "unit": info.unit, "device": info.model}
    return table


def to_xarray(session: Session, stream: str) -> xr.Dataset:
    """A stream as an xarray dataset, lazily: counts of a camera read as kelvin.

    Raises `SessionError` for an interrupted session, which other programs cannot open, and for a stream
    that does not lie in the session's file, which they would follow out of it.
    """
    import xarray as xr

    if session.state == "interrupted":
        raise SessionError(f"{session.path} is interrupted", fix=f"fieldkit recover {session.path}")
    session.stream(stream)
    session.datasets(stream)
    is_live = session.group(stream).file.swmr_mode  # HDF5 opens a file in one way only
    options: dict[str, Any] = {"driver_kwds": {"swmr": True}} if is_live else {}
    return xr.open_dataset(session.path, group=stream, engine="h5netcdf", **options)
