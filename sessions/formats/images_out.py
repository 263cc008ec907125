"""The frames of a session: as radiometric TIFF, or to look at as PNG and video with scale and regions."""

from __future__ import annotations

import csv
import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import repeat
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np

from fieldkit.disk import replacing
from fieldkit.model.arrays import ByteArray, CountArray, SingleArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import Frame, Quality
from fieldkit.model.site import Region, known_zone
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.model.version import __version__
from fieldkit.palettes import INFERNO, NAMES, Colours, bgr
from fieldkit.physics.camera_laws import frame_k, has_temperatures
from fieldkit.pixel_axes import label, outline, with_axes
from fieldkit.sessions.analysis import camera_of
from fieldkit.sessions.file_tree import iso_utc
from fieldkit.sessions.formats.tiff import TiffTags, write_tiff
from fieldkit.sessions.reader import SessionReader

TIFF_KELVIN_PER_COUNT = 0.01
_MOST_COUNTS = 65_535
_WIDTH, _BAR = 640, 36
_ROOM = "make room, or name another folder"
_TABLES = Action.EXPORT(to="csv") + " for what it has"
_FRAMES_PER_S = 25.0
log: logging.Logger = logging.getLogger(__name__)


class Chosen(TypedDict, total=False):
    """Which frames: every n-th, between two times (UTC nanoseconds); `on_frame` is called at each of all."""

    every: int
    between_ns: tuple[float, float]
    on_frame: Callable[[], None]


class Drawn(Chosen, total=False):
    """Which frames, in the colours of which palette."""

    palette: str


def export_tiffs(
    session: SessionReader, folder: Path, *, stream: str | None = None, **chosen: Unpack[Chosen]
) -> list[Path]:
    """16-bit TIFFs of 0.01 K per count with scale, time and flags in their tags: `import` reads them back.

    The times stand in ``times.csv`` too. Where a pixel is hotter than 655.35 K, a count is 0.02 K, 0.04 K or
    what else holds it, in all frames. A pixel of 0 has no temperature; counts of a camera without a known
    scale are written as they are. Raises `OSError`, and `SessionError` where the camera is not known.
    """
    info = camera_of(session, stream)
    unseen: Chosen = {**chosen, "on_frame": lambda: None}  # of two passes the second is counted
    step, times = _kelvin_per_count(session, info, **unseen), dict[Path, str]()
    for frame in _frames(session, info.name, **chosen):
        path = folder / f"{_stem(session, info)}-{frame.seq:07}.tiff"
        times[path] = iso_utc(frame.time_ns)
        flags = tuple(str(flag.name).lower() for flag in frame.quality)
        counts = _tiff_counts(frame, info, step)
        with replacing(path, synced=False) as draft:
            write_tiff(draft, counts, TiffTags(times[path], step, flags=flags), f"fieldkit {__version__}")
    return [*times, _write_times(folder / "times.csv", times)]


def _kelvin_per_count(session: SessionReader, info: StreamInfo, **chosen: Unpack[Chosen]) -> float:
    """The step by which 16 bits hold every temperature: 0.01 K or its doubles; NaN where there are none."""
    if not has_temperatures(info):
        return math.nan
    hottest = max((_hottest_k(frame, info) for frame in _frames(session, info.name, **chosen)), default=0.0)
    doublings = math.ceil(math.log2(max(1.0, hottest / (_MOST_COUNTS * TIFF_KELVIN_PER_COUNT))))
    step = float(TIFF_KELVIN_PER_COUNT * 2**doublings)
    if doublings:
        log.warning("a pixel has %.1f K, so a count of the TIFFs is %g K, not 0.01 K", hottest, step)
    return step


def _hottest_k(frame: Frame, info: StreamInfo) -> float:
    kelvin = frame_k(info, frame.counts, frame.metadata_rows)
    return float(np.max(kelvin, where=np.isfinite(kelvin), initial=0.0))


def _tiff_counts(frame: Frame, info: StreamInfo, step: float) -> CountArray:
    if not has_temperatures(info):
        return frame.counts
    counts = np.rint(frame_k(info, frame.counts, frame.metadata_rows) / step)
    return np.asarray(np.maximum(np.nan_to_num(counts, posinf=0.0, neginf=0.0), 0.0), np.uint16)


