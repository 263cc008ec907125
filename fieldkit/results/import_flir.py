"""FLIR files (FFF, SEQ, radiometric JPEG), one or a folder of them, as an imported recording.

The driver's decoder reads them. A folder is what a hand-held camera leaves on its card: a JPEG per frame,
and beside them those of its ordinary camera, which hold no temperatures.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import tzinfo
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from fieldkit.drivers.cameras import flir_file
from fieldkit.drivers.cameras.flir_file import FlirFrame
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, DecodeError
from fieldkit.model.next_step import Text
from fieldkit.model.samples import Frame, Severity
from fieldkit.sessions.formats import imported
from fieldkit.sessions.formats.imported import ImportedRecording, ReadAgain, flag_bunched
from fieldkit.sessions.formats.times import GIVE_TIMES, given_times_ns, plausible_ns

SUFFIXES = (".fff", ".seq", ".csq", ".jpg", ".jpeg")
_COPY = "copy it from the camera again; a truncated file cannot be read"


@dataclass(frozen=True, slots=True)
class _File:
    """A file: times of the frames that can be read, 0 of those without, and what is damaged after them."""

    path: Path
    time_ns: list[int]
    damage: str


def _frames(files: Sequence[_File], name: str) -> Iterator[Frame]:
    """The frames of files, never all in memory."""
    rows, number = np.empty((0, 0), np.uint16), count()
    for file in files:
        for stamp, stored in zip(file.time_ns, _stored_frames(file.path), strict=False):
            yield Frame(name, stamp, stamp, stored.counts, rows, device_seq=next(number))


def files_in(source: Path) -> list[Path]:
    """The FLIR files of a folder, by name; or the file itself."""
    if not source.is_dir():
        return [source]
    return sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)


def read_flir(
    source: Path, name: str = "camera", *, times: Path | None = None, time_format: str | None = None,
    zone: tzinfo | None = None, offset_ns: int = 0,
) -> ImportedRecording:  # fmt: skip
    """Read a file, or a folder of them, as a camera stream in order of time; counts and constants as stored.

    Each file is read twice, first for its times, and up to its first damaged frame. `times`, `time_format`
    and `zone` give the times of the frames as `given_times_ns` reads them, by default they are those of the
    camera's clock; `offset_ns` is added to them. Raises `ConfigError` if there is no complete frame, a frame
    has no time, or size or constants change.
    """
    first, files, skipped = _scan(source)
    counts = {file.path: len(file.time_ns) for file in files}
    name_times_ns = given_times_ns(counts, times, time_format, zone)
    files = _with_times(files, name_times_ns, offset_ns)
    time_ns = [stamp for file in files for stamp in file.time_ns]
    read = partial(_frames, files, name)
    samples: Iterable[Frame] = ReadAgain(read)
    rate_hz, notes = imported.usual_rate_hz(time_ns), skipped
    if not source.is_dir():  # in a folder each frame was taken by hand, at no rate
        samples, notes = flag_bunched(read, time_ns)
        rate_hz = first.rate_hz
    damages = tuple((Severity.WARNING, file.damage) for file in files if file.damage)
    info = StreamInfo(
        name, "brightness_temperature", "K", (first.counts.shape[0], first.counts.shape[1]), float("nan"),
        law="planck", rate_hz=rate_hz, driver="import", vendor="FLIR", model=first.model,
        serial_number=first.serial_number, settings=flir_file.settings(first),
    )  # fmt: skip
    clock = "as given" if name_times_ns else "by the camera's own clock"
    note = f"times are {clock}; the emissivity set in the camera was not applied"
    return ImportedRecording((info,), samples, ((Severity.INFO, note), *damages, *notes))


def _with_times(files: list[_File], times_ns: Mapping[Path, list[int]] | None, offset_ns: int) -> list[_File]:
    """The files with the times of their frames, in order of time."""
    stamped = []
    for file in files:
        time_ns = times_ns[file.path] if times_ns else file.time_ns
        if 0 in time_ns:
            raise ConfigError(f"frame {time_ns.index(0)} has no time", place=file.path, fix=GIVE_TIMES)
        shifted_ns = [plausible_ns(stamp + offset_ns) for stamp in time_ns]
        stamped.append(replace(file, time_ns=shifted_ns))
    return sorted(stamped, key=lambda file: file.time_ns[0])


def _scan(source: Path) -> tuple[FlirFrame, list[_File], tuple[tuple[Severity, str], ...]]:
    """The first frame, which all must be like; the files; a note on those skipped."""
    first, files, others = None, [], list[str]()
    fix: Text = _COPY
    for path in files_in(source):
        try:
            frame, file = _scanned_file(path, first)
        except DecodeError as error:
            fix = fix if others else error.fix or _COPY
            others.append(f"{path.name} ({error.message})")
        else:
            first = first or frame
            files.append(file)
    if first is None:
        problem = f"no frame with temperatures: {others[0] if others else 'it is empty'}"
        raise ConfigError(problem, place=source, fix=fix)
    if not others:
        return first, files, ()
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return first, files, ((Severity.WARNING, f"skipped, without temperatures: {others[0]}{more}"),)


def _scanned_file(path: Path, first: FlirFrame | None) -> tuple[FlirFrame, _File]:
    """The first frame of a file, and what can be read of it; raises `DecodeError` if nothing can."""
    frame, time_ns, damage = None, [], ""
    try:
        for number, stored in enumerate(_stored_frames(path)):
            frame = frame or stored
            alike = first or frame
            if stored.counts.shape != alike.counts.shape or stored.constants != alike.constants:
                problem = f"frame {number} has another size or other constants than the first"
                raise ConfigError(problem, place=path, fix="import the parts one by one")
            time_ns.append(stored.time_ns)
    except DecodeError as error:
        if frame is None:
            raise
        damage = f"{error.message}: nothing after frame {len(time_ns)} of {path.name} could be read"
    if frame is None:
        raise DecodeError("the file is empty", fix=_COPY)
    return frame, _File(path, time_ns, damage)


def _stored_frames(path: Path) -> Iterator[FlirFrame]:
    """The frames of a file; raises `DecodeError` at the first that is damaged."""
    with imported.explained(path, "cannot be read", _COPY, OSError):
        if path.stat().st_size == 0:  # an empty file cannot be mapped
            return
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from flir_file.frames(data)
