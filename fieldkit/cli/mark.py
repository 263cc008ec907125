"""``fieldkit mark``: add a note to the running recording."""

from __future__ import annotations

from datetime import datetime, time, timedelta, tzinfo

import click

from fieldkit.cli.common import Command, campaign, options, print_json, say
from fieldkit.cli.types import WORDS
from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import RefusedError, StorageError
from fieldkit.recorder.marks import Mark, When, drop_mark, marks_folder
from fieldkit.views import formatting
from fieldkit.workflows.running import session_in_progress, unresponsive_recorder

CLOCKS_DIFFER = timedelta(minutes=5)
"""A clock time this little ahead is now by somebody's watch; one further ahead was yesterday."""
YEAR_S = 365.25 * 86_400.0
FAR_S, FAR_IN_SIMULATION_S = 10.0 * YEAR_S, 100.0 * YEAR_S
"""What lies further from now is a slip of the pen; a simulated day may be of another decade."""


@click.command(cls=Command)
@click.argument("text", type=WORDS)
@click.option(
    "-k", "--kind", default="", type=WORDS, metavar="WORD", help="Label to filter by, such as cloud."
)
@click.option(
    "--at", metavar="TIME", help="Time of the event: -30s, -5m, 12:31 (the site's zone), or ISO 8601."
)
@click.option("--from", "start", metavar="TIME", help="Start of an interval; needs --to.")
@click.option("--to", "end", metavar="TIME", help="End of an interval; needs --from.")
@click.pass_context
def command(
    ctx: click.Context, text: str, kind: str, at: str | None, start: str | None, end: str | None
) -> None:
    r"""Add the note TEXT to the running recording, as an event of its session.

    \b
    fieldkit mark "wind picks up"
    fieldkit mark "cloud over the ridge" -k cloud --from -4m --to -1m
    """
    if (start is None) != (end is None) or (at and start):
        raise click.UsageError("give --at, or --from and --to together")
    config = campaign(ctx)
    zone = formatting.zone(config.site)
    now = datetime.now(zone)
    began = parse_when(at or start or "-0s", zone, now)
    mark = Mark(text, kind, began, parse_when(end, zone, now) if end else None)
    refuse_impossible(mark, now, FAR_IN_SIMULATION_S if config.simulation else FAR_S)
    session = session_in_progress(config.recordings)
    if session is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    try:
        drop_mark(marks_folder(session), mark)
    except FileNotFoundError:
        raise RefusedError(
            f"{session.name} has just ended and is being sealed: the mark comes too late",
            fix=f"write it down beside {session.name}",
        ) from None
    except OSError as error:
        raise StorageError(f"the mark could not be written beside {session}: {error.strerror}") from error
    if options(ctx).json:
        print_json({"session": str(session), "text": text, "kind": kind, "at": mark.at, "to": mark.to})
    if (silent := unresponsive_recorder(session)) is not None:
        say(f"warning: {silent.at(config.site)}; the mark waits for it beside {session.name}: {text}")
    else:
        say(f"marked in {session.name}: {text}")


def parse_when(text: str, zone: tzinfo, now: datetime) -> When:
    """Seconds before `now` from ``-30s``, ``-5m``, ``-1h``; else a time as ISO 8601, by default in `zone`.

    ``12:31`` is the last time that clocks showed it. Raises `click.UsageError` for anything else.
    """
    try:
        if text.startswith("-"):
            return -parse_duration(text[1:])
        if ":" in text[:3]:
            return _last(time.fromisoformat(text), zone, now).isoformat()
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise click.UsageError(f"{text!r} is no time; write -30s, 12:31 or 2026-12-11T12:31+09:00") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=zone)).isoformat()


def _last(shown: time, zone: tzinfo, now: datetime) -> datetime:
    """When clocks last showed a time, in its own zone where it has one."""
    theirs = shown.tzinfo or zone
    latest = (now + CLOCKS_DIFFER).timestamp()
    day = now.astimezone(theirs).date()
    moments = [datetime.combine(day + timedelta(days), shown, theirs) for days in (1, 0, -1)]
    return next(moment for moment in moments if moment.timestamp() <= latest)


def refuse_impossible(mark: Mark, now: datetime, far_s: float) -> None:
    """Raise `click.UsageError` for a time further than `far_s` from now, or an end before its start."""
    ends = [mark.at] if mark.to is None else [mark.at, mark.to]
    after_s = [_after_s(end, now) for end in ends]
    for end, seconds in zip(ends, after_s, strict=True):
        if abs(seconds) > far_s:
            told = f"{seconds:g} s" if isinstance(end, float) else end
            raise click.UsageError(
                f"{told} is more than {far_s / YEAR_S:.0f} years from now; correct the time"
            )
    if after_s[-1] < after_s[0]:
        raise click.UsageError("the end lies before the start; give the earlier time to --from")


def _after_s(when: When, now: datetime) -> float:
    return datetime.fromisoformat(when).timestamp() - now.timestamp() if isinstance(when, str) else when