def export_frame_tables(
    session: SessionReader, folder: Path, *, stream: str | None = None, **chosen: Unpack[Chosen]
) -> list[Path]:
    """A table of each frame, a row of pixels a line: °C, or counts without a known scale; NaN without one.

    The times stand in ``times.csv``. Raises `OSError`, and `SessionError` where the camera is not known.
    """
    info, times = camera_of(session, stream), dict[Path, str]()
    for frame in _frames(session, info.name, **chosen):
        path = folder / f"{_stem(session, info)}-{frame.seq:07}.csv"
        times[path] = iso_utc(frame.time_ns)
        with replacing(path, synced=False) as draft:
            np.savetxt(draft, _values(frame, info), "%.2f" if has_temperatures(info) else "%d", ",")
    return [*times, _write_times(folder / "times.csv", times)]


def export_pngs(
    session: SessionReader, folder: Path, *, stream: str | None = None, **drawn: Unpack[Drawn]
) -> list[Path]:
    """Coloured images with temperature scale, regions, their slopes as recorded, and time.

    Raises `StorageError`.
    """
    import cv2

    paths = []
    info = camera_of(session, stream)
    for frame, image in _images(session, info, **drawn):
        path = folder / f"{_stem(session, info)}-{frame.seq:07}.png"
        if not cv2.imwrite(str(path), image):
            raise StorageError("cannot write", place=path, fix=_ROOM)
        paths.append(path)
    return paths


def export_video(
    session: SessionReader,
    folder: Path,
    *,
    stream: str | None = None,
    speed: float = math.inf,
    **drawn: Unpack[Drawn],
) -> list[Path]:
    """The same as a video, 25 pictures a second, VP9 in MP4, which browsers play. Raises `StorageError`.

    `speed` are seconds of the session per second of the video; infinite: each frame is one picture.
    """
    import cv2

    info = camera_of(session, stream)
    path, film, count = folder / f"{_stem(session, info)}.mp4", None, 0
    for image in _at_speed(_images(session, info, **drawn), speed):
        if film is None:
            code = cv2.VideoWriter.fourcc(*"vp09")
            film = cv2.VideoWriter(str(path), code, _FRAMES_PER_S, (image.shape[1], image.shape[0]))
            if not film.isOpened():
                fix = Action.EXPORT(to="png") + ", then make a film"
                raise StorageError("cannot write", place=path, fix=fix)
        film.write(image)
        count += 1
    if film is None:
        raise ConfigError("no frames", place=session.path, fix=_TABLES)
    film.release()
    if cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) < count:  # OpenCV reports no full disk
        path.unlink()
        raise StorageError("cannot write", place=path, fix=_ROOM)
    return [path]


def _at_speed(drawn: Iterable[tuple[Frame, ByteArray]], speed: float) -> Iterator[ByteArray]:
    """The pictures of a video: each frame until the next one was taken, or once where `speed` is infinite."""
    first_ns, pictures, before = 0, 0, None
    for frame, image in drawn:
        first_ns = first_ns or frame.time_ns
        due = pictures + 1
        if math.isfinite(speed):
            due = round((frame.time_ns - first_ns) / SECOND_NS / speed * _FRAMES_PER_S)
        if before is not None:
            yield from repeat(before, due - pictures)
            pictures = max(pictures, due)
        before = image
    if before is not None:
        yield before


def _stem(session: SessionReader, info: StreamInfo) -> str:
    """Beginning of the names of the files: the camera is in it where the session has several."""
    several = sum(other.is_camera for other in session.streams.values()) > 1
    return f"{session.path.stem}-{info.name}" if several else session.path.stem


def _write_times(table: Path, added: Mapping[Path, str]) -> Path:
    """The times of these frames, beside those that other exports wrote into the same folder."""
    times: dict[str, str] = {}
    if table.exists():
        with table.open(newline="", encoding="utf-8") as file:
            times = {row[0]: row[1] for row in csv.reader(file) if len(row) == 2}
    times = {"file": "time", **times, **{path.name: time for path, time in added.items()}}
    with replacing(table, synced=False) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(times.items())
    return table


def _frames(
    session: SessionReader,
    camera: str,
    *,
    every: int = 1,
    between_ns: tuple[float, float] = (-math.inf, math.inf),
    on_frame: Callable[[], None] = lambda: None,
) -> Iterator[Frame]:
    """The frames to be written; damaged ones are not among them, as an image shows no flags."""
    begin_ns, end_ns = between_ns
    for sample in session.samples(camera):
        on_frame()
        is_chosen = sample.seq % every == 0 and begin_ns <= sample.time_ns <= end_ns
        if isinstance(sample, Frame) and is_chosen and Quality.BAD_CRC not in sample.quality:
            yield sample


