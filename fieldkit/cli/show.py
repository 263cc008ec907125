"""``fieldkit show``: one session on a page; with ``--follow`` while it is being recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.session_paths import latest_session
from fieldkit.cli.types import PATH
from fieldkit.model.durations import precise_duration
from fieldkit.views.formatting import by_time, event_text

if TYPE_CHECKING:
    from fieldkit.model.samples import Event
    from fieldkit.model.slope import SlopeEstimate
    from fieldkit.sessions.reader import SessionReader

_LAST_EVENTS = 12


@click.command(cls=Command)
@click.argument("session", required=False, type=PATH)
@click.option("--follow", is_flag=True, help="Continue printing while the session is being recorded.")
def command(session: Path | None, follow: bool) -> None:
    """Show one SESSION: where, when, streams, regions, last slopes, events.

    Without SESSION, the campaign's latest.
    """
    from fieldkit.cli.slope_table import print_learnt
    from fieldkit.results.describe import describe, recorded_learnt, recorded_slopes
    from fieldkit.sessions.reader import open_session

    path = latest_session(session)
    with open_session(path) as opened:
        document = describe(opened)
        if options().json and not follow:
            print_json(document)
            return
        if not options().json:
            _print(document, recorded_slopes(opened), by_time(opened.events()))
            print_learnt(recorded_learnt(opened))
        if follow:
            _follow(opened)


def _print(document: dict[str, Any], slopes: Sequence[SlopeEstimate], events: Sequence[Event]) -> None:
    site = document["site"]
    click.echo(f"{document['title'] or document['session']}  ({document['state']})")
    click.echo(f"  {document['session']}")
    place = f"{site['latitude_deg']:.5f} {site['longitude_deg']:.5f}, {site['elevation_m']:g} m"
    click.echo(f"  {place}   {document['began']} for {precise_duration(document['length_s'])}")
    for stream in document["streams"]:
        shape = "x".join(str(side) for side in reversed(stream["shape"]))
        components = ", ".join(dict.fromkeys(word or "component unknown" for word in stream["measures"]))
        what = (
            f"{stream['quantity'].replace('_', ' ')} {components}".rstrip() + f" [{stream['unit']}] {shape}"
        )
        click.echo(f"  {stream['name']:<12} {stream['samples']:>8} samples  {what}  {stream['device']}")
    for region in document["regions"]:
        true = (
            f"{region['tilt_deg']:g}°/{region['azimuth_deg']:g}°"
            if region["tilt_deg"] == region["tilt_deg"]
            else ""
        )
        click.echo(f"  region {region['name']:<12} {region['kind']:<10} {true}")
    for slope, row in zip(slopes, document["slopes"], strict=True):
        click.echo(f"  slope  {slope.region:<12} {_slope(slope)}  {row['at']}")
    shown = list(zip(document["events"], events, strict=True))
    joined = [row for row in shown[:-_LAST_EVENTS] if "offset_s" in row[1].data]
    for entry, event in (*joined, *shown[-_LAST_EVENTS:]):
        click.echo(f"  {entry['at']}  {entry['kind']:<10} {entry['stream']} {event_text(event)}".rstrip())


def _slope(slope: SlopeEstimate) -> str:
    """Angles with their likelihood regions and the state, or in words why there are none."""
    from fieldkit.views import formatting

    if math.isfinite(slope.tilt_deg):
        return f"{formatting.tilt(slope)}°, azimuth {formatting.azimuth(slope)}  {formatting.state(slope)}"
    return f"{formatting.state(slope)}: {slope.reason}" if slope.reason else formatting.state(slope)


def _follow(session: SessionReader) -> None:
    """Print what is recorded meanwhile, until the recording ends."""
    from fieldkit.model.samples import Event
    from fieldkit.recording.status import changes

    for change in changes(session):
        if isinstance(change, Event):
            row = {"event": change.kind.name.lower(), "text": change.text}
        else:
            row = {name: getattr(change, name) for name in ("stream", "samples", "value", "unit")}
        _print_change(session, row, change.time_ns)
    say("the recording has ended")


def _print_change(session: SessionReader, change: dict[str, Any], time_ns: int) -> None:
    from fieldkit.results.describe import local_time

    at = local_time(session.site, time_ns)
    if options().json:
        print_json({"at": at, **change}, on_one_line=True)
        return
    click.echo(f"  {at}  " + "  ".join(_word(value) for value in change.values()))


def _word(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(_word(item) for item in value)
    return f"{value:.5g}" if isinstance(value, float) else str(value)
