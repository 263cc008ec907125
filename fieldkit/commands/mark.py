"""``fieldkit mark``: note something on the recording that runs."""

from __future__ import annotations

import re
from datetime import datetime, time
from zoneinfo import ZoneInfo

import click

from fieldkit.commands.common import Verb, campaign, options, print_json, say
from fieldkit.commands.running import session_in_progress
from fieldkit.errors import RefusedError, StorageError
from fieldkit.marks import Mark, When, drop_mark, marks_folder

SECONDS = {"s": 1, "m": 60, "h": 3600}


@click.command(cls=Verb)
@click.argument("text")
@click.option("-k", "--kind", default="", metavar="WORD", help="One word to sort by, such as cloud.")
@click.option(
    "--at", metavar="TIME", help="When it happened: -30s, -5m, 12:31 (the site's zone), or ISO 8601."
)
@click.option("--from", "start", metavar="TIME", help="When it began; needs --to.")
@click.option("--to", "end", metavar="TIME", help="When it ended; needs --from.")
@click.pass_context
def command(
    ctx: click.Context, text: str, kind: str, at: str | None, start: str | None, end: str | None
) -> None:
    r"""Note TEXT on the recording that runs; it is an event of the session.

    \b
    fieldkit mark "wind picks up"
    fieldkit mark "cloud over the ridge" -k cloud --from -4m --to -1m
    """
    if (start is None) != (end is None) or (at and start):
        raise click.UsageError("give --at, or --from and --to together")
    config = campaign(ctx)
    zone = ZoneInfo(config.site.timezone)
    began = parse_when(at or start or "-0s", zone)
    mark = Mark(text, kind, began, parse_when(end, zone) if end else None)
    session = session_in_progress(config.recordings)
    if session is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    try:
        drop_mark(marks_folder(session), mark)
    except OSError as error:
        raise StorageError(f"the mark could not be written beside {session}: {error.strerror}") from error
    if options(ctx).json:
        print_json({"session": str(session), "text": text, "kind": kind, "at": mark.at, "to": mark.to})
    say(f"marked in {session.name}: {text}")


def parse_when(text: str, zone: ZoneInfo) -> When:
    """Seconds before now from ``-30s``, ``-5m``, ``-1h``; else ISO 8601, ``12:31`` being today in `zone`.

    Raises `click.UsageError` for anything else.
    """
    ago = re.fullmatch(r"-(\d+(?:\.\d+)?)([smh])", text)
    if ago:
        return -float(ago[1]) * SECONDS[ago[2]]
    try:
        moment = _clock_time(text, zone) if len(text) <= len("12:31:05") else datetime.fromisoformat(text)
    except ValueError:
        raise click.UsageError(f"{text!r} is no time; write -30s, 12:31 or 2026-12-11T12:31+09:00") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=zone)).isoformat()


def _clock_time(text: str, zone: ZoneInfo) -> datetime:
    return datetime.combine(datetime.now(zone).date(), time.fromisoformat(text), zone)
