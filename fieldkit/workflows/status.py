"""The present state of a session that is being recorded, worked out from what is stored so far."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fieldkit.config import Config
from fieldkit.estimation.estimator import Minute
from fieldkit.model.samples import Sample
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views.latest import RATE_OVER_S, Latest
from fieldkit.workflows.describe import recorded_learnt
from fieldkit.workflows.estimate import estimator_for
from fieldkit.workflows.running import UnresponsiveRecorder, running_session, unresponsive_recorder
from fieldkit.workflows.sources import config_for

LAST_MINUTES_NS = 150 * SECOND_NS
"""Samples that hold a whole minute, closed by what came after it."""


@dataclass(frozen=True)
class RecordingStatus:
    """How a running recording is doing; `unresponsive` is set if its process does not respond."""

    session: Path
    start_ns: int
    end_ns: int
    counts: dict[str, int]
    latest: Latest
    unresponsive: UnresponsiveRecorder | None


def recording_status(config: Config) -> RecordingStatus:
    """The present state of a campaign's running recording; raises `RefusedError` if there is none."""
    path = running_session(config)
    unresponsive = unresponsive_recorder(path)
    with open_session(path) as session:
        counts = {name: session.count(name) for name in session.streams}
        return RecordingStatus(
            path, session.start_ns, session.end_ns, counts, latest_of(session), unresponsive
        )


def latest_of(session: SessionReader) -> Latest:
    """What the live view of a session's recorder shows now, from what is stored."""
    regions = session.region_schedule.regions_at(session.end_ns // MINUTE_NS)
    latest = Latest(session.site, regions, tuple(session.streams.values()), session.header.title)
    for event in session.events():
        latest.update(event)
    for health in session.health()[-RATE_OVER_S - 1 :]:
        latest.update(health)
    for name in session.streams:
        if count := session.count(name):
            latest.update(next(session.stream(name).samples(count - 1, count)))
    if (minute := _last_minute(session)) is not None:
        latest.update(minute)
    return latest


def _last_minute(session: SessionReader) -> Minute | None:
    """The last minute that closed, measured again from its samples, with the slopes that were stored."""
    estimator = estimator_for(session, config_for(session))
    closed = [minute for sample in _last_samples(session) for minute in estimator.add(sample)]
    if not closed:
        return None
    estimates = session.estimates()
    stored = [one for one in estimates if one.time_ns == estimates[-1].time_ns]
    return replace(closed[-1], estimates=tuple(stored), events=(), learnt=recorded_learnt(session))


def _last_samples(session: SessionReader) -> Iterator[Sample]:
    since_ns = session.end_ns - LAST_MINUTES_NS
    first = {name: int(np.searchsorted(session.times_ns(name), since_ns)) for name in session.streams}
    parts = (session.stream(name).samples(start) for name, start in first.items())
    return heapq.merge(*parts, key=lambda sample: sample.mono_ns)
