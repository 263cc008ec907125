"""``fieldkit status``: how the recording that runs is doing."""

from __future__ import annotations

import click

from fieldkit.commands import common
from fieldkit.commands.running import session_in_progress
from fieldkit.errors import RefusedError
from fieldkit.sessions.reader import open_session
from fieldkit.views import words


@click.command(cls=common.Verb)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Tell how the recording that runs is doing: streams, gaps, disk, last events."""
    config = common.campaign(ctx)
    path = session_in_progress(config.recordings)
    if path is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    with open_session(path) as session:
        counts = {name: session.count(name) for name in session.streams}
        health = session.health()[-1:]
        events = session.events()[-5:]
        start_ns, end_ns, site = session.start_ns, session.end_ns, session.site
    if common.options().json:
        events_plain = [{"time_ns": event.time_ns, "text": event.text} for event in events]
        common.print_json({"session": str(path), "counts": counts, "events": events_plain})
        return
    began, last = words.clock_time(start_ns, site), words.clock_time(end_ns, site, seconds=True)
    lasted = words.duration((end_ns - start_ns) / 1e9)
    click.echo(f"recording {path.name} since {began} {words.zone_name(start_ns, site)}")
    click.echo(f"  last sample {last}, {lasted} so far")
    for name, count in counts.items():
        click.echo(f"  {name}: {count} samples")
    for one in health:
        lost = sum(stream.dropped for stream in one.streams)
        click.echo(f"  {words.size(one.disk_free_bytes)} free, {lost} samples lost")
    for event in events:
        click.echo(f"  {words.clock_time(event.time_ns, site, seconds=True)}  {words.told(event)}")
