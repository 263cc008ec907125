"""Single frames (16-bit TIFF, InfiRay IRG), of a folder or one alone, stamped in a table or in their names.

What a count means is never guessed: it stands in the file, or must be given, or declared unknown.
"""

from __future__ import annotations

import csv
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import tzinfo
from functools import reduce
from operator import or_
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Frame, Quality, Severity
from fieldkit.sessions.formats.imported import ImportedRecording, flag_bunched, parse_times_ns, usual_rate_hz
from fieldkit.sessions.formats.tiff import claimed_pixels, read_tags

SUFFIXES = (".tif", ".tiff", ".irg")

_MOST_PIXELS = 1 << 24

_OR_NONE = "or --kelvin-per-count none for frames only"

_SAY_SCALE = {
    "TIFF": f"--kelvin-per-count 0.01 (the maker's number), {_OR_NONE}",
    "IRG": f"--kelvin-per-count 0.0625 (InfiRay C200) or 0.1 (others), {_OR_NONE}",
}


@dataclass(frozen=True, slots=True)
class Scale:
    """Kelvin = counts * `kelvin_per_count` + `kelvin_at_zero`; NaN where the temperature is not known."""

    kelvin_per_count: float
    kelvin_at_zero: float = 0.0


def image_files(source: Path) -> list[Path]:
    """The frames of a folder, by name; or the one."""
    if not source.is_dir():
        return [source]
    return sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)


def read_stills(
    source: Path, scale: Scale | None, *, times: Path | None = None, time_format: str | None = None,
    zone: tzinfo | None = None, name: str = "camera",
) -> ImportedRecording:  # fmt: skip
    """Read the frames of a folder, or a single one, as a camera stream in order of time.

    Parameters
    ----------
    source : Path
        A folder or file: 16-bit TIFF or InfiRay IRG.
    scale : Scale or None
        What a count means; None uses the scale in the files.
    times : Path, optional
        Table of file name and time, with a header line or without.
    time_format : str, optional
        Format of the times in the file names without their ending, as for strptime. Without it and `times`
        the tags of frames that fieldkit exported are used.
    zone : tzinfo, optional
        Zone of times without an offset.
    name : str
        Name of the stream.

    Returns
    -------
    ImportedRecording
        One camera stream; frames are read when they are needed.

    Raises
    ------
    ConfigError
        Scale or times are unknown, or a file cannot be read.
    """
    paths = image_files(source)
    if not paths:
        raise ConfigError(
            f"{source} has no frames with temperatures",
            fix="name the folder that has the .tif, .tiff or .irg files, or FLIR's .jpg, .fff or .seq",
        )
    first, own, notes = _first(paths)
    if scale is None and own is None:
        raise ConfigError(
            f"what one count of these {_kind(paths[0])} frames means is not known",
            fix=_SAY_SCALE[_kind(paths[0])],
        )
    stamps = _stamps(paths, times, time_format, zone)
    ordered = sorted(paths, key=stamps.__getitem__)
    time_ns = [stamps[path] for path in ordered]
    known = scale or own or Scale(float("nan"))
    info = StreamInfo(
        name, "brightness_temperature", "K", (first.shape[0], first.shape[1]), known.kelvin_per_count,
        known.kelvin_at_zero, rate_hz=usual_rate_hz(time_ns), driver="import",
    )  # fmt: skip
    flagged, bunches = flag_bunched(lambda: _frames(ordered, time_ns, info), time_ns)
    return ImportedRecording((info,), flagged, (*notes, *bunches))


def _stamps(
    paths: Sequence[Path], times: Path | None, time_format: str | None, zone: tzinfo | None
) -> dict[Path, int]:
    """When each frame was taken, by the one way that was given, else by its own tags."""
    if times is not None and time_format is None:
        return _from_table(paths, times, zone)
    if time_format is not None and times is None:
        return _from_names(paths, time_format, zone)
    tags = {path: read_tags(path) for path in paths} if times is None else {}
    tagged = {path: one.time for path, one in tags.items() if one is not None}
    found = dict(zip(tagged, parse_times_ns(list(tagged.values()), zone), strict=True))
    if len(found) < len(paths):
        raise ConfigError(
            "give the times of the frames in one way only",
            fix='--times stamps.csv (file name, time), or --time-format "%Y%m%dT%H%M%S" (in the names)',
        )
    return found


def _first(
    paths: Sequence[Path],
) -> tuple[NDArray[np.uint16], Scale | None, tuple[tuple[Severity, str], ...]]:
    """A frame, the scale in its file, and notes."""
    if len({_kind(path) for path in paths}) > 1:
        raise ConfigError(
            f"{paths[0].parent} has TIFF and IRG frames", fix="import them from folders of their own"
        )
    if _kind(paths[0]) == "TIFF":
        return _tiff(paths[0]), _own_scale(paths), ()
    frame = read_irg(paths[0])
    own = None if math.isnan(frame.kelvin_per_count) else Scale(frame.kelvin_per_count)
    note = f"the camera's emissivity was {frame.emissivity:g}; whether the counts allow for it is not known"
    return frame.counts, own, ((Severity.WARNING, note),)


def _own_scale(paths: Sequence[Path]) -> Scale | None:
    """The scale in the tags of all frames, where they agree; None of other programs'."""
    tags = [read_tags(path) for path in paths]
    scales = {None if one is None else repr((one.scale, one.offset)) for one in tags}
    first = tags[0]
    return Scale(first.scale, first.offset) if first is not None and len(scales) == 1 else None


def _kind(path: Path) -> str:
    return "IRG" if path.suffix.lower() == ".irg" else "TIFF"


