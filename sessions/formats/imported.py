"""Writing what was recorded elsewhere as a session; an event says where it came from.

Imported recordings have no monotonic clock, so their UTC stands for it. Stamps are kept as
they came: frames that waited somewhere and arrived in bunches are flagged, not moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from fieldkit.model.arrays import BoolArray, IntArray
from fieldkit.model.channels import with_components
from fieldkit.model.clock import ClockCheck, HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.installation import install_extra
from fieldkit.model.limits import bounds_of, excesses, flag_implausible, labels_of
from fieldkit.model.next_step import Text
from fieldkit.model.quantities import Quantity
from fieldkit.model.samples import NO_COUNTER, Event, EventKind, Frame, Quality, Reading, Sample, Severity
from fieldkit.model.site import Site
from fieldkit.physics.camera_laws import frame_k
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.records import Entry
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.writer import SessionWriter

T = TypeVar("T")


class MissingOptionsError(ConfigError):
    """A source leaves open what its options must give."""


class UnstatedZoneError(MissingOptionsError):
    """Among it is the zone, of which a table says nothing: it may be that of the campaign."""


def together(*errors: ConfigError) -> ConfigError:
    """All that is missing as one error; another error goes before it."""
    missing = [error for error in errors if isinstance(error, MissingOptionsError)]
    if len(errors) == 1 or len(missing) < len(errors):
        return next((error for error in errors if error not in missing), errors[0])
    is_unstated = any(isinstance(error, UnstatedZoneError) for error in errors)
    problem, fix = errors[0].problem, errors[0].fix or ""
    for error in errors[1:]:
        problem, fix = problem + "; " + error.explanation, fix + "; " + (error.fix or "")
    kind = UnstatedZoneError if is_unstated else MissingOptionsError
    return kind(problem, place=errors[0].place, fix=fix)


@dataclass(frozen=True, slots=True)
class ImportedRecording:
    """A recording of another program: its streams, its samples in order of time, notes on it.

    `site` is where it was made, if the recording has it.
    """

    streams: tuple[StreamInfo, ...]
    samples: Iterable[Sample]
    notes: tuple[tuple[Severity, str], ...] = ()
    site: Site | None = None

    def noted(self, text: str, severity: Severity = Severity.WARNING) -> ImportedRecording:
        """The recording with one more note."""
        return replace(self, notes=(*self.notes, (severity, text)))


def imported_reading(stream: str, time_ns: int, values: tuple[float, ...], **more: Any) -> Reading:
    """A reading of a table or file, by which every importer makes its readings.

    Its `device_seq` is the line in the source, the first being 1.
    """
    return Reading(stream, time_ns, time_ns, values, **more)


def free_name(name: str, names: Collection[str], numbered: str) -> str:
    """The name, or, where others have it, the first free one of those with a number: ``"{}-{}"``."""
    numbers = (numbered.format(name, number) for number in range(2, len(names) + 2))
    return next(free for free in (name, *numbers) if free not in names)


def station_stream(
    name: str, quantity: Quantity, rate_hz: float, labels: Sequence[str] = (), **about: Any
) -> StreamInfo:
    """The stream of a weather station for a quantity, with a channel for each label."""
    info = StreamInfo(
        f"{name}-{quantity.of_station}", quantity.stream or quantity.name, quantity.units.stored,
        (max(1, len(labels)),), channels=tuple(labels), rate_hz=rate_hz, driver="import", **about,
    )  # fmt: skip
    return with_components(info, {info.name: quantity.name})


def possible(
    imported: ImportedRecording, limits: Mapping[str, tuple[float, float]], site: Site
) -> ImportedRecording:
    """The recording with its implausible readings flagged (`fieldkit.model.limits`), a note on each channel.

    `limits` are rows that differ from the table. Frames are as they were, with a note where the first of them
    cannot be: its scale or unit is another.
    """
    streams = tuple(replace(info, limits=limits) for info in imported.streams)
    if any(info.is_camera for info in imported.streams):
        about = tuple(_on_first_frame(next(iter(imported.samples), None), streams[0]))
        return replace(imported, notes=(*imported.notes, *about))
    all_bounds = {info.name: bounds_of(info) for info in streams}
    # whatever the sun's height: times may be corrected
    samples = [flag_implausible(sample, all_bounds[sample.stream]) for sample in imported.samples]
    notes = list(imported.notes)
    for info in streams:
        readings = [
            sample for sample in samples if isinstance(sample, Reading) and sample.stream == info.name
        ]
        values = np.array([reading.values for reading in readings], np.float64).reshape(-1, *info.shape)
        sine = sun_vectors([reading.time_ns for reading in readings], site).reshape(-1, 3)[:, 2]
        bounds = all_bounds[info.name]
        beyond = excesses(labels_of(info), bounds, values, bounds.is_exceeded(values, sine))
        words = (excess.words(_place(readings[excess.first])) for excess in beyond)
        notes += [(Severity.WARNING, f"{text}; stored, not used") for text in words]
    return replace(imported, streams=streams, samples=samples, notes=tuple(notes))


def _on_first_frame(frame: Sample | None, info: StreamInfo) -> Iterator[tuple[Severity, str]]:
    if not isinstance(frame, Frame):
        return
    # NaN, and so possible, where counts alone do not give kelvin
    kelvin = frame_k(info, frame.counts, frame.metadata_rows)
    median_k = float(np.median(kelvin[np.isfinite(kelvin)])) if np.isfinite(kelvin).any() else math.nan
    bounds = bounds_of(info)
    if bounds.is_exceeded(np.array([median_k])).any():
        possible_k = f"possible: {bounds.low[0]:.4g} to {bounds.high[0]:.4g}"
        text = f"{info.name}: the median of the first frame is {median_k:.6g} K; {possible_k}"
        yield Severity.WARNING, f"{text}; are its unit and scale right? stored, not used"


def _place(reading: Reading) -> str:
    time = np.datetime64(reading.time_ns // 1_000_000_000, "s")
    return f"{time}Z" if reading.device_seq == NO_COUNTER else f"{time}Z (line {reading.device_seq})"


class StampedClock(HostClock):
    """A clock that stands where the imported stamps are; `anchor_ns` is UTC less its monotonic time.

    Nothing waits for it: the thread of the session file reads back from the journal what it missed.
    """

    is_real = False

    def __init__(self, start_ns: int, anchor_ns: int = 0) -> None:
        self.now_ns = start_ns
        self.anchor: ClockCheck = ClockCheck(start_ns, anchor_ns, 0, "imported")

    def mono_ns(self) -> int:
        """The last stamp."""
        return self.now_ns


def write_imported(path: Path, header: SessionHeader, imported: ImportedRecording, source: str) -> SealReport:
    """Write an imported recording as a session and seal it; `source` names the files it came from.

    Raises `ConfigError` where it has no samples, `StorageError`, `RefusedError`.
    """
    samples = iter(imported.samples)
    first = next(samples, None)
    if first is None:
        raise ConfigError("no samples", place=source, fix="check that it is the right file, and whole")
    start_ns, notes = first.time_ns, ((Severity.INFO, f"imported from {source}"), *imported.notes)
    events = (Event(EventKind.IMPORTED, start_ns, start_ns, text, "", severity) for severity, text in notes)
    return write_stamped(path, header, StampedClock(start_ns), events, chain([first], samples))


def write_stamped(
    path: Path, head: SessionHeader, clock: StampedClock, entries: Iterable[Entry], samples: Iterable[Sample]
) -> SealReport:
    """Write entries, and samples in order of time, as a session by the clock of their stamps, and seal it."""
    writer = SessionWriter(path, head, clock)
    try:
        for entry in entries:
            writer.put(entry)
        for sample in samples:
            clock.now_ns = max(clock.now_ns, sample.mono_ns)
            writer.append(sample)
    except BaseException:
        writer.discard()
        raise
    return writer.close()


def usual_rate_hz(time_ns: Sequence[int] | IntArray) -> float:
    """Samples a second by the median interval; 0 where there is none."""
    intervals = np.diff(np.asarray(time_ns, np.int64))
    usual = float(np.median(intervals)) if intervals.size else 0.0
    return 1e9 / usual if usual > 0 else 0.0


@dataclass(frozen=True, slots=True)
class ReadAgain(Generic[T]):
    """Samples that are read anew, by `read`, whenever they are asked for: never all are in memory."""

    read: Callable[[], Iterator[T]]

    def __iter__(self) -> Iterator[T]:
        return self.read()


def flag_bunched(
    read: Callable[[], Iterable[Frame]], time_ns: Sequence[int]
) -> tuple[Iterable[Frame], tuple[tuple[Severity, str], ...]]:
    """The frames that `read` gives, never all in memory; those that came in bunches flagged `INTERPOLATED`.

    `time_ns` are their stamps, known from a first pass; also a note on bunches.
    """
    stamps_ns: IntArray = np.array(time_ns, np.int64)
    intervals = np.diff(stamps_ns)
    usual = float(np.median(intervals)) if intervals.size >= 3 else 0.0
    # half the usual interval apart or less: they came together, having waited
    is_close = np.pad(intervals < 0.5 * usual, 1)
    late: BoolArray = is_close[1:] | is_close[:-1]

    def flag() -> Iterator[Frame]:
        for is_late, frame in zip(late, read(), strict=False):  # what came after was excluded
            yield frame._replace(quality=frame.quality | Quality.INTERPOLATED) if is_late else frame

    if not late.any():
        return ReadAgain(flag), ()
    text = f"{int(late.sum())} of {late.size} frames came in bunches: stamps of arrival, flagged interpolated"
    return ReadAgain(flag), ((Severity.WARNING, text),)


@contextmanager
def explained(path: Path, problem: str, fix: Text, *kinds: type[BaseException]) -> Iterator[None]:
    """Errors of these kinds, raised by what reads a file, as a `ConfigError`; those of fieldkit stay."""
    try:
        yield
    except (FieldkitError, KeyboardInterrupt, SystemExit):
        raise
    except ImportError as error:
        raise ConfigError(f"needs {error.name}", place=path, fix=install_extra("files")) from error
    except kinds as error:
        raise ConfigError(f"{problem} ({str(error)[:200]})", place=path, fix=fix) from error


def refuse_large(path: Path, most_bytes: int) -> None:
    """Raise `ConfigError` for a file that is larger than any of its kind, `OSError` where there is none."""
    if path.stat().st_size > most_bytes:
        fix = "split the file into parts"
        raise ConfigError(f"larger than {most_bytes // 10**6} MB", place=path, fix=fix)