def require_palette(name: str) -> None:
    """Raise `ConfigError` for a palette that does not exist."""
    if name not in NAMES:
        raise ConfigError(
            "no such palette", place=Argument("palette", name), fix=f"choose one of {', '.join(NAMES)}"
        )


def _images(
    session: SessionReader, info: StreamInfo, palette: str = INFERNO, **chosen: Unpack[Chosen]
) -> Iterator[tuple[Frame, ByteArray]]:
    require_palette(palette)
    colours = bgr(palette)
    low, high = _range(session, info)
    words = [f"{end:.1f} C" if has_temperatures(info) else f"{end:.0f}" for end in (low, high)]
    slopes = deque(session.estimates())
    names = {region.name: region.name for region in session.regions}
    zone = known_zone(session.site.timezone) or UTC
    for frame in _frames(session, info.name, **chosen):
        while slopes and slopes[0].time_ns <= frame.time_ns:
            estimate = slopes.popleft()
            names[estimate.region] = _with_slope(estimate)
        grey = np.clip(np.nan_to_num((_values(frame, info) - low) / (high - low)) * 255, 0, 255)
        image = _draw(colours, grey.astype(np.uint8), session.regions, names)
        moment = datetime.fromtimestamp(frame.time_ns / SECOND_NS, zone).strftime("%Y-%m-%d %H:%M:%S %Z")
        bar = _bar(image.shape[1], words, moment, colours)
        yield frame, np.vstack([image, bar])


def _with_slope(estimate: SlopeEstimate) -> str:
    """A region's name with its tilt, where it has one; OpenCV's letters have no degree sign."""
    tilt = f" {estimate.tilt_deg:.0f} deg" if math.isfinite(estimate.tilt_deg) else ""
    return f"{estimate.region}{tilt}"


def _values(frame: Frame, info: StreamInfo) -> SingleArray:
    """Values that an image shows, (rows, cols): °C, or counts where the camera's scale is not known."""
    if not has_temperatures(info):
        return frame.counts.astype(np.float32)
    return frame_k(info, frame.counts, frame.metadata_rows, np.float32) - np.float32(CELSIUS_ZERO_K)


def _range(session: SessionReader, info: StreamInfo) -> tuple[float, float]:
    """One colour scale for the whole session: it holds the middle 98 % of each of about fifty frames.

    Of each, not of all together: a region that is warm for an hour only must not lie beyond the end.
    """
    reader, length = session.stream(info.name), session.count(info.name)
    frames = (reader.frame(row) for row in range(0, length, max(1, length // 50)))
    images = [_values(frame, info) for frame in frames if Quality.BAD_CRC not in frame.quality]
    ends = np.array([np.nanpercentile(values, (1, 99)) for values in images if np.isfinite(values).any()])
    if not len(ends):
        raise ConfigError("no frames", place=session.path, fix=_TABLES)
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    return low, max(high, low + (0.01 if has_temperatures(info) else 1))


def _draw(
    colours: Colours, grey: ByteArray, regions: Iterable[Region], names: Mapping[str, str]
) -> ByteArray:
    """The enlarged image with its regions and their names, and axes in pixels."""
    import cv2

    factor = max(1, round(_WIDTH / grey.shape[1]))
    large = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    image: ByteArray = colours[large]
    for region in regions:
        corners = np.trunc((np.array(region.points_px) + 0.5) * factor)
        outline(image, corners, thickness=1)
        x, y = corners[0].astype(int).tolist()
        label(image, names[region.name], x + 5, y + 17, 0.45, margin=2)
    return with_axes(image, factor)


def _bar(width: int, words: list[str], moment: str, colours: Colours) -> ByteArray:
    """The colour scale with its ends, and the time."""
    ramp = np.tile(np.linspace(0, 255, width).astype(np.uint8), (_BAR // 3, 1))
    black = np.zeros((_BAR - _BAR // 3, width, 3), np.uint8)
    bar: ByteArray = np.vstack([colours[ramp], black])
    label(bar, words[0], 4, _BAR - 8, 0.45, margin=2)
    label(bar, moment, width // 2 - 80, _BAR - 8, 0.45, margin=2)
    label(bar, words[1], width - 80, _BAR - 8, 0.45, margin=2)
    return bar