def _frames(paths: Sequence[Path], time_ns: Sequence[int], info: StreamInfo) -> Iterator[Frame]:
    """The frames, read when they are asked for."""
    empty = np.empty((0, 0), np.uint16)
    for number, (path, stamp) in enumerate(zip(paths, time_ns, strict=True)):
        counts = _frame(path)
        if counts.shape != info.shape:
            raise ConfigError(
                f"{path} has {counts.shape} pixels, the first frame {info.shape}",
                fix="import frames of different sizes from folders of their own",
            )
        yield Frame(info.name, stamp, stamp, counts, empty, _quality(path), device_seq=number)


def _quality(path: Path) -> Quality:
    """The flags that an exported frame carries."""
    tags = read_tags(path) if _kind(path) == "TIFF" else None
    known = (
        [Quality[name.upper()] for name in tags.flags if name.upper() in Quality.__members__] if tags else []
    )
    return reduce(or_, known, Quality.GOOD)


def _frame(path: Path) -> NDArray[np.uint16]:
    return _tiff(path) if _kind(path) == "TIFF" else read_irg(path).counts


def _tiff(path: Path) -> NDArray[np.uint16]:
    import cv2

    if claimed_pixels(path) > _MOST_PIXELS:
        raise ConfigError(
            f"{path} claims more than {_MOST_PIXELS // 10**6} million pixels", fix="export it again"
        )
    try:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # unknown tags are harmless
        found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # larger than OpenCV allows
        found = None
    if found is None:
        raise ConfigError(
            f"{path} cannot be read as a frame", fix="export it again, or take it out of the folder"
        )
    if found.dtype != np.uint16 or found.ndim != 2:
        raise ConfigError(
            f"{path} has {found.dtype} values of shape {found.shape}, not one 16-bit number per pixel",
            fix="export the radiometric frames, not the coloured ones",
        )
    return found.astype(np.uint16)


def _from_table(paths: Sequence[Path], times: Path, zone: tzinfo | None) -> dict[Path, int]:
    try:
        lines = times.read_text(encoding="utf-8-sig").splitlines()
        cells = csv.reader(lines, delimiter=_delimiter(lines))
        rows = {row[0].strip(): row[1].strip() for row in cells if len(row) >= 2}
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot read {times}: {error}", fix="save it as CSV, UTF-8") from error
    missing = [path.name for path in paths if path.name not in rows]
    if missing:
        raise ConfigError(
            f"{times} has no time for {len(missing)} frames, the first {missing[0]}",
            fix="add a line for each, or take them out of the folder",
        )
    wanted = {path.name: path for path in paths}
    named = [name for name in rows if name in wanted]  # in the order of the table
    times_ns = parse_times_ns([rows[name] for name in named], zone)
    return {wanted[name]: time_ns for name, time_ns in zip(named, times_ns, strict=True)}


def _delimiter(lines: Sequence[str]) -> str:
    """What parts the columns: semicolons or tabs where the first line has them, else commas."""
    return next((mark for mark in ";\t" if lines and mark in lines[0]), ",")


def _from_names(paths: Sequence[Path], time_format: str, zone: tzinfo | None) -> dict[Path, int]:
    times_ns = parse_times_ns([path.stem for path in paths], zone, time_format)
    return dict(zip(paths, times_ns, strict=True))


# --- frames ``.irg`` of InfiRay's hand-held cameras and their brandings


#


# A little-endian header that holds its own length and ends in ``ac ca``; the image, a byte a pixel; the same


# frame as 16-bit temperatures; then what the model adds. Three public readers agree on that
# (jaseg/infiray_irg,


# jelle737/Vevor-Thermal-Utilities, povlhp/irgdump). On what a count means they agree for headers that begin


# ``ba ab`` or ``b0 0b``: a tenth of a kelvin. Those that begin ``ca ac`` hold sixteenths or tenths, by the
# model,


# which the file does not name.

_KELVIN_PER_COUNT = {b"\xba\xab": 0.1, b"\xb0\x0b": 0.1, b"\xca\xac": float("nan")}

_END_MARK = b"\xac\xca"

_HEAD = struct.Struct("<2sHIHH")

_EMISSIVITY_AT, _SHORTEST_HEADER = 0x1E, 0x22

_MOST_IRG_PIXELS = 1 << 22


@dataclass(frozen=True, slots=True)
class IrgFrame:
    """Counts (rows, cols), kelvin per count (NaN where the file lacks it), the camera's emissivity."""

    counts: NDArray[np.uint16]
    kelvin_per_count: float
    emissivity: float


def read_irg(path: Path) -> IrgFrame:
    """One frame; raises `ConfigError` where the file is none, or is cut short."""
    try:
        with path.open("rb") as file:
            data = file.read(0x10000 + 3 * _MOST_IRG_PIXELS)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}", fix="check the path") from error
    if len(data) < _HEAD.size or data[:2] not in _KELVIN_PER_COUNT:
        raise _refusal(path, "it does not begin as one")
    magic, length, preview, rows, cols = _HEAD.unpack_from(data)
    if length < _SHORTEST_HEADER or data[length - 2 : length] != _END_MARK:
        raise _refusal(path, "its header does not end as one")
    if not 0 < rows * cols == preview <= _MOST_IRG_PIXELS or len(data) < length + 3 * preview:
        raise _refusal(path, f"{rows} x {cols} pixels are not in it")
    counts = np.frombuffer(data, "<u2", rows * cols, length + preview).reshape(rows, cols)
    (emissivity,) = struct.unpack_from("<I", data, _EMISSIVITY_AT)
    return IrgFrame(counts.astype(np.uint16), _KELVIN_PER_COUNT[magic], emissivity / 1e4)


def _refusal(path: Path, why: str) -> ConfigError:
    return ConfigError(
        f"{path} is not a known .irg frame: {why}",
        fix="export it from the camera's program as 16-bit TIFF, and import that",
    )
