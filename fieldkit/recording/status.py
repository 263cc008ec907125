"""A session that is being recorded: its present state, and what is new in it.

Its recorder reports the state (`status_request`); of one that does not respond it is worked out from what is
stored.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.estimation.estimator import Minute
from fieldkit.model.samples import Event, Frame, Sample
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.physics.camera_laws import frame_k
from fieldkit.recording.running import UnresponsiveRecorder, unresponsive_recorder
from fieldkit.results.describe import brief, recorded_learnt
from fieldkit.results.estimate import as_document, estimator_for
from fieldkit.results.json_document import attributes, learnt_document, plain_json
from fieldkit.results.sources import config_for
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting
from fieldkit.views.latest import RATE_OVER_S, Latest
from fieldkit.views.screen import status_text

LAST_EVENTS = 5
LAST_MINUTES_NS = 150 * SECOND_NS
"""Samples that hold a whole minute, closed by what came after it."""


@dataclass(frozen=True)
class RecordingStatus:
    """Status of a running recording; `unresponsive` is set if its process does not respond."""

    session: Path
    title: str
    start_ns: int
    end_ns: int
    counts: dict[str, int]
    latest: Latest
    unresponsive: UnresponsiveRecorder | None


def status_reply(status: RecordingStatus, cols: int) -> dict[str, Any]:
    """A recording's status for commands.

    Its status as ``--json`` prints it (``document``) and as coloured text of `cols` columns (``text``), its
    row of ``fieldkit ls`` (``brief``), and what marks depend on: regions' names, time zone, start and present
    time.
    """
    latest, silent = status.latest, status.unresponsive
    warning = "" if silent is None else silent.at(latest.site)
    text = status_text(status.session.name, latest, status.start_ns, status.end_ns, warning, cols)
    session_facts = (latest.site, status.start_ns, status.end_ns, status.counts, status.title)
    return {
        "document": _document(status),
        "text": text,
        "brief": brief(status.session, "recording", *session_facts),
        "regions": [region.name for region in latest.regions],
        "timezone": str(formatting.zone(latest.site)),
        "start_ns": status.start_ns,
        "time_ns": latest.time_ns,
    }


def _document(status: RecordingStatus) -> dict[str, Any]:
    latest, silent, step = status.latest, status.unresponsive, status.latest.clock_event
    minute, regions = latest.minute, {region.name: region for region in latest.regions}
    slopes = minute.estimates if minute else ()
    return {
        "session": str(status.session),
        "counts": status.counts,
        "responds": silent is None,
        "silent_since_ns": None if silent is None else silent.since_ns,
        "slopes": [as_document(slope, regions.get(slope.region)) for slope in slopes],
        "learnt": learnt_document(minute.learnt if minute else None),
        "surface_temperature_k": dict(minute.temperature_k) if minute else {},
        "spread_k": dict(minute.spread_k) if minute else {},
        "irradiance": attributes(minute, "dni_w_m2", "irradiance_model") if minute else None,
        "sun": attributes(minute, "sun_zenith_deg", "sun_azimuth_deg") if minute else None,
        "readings": {name: list(reading.values) for name, reading in latest.readings.items()},
        "streams": {
            name: {"rate_hz": latest.rate_hz(name), "age_s": latest.age_s(name), **latest.troubles(name)}
            for name in latest.streams
        },
        "disk": attributes(latest.health, "disk_free_bytes", "written_bytes") if latest.health else None,
        "clock": {"since_ns": latest.start_ns, "changed": step and attributes(step, "time_ns", "text")},
        "planned_end_ns": latest.planned_end_ns,
        "alarms": [asdict(alarm) for alarm in latest.alarms],
        "events": [
            {"time_ns": event.time_ns, "text": event.text, "kind": event.kind.name.lower(),
             "label": str(event.data.get("label", ""))}
            for event in latest.events[-LAST_EVENTS:]
        ],
    }  # fmt: skip


def reported_status(session: Path, title: str, latest: Latest, cols: int) -> str:
    """The status that a recorder reports of itself, as JSON; null before the first sample."""
    times_ns = [frame.time_ns for frame in latest.frames.values()]
    times_ns += [reading.time_ns for reading in latest.readings.values()]
    if not times_ns:
        return "null"
    streams = latest.health.streams if latest.health else ()
    counts = {stream.stream: stream.received for stream in streams}
    status = RecordingStatus(session, title, latest.start_ns, max(times_ns), counts, latest, None)
    return plain_json(status_reply(status, cols))


def stored_status(path: Path) -> RecordingStatus:
    """The state of a running recording, from what is stored so far."""
    with open_session(path) as session:
        return RecordingStatus(
            path, session.header.title, session.start_ns, session.end_ns,
            {name: session.count(name) for name in session.streams},
            latest_of(session), unresponsive_recorder(path),
        )  # fmt: skip


def latest_of(session: SessionReader) -> Latest:
    """Content of the live view of a session's recorder now, from what is stored."""
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
    stored = [estimate for estimate in estimates if estimate.time_ns == estimates[-1].time_ns]
    return replace(closed[-1], estimates=tuple(stored), events=(), learnt=recorded_learnt(session))


def _last_samples(session: SessionReader) -> Iterator[Sample]:
    since_ns = session.end_ns - LAST_MINUTES_NS
    first = {name: int(np.searchsorted(session.times_ns(name), since_ns)) for name in session.streams}
    parts = (session.stream(name).samples(start) for name, start in first.items())
    return heapq.merge(*parts, key=lambda sample: sample.mono_ns)


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
