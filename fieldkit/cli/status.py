"""``fieldkit status``: show how the running recording is doing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.views import formatting
from fieldkit.workflows.estimate import as_document
from fieldkit.workflows.running import UnresponsiveRecorder, running_session, unresponsive_recorder
from fieldkit.workflows.status import latest_of

if TYPE_CHECKING:
    from fieldkit.sessions.reader import Session
    from fieldkit.views.latest import Latest

LAST_EVENTS = 5


@click.command(cls=common.Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Show how the running recording is doing: slopes, temperatures, streams, disk, last events."""
    from fieldkit.sessions.reader import open_session

    config = common.campaign(ctx)
    path = running_session(config)
    silent = unresponsive_recorder(path)
    with open_session(path) as session:
        latest = latest_of(session)
        if common.options().json:
            common.print_json(_document(session, latest, silent))
        else:
            _print(session, latest, silent)


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
