"""A new session of an old one and a recording that was made beside it; the old one stays as it is."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Sample, Severity
from fieldkit.sessions.check_clock import apply_time_map
from fieldkit.sessions.formats.imported import Foreign, StampedClock
from fieldkit.sessions.reader import Session
from fieldkit.sessions.records import RegionRecord
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.time_map import TimeStep, added_ns, recorded_mono_ns
from fieldkit.sessions.writer import SessionWriter


@dataclass(frozen=True, slots=True)
class _Cut:
    """The samples between two times, read again whenever they are asked for."""

    samples: Iterable[Sample]
    between_ns: dict[str, tuple[int, int]]

    def __iter__(self) -> Iterator[Sample]:
        for one in self.samples:
            first_ns, last_ns = self.between_ns[one.stream]
            if first_ns <= one.time_ns <= last_ns:
                yield one


def cut_to(session: Session, foreign: Foreign) -> Foreign:
    """What of a recording belongs to the session's time, and two intervals more on either side."""
    margin_ns = {info.name: round(2e9 / info.rate_hz) if info.rate_hz else 0 for info in foreign.streams}
    first_ns, last_ns = session.start_ns, session.end_ns
    kept = _Cut(
        foreign.samples, {name: (first_ns - more, last_ns + more) for name, more in margin_ns.items()}
    )
    left_out = sum(1 for _ in foreign.samples) - sum(1 for _ in kept)
    if not left_out:
        return foreign
    said = f"{left_out} samples from before or after the session were left out"
    return replace(foreign, samples=kept, remarks=(*foreign.remarks, (Severity.INFO, said)))


def merge(session: Session, foreign: Foreign, path: Path, source: str) -> SealReport:
    """Write `session` with the streams of `foreign` as a new session at `path`, and seal it.

    Raises `ConfigError` where a stream of that name is there, or the times do not meet, `SessionError`
    where the session is not finished: a part of it would be missing from the new one for good.
    """
    session.require_finished()
    taken = {info.name for info in foreign.streams} & set(session.streams)
    if taken:
        raise ConfigError(
            f"{session.path} has a stream {taken.pop()!r} already", fix="another name: --as NAME"
        )
    time_ns = [one.time_ns for one in foreign.samples]
    if not time_ns or max(time_ns) < session.start_ns or min(time_ns) > session.end_ns:
        raise ConfigError(
            f"{source} and {session.path} do not overlap in time",
            fix="check --zone and --offset of the logger",
        )
    header = replace(session.header, streams=(*session.header.streams, *foreign.streams))
    steps = session.time_map()
    began = recorded_mono_ns(steps, session.start_ns, session.anchor_ns)
    clock = StampedClock(began, session.anchor_ns)
    writer = SessionWriter(path, header, clock)
    try:
        drawn = {(region.name, region.vertices) for region in header.regions}  # the writer has put these
        for entry in session.entries():
            if not isinstance(entry, RegionRecord) or (entry.region.name, entry.region.vertices) not in drawn:
                writer.put(entry)
        for severity, text in ((Severity.INFO, f"stream added from {source}"), *foreign.remarks):
            now = clock.mono_ns()
            writer.event(Event(EventKind.IMPORTED, now, clock.to_utc_ns(now), text, "", severity))
        for sample in _by_time(session, foreign.samples, steps):
            writer.append(sample)
            clock.now_ns = sample.mono_ns
    except BaseException:
        writer.discard()
        raise
    report = writer.close()
    if steps:
        apply_time_map(path, steps)
    return report


def _by_time(session: Session, added: Iterable[Sample], steps: list[TimeStep]) -> Iterator[Sample]:
    """All samples as recorded by the session's clocks, to which the added ones are moved."""
    moved = (_moved(sample, steps, session.anchor_ns) for sample in added)
    return heapq.merge(session.samples(recorded=True), moved, key=lambda sample: sample.mono_ns)


def _moved(sample: Sample, steps: list[TimeStep], anchor_ns: int) -> Sample:
    """A sample whose time the session's time map will make what it was."""
    mono_ns = recorded_mono_ns(steps, sample.time_ns, anchor_ns)
    return sample._replace(mono_ns=mono_ns, time_ns=sample.time_ns - added_ns(steps, mono_ns))
