"""From a session to arrays and tables: time series of regions, kelvin, pandas, xarray.

Kelvin are brightness temperatures by the law that the camera declared, unless another calibration is
given. Flags are verified: a sample that does not match its checksum has `Quality.BAD_CRC`. A region's time
series reads only the chunks of the frame that the region lies in, where the seal vouches for the rest.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.arrays import CountArray, FlagArray, FloatArray, IntArray
from fieldkit.model.channels import quantity_of
from fieldkit.model.device import StreamInfo, regions_on
from fieldkit.model.errors import IntegrityError, SessionError
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.quantities import UNKNOWN
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import is_damaged, is_usable
from fieldkit.model.site import Region
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.camera_laws import frames_k, needs_metadata_rows
from fieldkit.sessions.layout import chunk_shape
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stream_reader import FrameBlock, Readings, StreamReader

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Calibration = Callable[[CountArray], FloatArray]
"""Kelvin from counts of any shape."""

_BLOCK_BYTES = 32_000_000


@dataclass(frozen=True, slots=True)
class RegionSeries:
    """Brightness temperature of regions over time.

    Attributes
    ----------
    regions : tuple of str
        Names of the regions: the columns of the arrays.
    time_ns : (n,) array of int
        UTC of the frames, corrected by the active time map. [nanoseconds since 1970]
    mean_k : (n, regions) array
        Mean brightness temperature of the region's pixels; NaN where they cannot be read. [K]
    spread_k : (n, regions) array
        Standard deviation over the region's pixels. [K]
    pixels : (regions,) array of int
        Number of pixels of each region.
    flags : (n,) array of int
        `Quality` of the frames.
    """

    regions: tuple[str, ...]
    time_ns: IntArray
    mean_k: FloatArray
    spread_k: FloatArray
    pixels: IntArray
    flags: FlagArray


def camera_of(session: SessionReader, stream: str | None = None) -> StreamInfo:
    """The camera named, or the only one; raises `SessionError`."""
    cameras = [info for info in session.streams.values() if info.is_camera]
    chosen = [info for info in cameras if stream in (None, info.name)]
    if len(chosen) != 1:
        have = ", ".join(info.name for info in cameras) or "none"
        problem = f"which camera? It has {have}" if stream is None else f"{stream!r} is not a camera"
        raise SessionError(problem, place=session.path, fix=Argument("stream") + f" is one of {have}")
    return chosen[0]


def _to_kelvin(info: StreamInfo, calibration: Calibration | None) -> Callable[[FrameBlock], FloatArray]:
    """Kelvin of frames, or of a part of them, in their shape."""
    if calibration is not None:
        return lambda frames: calibration(frames.counts)
    return lambda frames: frames_k(info, frames.counts, frames.metadata_rows)


def kelvin(
    session: SessionReader, start: int = 0, stop: int | None = None, *, stream: str | None = None,
    calibration: Calibration | None = None, damaged: Literal["raise", "nan"] = "raise",
) -> FloatArray:  # fmt: skip
    """Brightness temperature of a camera's frames, each frame verified by its checksum.

    Parameters
    ----------
    session : Session
        An open session.
    start, stop : int
        First frame, and the frame after the last; all frames by default.
    stream : str, optional
        The camera's stream; may be omitted where the session has only one camera.
    calibration : callable, optional
        Kelvin from counts of any shape, in place of the camera's own law.
    damaged : {"raise", "nan"}
        What a frame becomes that does not match its checksum or cannot be read: an error, or NaN.

    Returns
    -------
    (n, rows, cols) array
        Brightness temperature. [K]

    Raises
    ------
    IntegrityError
        A frame is damaged, and `damaged` is "raise".
    SessionError
        There is no such camera, or `stream` is needed to choose one.

    Examples
    --------
    >>> session["camera"].kelvin(0, 2).shape
    (2, 120, 160)
    """
    info = camera_of(session, stream)
    convert, parts = _to_kelvin(info, calibration), [np.empty((0, *info.shape))]
    for frames in session.stream(info.name).frame_blocks(start, stop):
        values = convert(frames)
        bad = is_damaged(frames.flags)
        if damaged == "raise" and bad.any():
            problem = f"frame {frames.start + int(np.argmax(bad))} of {info.name} does not match its checksum"
            fix = Argument("damaged", "nan") + " returns NaN there; " + Action.CHECK() + " lists them"
            raise IntegrityError(problem, place=session.path, fix=fix)
        values[bad] = np.nan
        parts.append(values)
    return np.concatenate(parts)


def region_series(
    session: SessionReader, regions: Sequence[Region] | None = None, *, stream: str | None = None,
    calibration: Calibration | None = None,
) -> RegionSeries:  # fmt: skip
    """Mean brightness temperature of regions over time; reads only the chunks the regions lie in.

    Parameters
    ----------
    session : Session
        An open session.
    regions : sequence of Region, optional
        The regions, in pixel coordinates, the same in all frames; those of the session by default, each as it
        was drawn when the frame was taken.
    stream : str, optional
        The camera's stream; may be omitted where the session has only one camera.
    calibration : callable, optional
        Kelvin from counts of any shape, in place of the camera's own law.

    Returns
    -------
    RegionSeries
        Mean, spread and flags of every frame.

    Raises
    ------
    SessionError
        A region covers no pixel of the frame, or there is no such camera.

    Examples
    --------
    >>> series = session["camera"].region_series()
    >>> series.mean_k.shape
    (60, 4)
    """
    info = camera_of(session, stream)
    schedule = session.region_schedule if regions is None else RegionSchedule.of(regions)
    reader, convert = session.stream(info.name), _to_kelvin(info, calibration)
    minutes = session.times_ns(info.name) // MINUTE_NS
    on_camera = regions_on(info.name, schedule.latest, session.streams.values())
    chosen = on_camera if regions is None else tuple(regions)
    series = [_drawn_series(reader, schedule, region, minutes, convert) for region in chosen]
    # a chunk's own checksum vouches for its pixels; the stamps and flags need the seal, or the whole frame
    flags = reader.column("flags") if session.columns_are_sealed(info.name) else reader.flags()
    shape = (len(reader), len(chosen))
    return RegionSeries(
        tuple(region.name for region in chosen),
        session.times_ns(info.name),
        np.array([part.mean for part in series]).T.reshape(shape),
        np.array([part.spread for part in series]).T.reshape(shape),
        np.array([part.pixels for part in series], np.int64),
        np.bitwise_or.reduce([flags, *(part.flags for part in series)]),
    )


class _RegionSeries(NamedTuple):
    mean: FloatArray
    spread: FloatArray
    flags: FlagArray
    pixels: int


def _drawn_series(
    reader: StreamReader,
    schedule: RegionSchedule,
    region: Region,
    minutes: IntArray,
    convert: Callable[[FrameBlock], FloatArray],
) -> _RegionSeries:
    """Mean and spread of a region as it was drawn in each minute; NaN where it was not."""
    if schedule.is_constant:
        return _region_series(reader, region, convert)
    mean, spread = np.full((2, len(reader)), np.nan)
    flags, pixels = np.zeros(len(reader), np.uint32), 0
    for drawn, since, until in schedule.versions(region.name):
        holds = (minutes >= since) & (minutes < until)
        if holds.any():
            series = _region_series(reader, drawn, convert)
            mean[holds], spread[holds] = series.mean[holds], series.spread[holds]
            flags[holds] = series.flags[holds]
            pixels = series.pixels
    return _RegionSeries(mean, spread, flags, pixels)


def _region_series(
    reader: StreamReader, region: Region, convert: Callable[[FrameBlock], FloatArray]
) -> _RegionSeries:
    """Mean and spread of one region over all frames, a few chunks at a time."""
    info = reader.info
    mask = region.mask((info.shape[0], info.shape[1]))
    if not mask.any():
        raise SessionError(f"has no pixel in the frame of {info.name}", place=region.name)
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    inside = mask[box]
    step = max(1, _BLOCK_BYTES // (inside.size * chunk_shape(info)[0] * 2))
    mean, spread = np.empty((2, len(reader)))
    flags = np.empty(len(reader), np.uint32)
    for part in reader.crops(box, step, with_rows=needs_metadata_rows(info)):
        pixels = convert(replace(part, counts=part.counts[:, inside]))
        pixels[is_damaged(part.flags)] = np.nan
        span = slice(part.start, part.start + len(pixels))
        has_holes = bool(np.isnan(pixels).any())
        with warnings.catch_warnings():  # of frames in which no pixel has a value
            warnings.simplefilter("ignore", RuntimeWarning)
            mean[span] = (np.nanmean if has_holes else np.mean)(pixels, axis=1)
            spread[span] = (np.nanstd if has_holes else np.std)(pixels, axis=1)
        flags[span] = part.flags
    return _RegionSeries(mean, spread, flags, int(inside.sum()))


def minute_means(
    session: SessionReader, meter: str, channel: int = 0, *, recorded: bool = False
) -> tuple[IntArray, FloatArray]:
    """Middle (UTC ns) and mean of every minute of a meter's channel, of its usable readings.

    `recorded` takes the times as recorded, without the active time map.
    """
    is_angle = quantity_of(session.streams[meter]).is_angle
    return means_by_minute(session.readings(meter, recorded=recorded), channel, is_angle=is_angle)


def means_by_minute(
    readings: Readings, channel: int = 0, *, is_angle: bool = False
) -> tuple[IntArray, FloatArray]:
    """Middle (UTC ns) and mean of every minute of a channel, of the usable readings.

    The mean of angles, degrees, is the direction of their unit vectors' mean: that of 359 and 1 is 0.
    """
    values = readings.values[:, channel]
    good = is_usable(readings.flags) & np.isfinite(values)
    minutes, place = np.unique(readings.time_ns[good] // MINUTE_NS, return_inverse=True)
    values = values[good]
    if is_angle:
        east, north = (np.bincount(place, of(np.radians(values))) for of in (np.sin, np.cos))
        means = np.degrees(np.arctan2(east, north)) % 360.0
    else:
        means = np.bincount(place, values) / np.bincount(place) if minutes.size else np.empty(0)
    return minutes * MINUTE_NS + MINUTE_NS // 2, means


def channel_names(info: StreamInfo) -> tuple[str, ...]:
    """Names of the values of a meter: its channels, or its known quantity where it has one value."""
    if info.shape == (1,) and info.quantity != UNKNOWN:
        return (info.quantity,)
    named = len(info.channels) == info.shape[0]
    return info.channels if named else tuple(f"channel {number}" for number in range(info.shape[0]))


def stream_columns(session: SessionReader, stream: str) -> dict[str, NDArray[Any]]:
    """The samples of a stream as columns by name, ``time`` (datetime64[ns], UTC) first.

    They are the values of a meter; of a camera all but the frames. Names end in their unit in brackets.
    """
    reader, info = session.stream(stream), session.streams[stream]
    columns: dict[str, NDArray[Any]] = {"time": session.times_ns(stream).view("datetime64[ns]")}
    if info.is_camera:
        columns["sensor [K]"] = reader.column("fpa_temperature")
        flags = reader.flags()
    else:
        readings = session.readings(stream)
        flags = readings.flags
        names = (f"{name} [{info.unit}]" for name in channel_names(info))
        columns.update(zip(names, readings.values.T, strict=True))
    return {**columns, "seq": reader.column("seq"), "flags": flags, "mono_ns": reader.column("mono_ns")}


def as_frame(columns: Mapping[str, NDArray[Any]]) -> pd.DataFrame:
    """The columns as a pandas frame indexed by their ``time``; times in UTC."""
    import pandas as pd

    in_utc = {
        name: pd.DatetimeIndex(values, tz="UTC", name=name) if values.dtype.kind == "M" else values
        for name, values in columns.items()
    }
    return pd.DataFrame(in_utc).set_index("time")


def to_pandas(session: SessionReader, stream: str) -> pd.DataFrame:
    """The samples of a stream by UTC: the values of a meter; of a camera all but the frames.

    Column names end in their unit in brackets; `DataFrame.attrs` has stream, quantity, unit and device.

    Examples
    --------
    >>> table = session["thermometer"].to_pandas()
    >>> table.columns.tolist()[:2], len(table)
    (['T1 [K]', 'T2 [K]'], 1201)
    """
    table, info = as_frame(stream_columns(session, stream)), session.streams[stream]
    table.attrs = {"stream": stream, "quantity": info.quantity, "unit": info.unit, "device": info.model}
    return table


def to_xarray(session: SessionReader, stream: str) -> xr.Dataset:
    """A stream as an xarray dataset, read lazily; the variable of its values has the name of their quantity.

    Counts of a linear camera are read as kelvin; those of others stay ``counts``. Times are corrected by the
    active time map, values that cannot be are NaN, and `flags` are verified by the checksums when they are
    read, which reads the whole stream. Raises `SessionError` for an interrupted session, which other programs
    cannot open, and for a stream that lies outside the session's file, into which they would follow the link.

    Examples
    --------
    >>> session["lux"].to_xarray()["illuminance"].sizes["time"]
    1200
    """
    import xarray as xr

    from fieldkit.sessions.lazy_flags import verified_flags

    if session.state == "interrupted":
        raise SessionError("interrupted", place=session.path, fix=Action.RECOVER(session.path))
    session.stream(stream)
    session.datasets(stream)
    is_live = session.group(stream).file.swmr_mode  # HDF5 opens a file in one way only
    options: dict[str, Any] = {"driver_kwds": {"swmr": True}} if is_live else {}
    stored_now = xr.open_dataset(session.path, group=stream, engine="h5netcdf", **options)
    dataset = stored_now.isel(time=slice(session.count(stream)))
    stored = dataset["flags"].variable
    verified = verified_flags(session.path, stream, stored.shape)
    time = dataset["time"].variable.copy(data=session.times_ns(stream).view("datetime64[ns]"))
    read = {"flags": xr.Variable(stored.dims, verified, stored.attrs, stored.encoding)}
    if not session.streams[stream].is_camera:
        values = session.readings(stream).values[: stored.shape[0]]
        read["value"] = dataset["value"].variable.copy(data=values.reshape(dataset["value"].shape))
    return _with_quantity_name(dataset.assign_coords(time=time).assign(read), session.streams[stream])


def _with_quantity_name(dataset: xr.Dataset, info: StreamInfo) -> xr.Dataset:
    """The dataset with its values called as their quantity, if they are of that."""
    name = "counts" if info.is_camera else "value"
    if info.is_camera and dataset[name].attrs.get("units") != "K":
        return dataset
    return dataset.rename({name: info.quantity}).assign_attrs(signal=info.quantity)
