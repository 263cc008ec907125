"""``fieldkit mark``: add a note to the running recording; list, edit and take back those of any session."""

from __future__ import annotations

from pathlib import Path

import click

from fieldkit.cli.common import Command, campaign, print_if_json, print_table, recordings, say
from fieldkit.cli.types import PATH, WORDS

Changes = tuple[str | None, str | None, str | None, str | None]
"""Label, time, start and end of a mark, as typed."""


@click.command(cls=Command)
@click.argument("words", metavar="[TEXT]", type=WORDS, nargs=-1)
@click.option("-k", "--kind", type=WORDS, metavar="WORD", help="Label to filter by, such as cloud.")
@click.option(
    "--at", metavar="TIME", help="Time of the event: -30s, -5m, 12:31 (the site's zone), or ISO 8601."
)
@click.option("--from", "start", metavar="TIME", help="Start of an interval; needs --until.")
@click.option("--until", "to", metavar="TIME", help="End of an interval; needs --from.")
@click.option(
    "--for", "longest", metavar="TIME", help="Longest time of a shade test that begins.  [default: 20m]"
)
@click.option("--list", "is_list", is_flag=True, help="Print the marks with their numbers.")
@click.option("--take-back", metavar="MARK", type=WORDS, help="Take back a mark, by its number or text.")
@click.option("--edit", metavar="MARK", type=WORDS, help="Change a mark's text, --kind or time.")
@click.option(
    "--session",
    type=PATH,
    metavar="SESSION",
    help="Session to list or correct.  [default: the running one, else the latest]",
)
def command(
    words: tuple[str, ...], kind: str | None, at: str | None, start: str | None,
    to: str | None, longest: str | None, is_list: bool, take_back: str | None, edit: str | None,
    session: Path | None,
) -> None:  # fmt: skip
    r"""Add the note TEXT to the running recording, as an event of its session.

    "shade-test REGION" when a board begins to shade a region, "shade-test REGION end" when it is taken away,
    or "shade-test REGION" with an interval: estimates then know those minutes as shaded. Without an end the
    shade counts for 20 minutes, or for the time that --for states.

    A mark that was taken back or edited, while recording or later, stays in the session as it was made;
    estimates, reports and exports use the marks as corrected.

    \b
    fieldkit mark "wind picks up"
    fieldkit mark "cloud over the ridge" -k cloud --from -4m --until -1m
    fieldkit mark shade-test b15 --at -30s
    fieldkit mark shade-test b15 end
    fieldkit mark --take-back 2
    fieldkit mark --edit 3 shade-test b25 --at 12:31 --session recordings/noon.h5
    """
    text, changes = " ".join(words), (kind, at, start, to)
    if (start is None) != (to is None) or (at and start):
        raise click.UsageError("give --at, or --from and --until together")
    actions = is_list + (take_back is not None) + (edit is not None)
    if actions > 1 or (actions and (longest or (edit is None and (text or any(changes))))):
        raise click.UsageError("--list and --take-back stand alone; --edit takes TEXT, --kind and a time")
    if actions:
        _correct(_session(session), take_back, edit, text, changes)
    elif not text or session is not None:
        raise click.UsageError("give the TEXT of a mark; --session needs --list, --take-back or --edit")
    else:
        _add(text, kind or "", at or start or "-0s", to, longest)


def _add(text: str, kind: str, at: str, to: str | None, longest: str | None) -> None:
    from fieldkit.recording.marks import mark_of
    from fieldkit.recording.requests import send_to_recorder
    from fieldkit.recording.running import unresponsive_recorder

    folder = recordings()
    mark, effect = mark_of(folder, campaign, text, kind=kind, at=at, to=to, longest=longest)
    session = send_to_recorder(folder, mark).session
    print_if_json({"session": str(session), "text": text, "kind": kind, "at": mark.at, "to": mark.to})
    if (silent := unresponsive_recorder(session)) is not None:
        say(f"warning: {silent.at(campaign().site)}; the mark waits for it beside {session.name}: {text}")
    else:
        say(f"marked in {session.name}: {effect or text}")


def _correct(path: Path, take_back: str | None, edit: str | None, text: str, changes: Changes) -> None:
    from fieldkit.recording.marks import correct_mark
    from fieldkit.results.marks import replacement, withdrawal

    kind, at, start, to = changes
    if take_back is not None:
        mark = correct_mark(path, lambda session: withdrawal(session, take_back))
        say(f"{path.name}: {mark.text}")
    elif edit is not None:
        times = {"at": at or start, "to": to}
        mark = correct_mark(
            path, lambda session: replacement(session, edit, text or None, label=kind, **times)
        )
        say(f"{path.name}: mark {mark.corrects} is now: {mark.text}")
    else:
        _list(path)


def _session(path: Path | None) -> Path:
    """The session named, else the one being recorded, else the campaign's latest."""
    from fieldkit.cli.session_paths import latest_session
    from fieldkit.recording.running import session_in_progress

    return (session_in_progress(recordings()) if path is None else None) or latest_session(path)


def _list(path: Path) -> None:
    from fieldkit.results.describe import local_time
    from fieldkit.sessions.reader import open_session
    from fieldkit.views.formatting import event_text

    with open_session(path) as session:
        rows = [
            (number, local_time(session.site, mark.time_ns), event_text(mark))
            for number, mark in session.marks().items()
        ]
    marks = [dict(zip(("mark", "at", "text"), row, strict=True)) for row in rows]
    if not print_if_json({"session": str(path), "marks": marks}):
        print_table(("mark", "at", "text"), rows)
