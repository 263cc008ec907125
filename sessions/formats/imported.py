"""Writing what was recorded elsewhere as a session; an event says where it came from.

Imported recordings have no monotonic clock, so their UTC stands for it. Stamps are kept as
they came: frames that waited somewhere and arrived in bunches are flagged, not moved.
"""

from __future__ import annotations

import itertools
import re
import select
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Sample, Severity
from fieldkit.model.site import Site
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.writer import SessionWriter


@dataclass(frozen=True, slots=True)
class ImportedRecording:
    """A recording of another program: its streams, its samples in order of time, notes on it.

    `site` is where it was made, if the recording has it.
    """

    streams: tuple[StreamInfo, ...]
    samples: Iterable[Sample]
    notes: tuple[tuple[Severity, str], ...] = ()
    site: Site | None = None


class StampedClock:
    """A clock that stands where the imported stamps are; `anchor_ns` is UTC less its monotonic time."""

    is_real = False

    def __init__(self, start_ns: int, anchor_ns: int = 0) -> None:
        self.now_ns = start_ns
        self._anchor_ns = anchor_ns

    def mono_ns(self) -> int:
        """The last stamp."""
        return self.now_ns

    def to_utc_ns(self, mono_ns: int) -> int:
        """That plus the anchor."""
        return mono_ns + self._anchor_ns

    def check(self) -> ClockCheck:
        """Nothing to compare."""
        return ClockCheck(self.now_ns, 0, 0, "imported")

    def sleep(self, seconds: float) -> None:
        """Nothing waits for this clock."""

    def wait_readable(self, fd: int, timeout_s: float) -> bool:
        """Whether there is something to read now."""
        return bool(select.select([fd], [], [], 0)[0])

    def taking_part(self) -> AbstractContextManager[None]:
        """Nothing to do."""
        return nullcontext()

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Nothing to do: the writer reads back from the journal what it missed."""


def write_imported(path: Path, header: SessionHeader, imported: ImportedRecording, source: str) -> SealReport:
    """Write an imported recording as a session and seal it; `source` names the files it came from.

    Raises `ConfigError` where it has no samples, `StorageError`, `RefusedError`.
    """
    samples = iter(imported.samples)
    first = next(samples, None)
    if first is None:
        raise ConfigError(f"{source} has no samples", fix="check that it is the right file, and whole")
    clock = StampedClock(first.time_ns)
    writer = SessionWriter(path, header, clock)
    try:
        _add_note(writer, clock, Severity.INFO, f"imported from {source}")
        for severity, text in imported.notes:
            _add_note(writer, clock, severity, text)
        for sample in _chain(first, samples):
            clock.now_ns = max(clock.now_ns, sample.time_ns)
            writer.append(sample)
    except BaseException:
        writer.discard()
        raise
    return writer.close()


def _chain(first: Sample, rest: Iterator[Sample]) -> Iterator[Sample]:
    yield first
    yield from rest


def _add_note(writer: SessionWriter, clock: StampedClock, severity: Severity, text: str) -> None:
    writer.event(Event(EventKind.IMPORTED, clock.now_ns, clock.now_ns, text, "", severity))


def usual_rate_hz(time_ns: Sequence[int] | NDArray[np.int64]) -> float:
    """Samples a second by the median interval; 0 where there is none."""
    intervals = np.diff(np.asarray(time_ns, np.int64))
    usual = float(np.median(intervals)) if intervals.size else 0.0
    return 1e9 / usual if usual > 0 else 0.0


def bunched(time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which frames came together, having waited: half the usual interval apart or less."""
    intervals = np.diff(time_ns)
    late = np.zeros(len(time_ns), np.bool_)
    if intervals.size >= 3:
        close = intervals < 0.5 * np.median(intervals)
        late[1:] |= close
        late[:-1] |= close
    return late


@dataclass(frozen=True, slots=True)
class _Flagged:
    """Frames that are read again whenever they are asked for, the late ones flagged."""

    read: Callable[[], Iterable[Frame]]
    late: NDArray[np.bool_]

    def __iter__(self) -> Iterator[Frame]:
        for is_late, frame in zip(self.late, self.read(), strict=False):  # what came after was excluded
            yield frame._replace(quality=frame.quality | Quality.INTERPOLATED) if is_late else frame


def flag_bunched(
    read: Callable[[], Iterable[Frame]], time_ns: Sequence[int]
) -> tuple[Iterable[Frame], tuple[tuple[Severity, str], ...]]:
    """The frames that `read` gives, never all in memory; those that came in bunches flagged `INTERPOLATED`.

    `time_ns` are their stamps, known from a first pass; also a note on bunches.
    """
    late = bunched(np.array(time_ns, np.int64))
    if not late.any():
        return _Flagged(read, late), ()
    text = f"{int(late.sum())} of {late.size} frames came in bunches: stamps of arrival, flagged interpolated"
    return _Flagged(read, late), ((Severity.WARNING, text),)


# --- times as other programs write them, to UTC nanoseconds; a missing zone is never guessed

_EPOCH = datetime.fromtimestamp(0, UTC)

_COARSE_S = 1800.0
"""Rows so far apart cannot go back within an hour that comes twice."""

_WORDS = {"yyyy": "%Y", "mm": "%m", "dd": "%d", "HH": "%H", "MM": "%M", "SS": "%S"}


