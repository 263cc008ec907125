"""``fieldkit status``: show how the running recording is doing."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from fieldkit.cli import common
from fieldkit.model.errors import RefusedError
from fieldkit.model.units import SECOND_NS
from fieldkit.views import formatting
from fieldkit.workflows.estimate import as_document, estimator_for
from fieldkit.workflows.running import UnresponsiveRecorder, session_in_progress, unresponsive_recorder
from fieldkit.workflows.sources import config_for

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute
    from fieldkit.model.samples import Sample
    from fieldkit.sessions.reader import Session
    from fieldkit.views.latest import Latest

LAST_MINUTES_NS = 150 * SECOND_NS
"""Samples that hold a whole minute, closed by what came after it."""
LAST_EVENTS = 5


@click.command(cls=common.Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Show how the running recording is doing: slopes, temperatures, streams, disk, last events."""
    from fieldkit.sessions.reader import open_session

    config = common.campaign(ctx)
    path = session_in_progress(config.recordings)
    if path is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    silent = unresponsive_recorder(path)
    with open_session(path) as session:
        latest = latest_of(session)
        if common.options().json:
            common.print_json(_document(session, latest, silent))
        else:
            _print(session, latest, silent)


def latest_of(session: Session) -> Latest:
    """What the live view of a session's recorder shows now, from what is stored."""
    from fieldkit.views.latest import RATE_OVER_S, Latest

    latest = Latest(session.site, session.regions, tuple(session.streams.values()), session.header.title)
    for event in session.events():
        latest.take(event)
    for health in session.health()[-RATE_OVER_S - 1 :]:
        latest.take(health)
    for name in session.streams:
        if count := session.count(name):
            latest.take(next(session.stream(name).samples(count - 1, count)))
    if (minute := _last_minute(session)) is not None:
        latest.take(minute)
    return latest


def _last_minute(session: Session) -> Minute | None:
    """The last minute that closed, measured again from its samples, with the slopes that were stored."""
    estimator = estimator_for(session, config_for(session))
    closed = [minute for sample in _last_samples(session) for minute in estimator.add(sample)]
    if not closed:
        return None
    estimates = session.estimates()
    stored = [one for one in estimates if one.time_ns == estimates[-1].time_ns]
    return replace(closed[-1], estimates=tuple(stored), events=())


def _last_samples(session: Session) -> Iterator[Sample]:
    since_ns = session.end_ns - LAST_MINUTES_NS
    first = {name: int(np.searchsorted(session.times_ns(name), since_ns)) for name in session.streams}
    parts = (session.stream(name).samples(start) for name, start in first.items())
    return heapq.merge(*parts, key=lambda sample: sample.mono_ns)


def _print(session: Session, latest: Latest, silent: UnresponsiveRecorder | None) -> None:
    from fieldkit.views.screen import THEMES, snapshot

    start_ns, end_ns, site = session.start_ns, session.end_ns, session.site
    began, last = formatting.clock_time(start_ns, site), formatting.clock_time(end_ns, site, seconds=True)
    click.echo(f"recording {session.path.name} since {began} {formatting.zone_name(start_ns, site)}")
    click.echo(f"  last sample {last}, {formatting.duration((end_ns - start_ns) / 1e9)} so far")
    if silent is not None:
        click.echo(f"warning: {silent.at(site)}")
    console = common.console()
    with console.use_theme(THEMES["dark"]):
        console.print(snapshot(latest, console.width))


def _document(session: Session, latest: Latest, silent: UnresponsiveRecorder | None) -> dict[str, Any]:
    minute, regions = latest.minute, {region.name: region for region in session.regions}
    return {
        "session": str(session.path),
        "counts": {name: session.count(name) for name in session.streams},
        "responds": silent is None,
        "silent_since_ns": None if silent is None else silent.since_ns,
        "slopes": [as_document(one, regions[one.region]) for one in minute.estimates] if minute else [],
        "surface_temperature_k": dict(minute.temperature_k) if minute else {},
        "readings": {name: list(reading.values) for name, reading in latest.readings.items()},
        "events": [
            {"time_ns": event.time_ns, "text": event.text, "kind": event.kind.name.lower(),
             "label": str(event.data.get("label", ""))}
            for event in latest.events[-LAST_EVENTS:]
        ],
    }  # fmt: skip
