"""``fieldkit status``: show how the running recording is doing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.views import formatting
from fieldkit.workflows.estimate import as_document
from fieldkit.workflows.json_document import learnt_document

if TYPE_CHECKING:
    from fieldkit.workflows.status import RecordingStatus

LAST_EVENTS = 5


@click.command(cls=common.Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Show how the running recording is doing: slopes, temperatures, streams, disk, last events."""
    from fieldkit.workflows.status import recording_status

    status = recording_status(common.campaign(ctx))
    if common.options().json:
        common.print_json(_document(status))
    else:
        _print(status)


def _print(status: RecordingStatus) -> None:
    from fieldkit.views.screen import THEMES, snapshot

    start_ns, end_ns, site = status.start_ns, status.end_ns, status.latest.site
    began, last = formatting.clock_time(start_ns, site), formatting.clock_time(end_ns, site, seconds=True)
    click.echo(f"recording {status.session.name} since {began} {formatting.zone_name(start_ns, site)}")
    click.echo(f"  last sample {last}, {formatting.rounded_duration((end_ns - start_ns) / 1e9)} so far")
    if status.unresponsive is not None:
        click.echo(f"warning: {status.unresponsive.at(site)}")
    console = common.console()
    with console.use_theme(THEMES["dark"]):
        console.print(snapshot(status.latest, console.width))


def _document(status: RecordingStatus) -> dict[str, Any]:
    latest, silent = status.latest, status.unresponsive
    minute, regions = latest.minute, {region.name: region for region in latest.regions}
    return {
        "session": str(status.session),
        "counts": status.counts,
        "responds": silent is None,
        "silent_since_ns": None if silent is None else silent.since_ns,
        "slopes": [as_document(one, regions[one.region]) for one in minute.estimates] if minute else [],
        "learnt": learnt_document(minute.learnt if minute else None),
        "surface_temperature_k": dict(minute.temperature_k) if minute else {},
        "readings": {name: list(reading.values) for name, reading in latest.readings.items()},
        "events": [
            {"time_ns": event.time_ns, "text": event.text, "kind": event.kind.name.lower(),
             "label": str(event.data.get("label", ""))}
            for event in latest.events[-LAST_EVENTS:]
        ],
    }  # fmt: skip
