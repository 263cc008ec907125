"""A session while it is being recorded: what is new in it, until the recording ends.

>>> for change in changes(session):                                      # doctest: +SKIP
...     print(change)
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fieldkit.model.samples import Event, Frame
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.camera_laws import frame_k
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import SessionReader, open_session

SAMPLES_POLL_S = 0.5
MINUTES_POLL_S = 1.0


@dataclass(frozen=True, slots=True)
class StreamProgress:
    """The latest sample of a stream and how many there are; `value` is the mean of a frame, in `unit`."""

    stream: str
    samples: int
    value: float | list[float]
    unit: str
    time_ns: int


def changes(session: SessionReader) -> Iterator[Event | StreamProgress]:
    """The events and samples that come after what `session` has shown so far."""
    counts = {name: session.count(name) for name in session.streams}
    events = len(session.events(recorded=True))
    while is_locked(journal_path(session.path)):
        time.sleep(SAMPLES_POLL_S)
        session.refresh()
        for event in session.events(recorded=True)[events:]:
            events += 1
            yield event
        for name, before in counts.items():
            counts[name] = session.count(name)
            if counts[name] > before:
                yield _progress(session, name, counts[name])


def new_minutes(path: Path) -> Iterator[int]:
    """The minute of a recording's latest sample, as minutes since 1970, each time it is another one."""
    latest = -1
    while is_locked(journal_path(path)):
        with open_session(path) as session:
            minute = session.end_ns // MINUTE_NS
        if minute > latest:
            latest = minute
            yield minute
        time.sleep(MINUTES_POLL_S)


def _progress(session: SessionReader, name: str, count: int) -> StreamProgress:
    info = session.streams[name]
    sample = next(session.stream(name).samples(count - 1, count))
    value = (
        float(frame_k(info, sample.counts, sample.metadata_rows).mean())
        if isinstance(sample, Frame)
        else list(sample.values)
    )
    return StreamProgress(name, count, value, info.unit, sample.time_ns)