def parse_times_ns(texts: Sequence[str], zone: tzinfo | None, time_format: str | None = None) -> list[int]:
    """UTC nanoseconds of the times of a log in the order of its rows.

    They are ISO 8601, Unix seconds, or as `time_format` describes: written for strptime (``%Y-%m-%d``) or in
    plain letters (``yyyy/mm/dd HH:MM:SS``). Of the hour that comes twice at the end of summer time, the rows
    up to where the clock goes back belong to the first.

    Raises `ConfigError` where a text is not such a time, has no offset and no `zone` is given, names an hour
    that was skipped, or one that came twice and the order of the rows leaves open which.
    """
    exact = [None if time_format else _unix_ns(text) for text in texts]
    moments = {
        row: _moment(texts[row], zone, time_format) for row, known in enumerate(exact) if known is None
    }
    for row, moment in moments.items():
        if _hours_back(moment) < 0:
            note = f"{texts[row]!r} does not exist in {moment.tzinfo}: clocks were put forward over it"
            raise ConfigError(note, fix=_fixed_offset(moment))
    for row in _second_times(moments, texts):
        moments[row] = moments[row].replace(fold=1)
    return [utc_ns(moments[row]) if known is None else known for row, known in enumerate(exact)]


def _unix_ns(text: str) -> int | None:
    if not re.fullmatch(r"\d{9,11}(\.\d+)?", text):
        return None
    seconds, _, fraction = text.partition(".")
    return plausible_ns(int(seconds) * 10**9 + int(fraction[:9].ljust(9, "0")))


def _moment(text: str, zone: tzinfo | None, time_format: str | None) -> datetime:
    moment = _parsed(text, time_format)
    if moment.tzinfo is not None:
        return moment
    if zone is None:
        raise ConfigError(f"the time {text!r} has no zone", fix="give it: --zone Asia/Tokyo, or --zone UTC")
    return moment.replace(tzinfo=zone)


def _hours_back(moment: datetime) -> float:
    """How far clocks were put back over this time: above 0 it came twice, below 0 never."""
    before, behind = (moment.replace(fold=fold).utcoffset() or timedelta() for fold in (0, 1))
    return (before - behind) / timedelta(hours=1)


def _second_times(moments: Mapping[int, datetime], texts: Sequence[str]) -> Iterator[int]:
    """Rows whose time came twice and which belong to the second, by the order of the rows.

    The clock goes back once in such a run of rows, which may stand newest first.
    """
    shown = {row: moment.replace(tzinfo=None) for row, moment in moments.items()}
    changes_s = [(later - earlier).total_seconds() for earlier, later in itertools.pairwise(shown.values())]
    newest_first = sum(change < 0.0 for change in changes_s) > len(changes_s) / 2
    is_coarse = bool(changes_s) and statistics.median(map(abs, changes_s)) >= _COARSE_S
    order = sorted(moments, reverse=newest_first)
    for is_twice, run in itertools.groupby(order, key=lambda row: _hours_back(moments[row]) > 0):
        rows = list(run)
        if not is_twice:
            continue
        pairs = list(enumerate(itertools.pairwise(shown[row] for row in rows), start=1))
        back = [place for place, (earlier, later) in pairs if later < earlier]
        if not back and is_coarse:  # an hourly log only repeats itself
            back = [place for place, (earlier, later) in pairs if later == earlier]
        if len(back) != 1:
            raise ConfigError(
                f"{texts[rows[0]]!r} came twice in {moments[rows[0]].tzinfo}, at the end of summer time, "
                "and the order of the rows leaves open which it was",
                fix=_fixed_offset(moments[rows[0]]),
            )
        yield from rows[back[0] :]


def _fixed_offset(moment: datetime) -> str:
    """What to do where a clock's zone leaves its times open: name the offset that it kept."""
    offsets = (moment.replace(fold=fold).utcoffset() or timedelta() for fold in (0, 1))
    hours = sorted(offset / timedelta(hours=1) for offset in offsets)
    kept = " or ".join(f"--zone Etc/GMT{-int(one):+d}" for one in hours if one.is_integer())
    cut = "export it with times in UTC, or import what lies before and after on its own"
    return f"if its clock was never put forward or back: {kept}; else {cut}" if kept else cut


def utc_ns(moment: datetime) -> int:
    """UTC nanoseconds since 1970 of a moment with a zone, exact to the microsecond; raises `ConfigError`."""
    return plausible_ns((moment - _EPOCH) // timedelta(microseconds=1) * 1000)


def plausible_ns(time_ns: int) -> int:
    """The same; raises `ConfigError` before 1970, and after 2262, where 64 bits end."""
    if not 0 <= time_ns < 2**63:
        raise ConfigError(
            f"a time {time_ns / 1e9:.0f} s after 1970 is none of a recording",
            fix="check its clock and format",
        )
    return time_ns


def _parsed(text: str, time_format: str | None) -> datetime:
    try:
        if time_format is None:
            return datetime.fromisoformat(text)
        pattern = time_format if "%" in time_format else _plain(time_format)
        return datetime.strptime(text, pattern)
    except ValueError as error:
        expected = time_format or "ISO 8601, such as 2026-12-11T12:00:00+09:00"
        example = "%m/%d/%y %I:%M:%S %p" if text.endswith(("AM", "PM")) else "%d.%m.%Y %H:%M:%S"
        raise ConfigError(
            f"{text!r} is not a time as expected: {expected}",
            fix=f'give the format of the times, such as --time-format "{example}"',
        ) from error


def _plain(words: str) -> str:
    """``yyyy/mm/dd HH:MM:SS`` as strptime has it."""
    return re.sub("|".join(_WORDS), lambda found: _WORDS[found[0]], words)
