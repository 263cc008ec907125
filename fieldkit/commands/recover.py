"""``fieldkit recover``: finish a session whose recording did not come to its end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.commands.common import Verb, options, print_json, say
from fieldkit.commands.session_paths import recordings_folder, sessions_in
from fieldkit.errors import IntegrityError

if TYPE_CHECKING:
    from fieldkit.sessions.recovery import RecoveryReport


@click.command(cls=Verb)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
@click.option("--tidy", is_flag=True, help="Delete the file as the crash left it (NAME.h5.crashed).")
@click.pass_context
def command(ctx: click.Context, paths: tuple[Path, ...], tidy: bool) -> None:
    """Finish interrupted sessions from their journals; without PATHS, all of the campaign.

    It may be killed and run again; a finished session is left as it is. Exit code 7 where samples are lost.
    """
    from fieldkit.sessions.recovery import crashed_path, recover

    found = list(paths) or interrupted_in(recordings_folder(ctx))
    if not found:
        say("no interrupted session here")
    reports = [recover(path) for path in found]
    for report in reports:
        if not options(ctx).json:
            _print(report)
        if tidy:
            crashed_path(report.path).unlink(missing_ok=True)
    if options(ctx).json:
        print_json({"sessions": [_document(report) for report in reports]})
    if any(report.lost_samples for report in reports):
        raise IntegrityError("samples are lost", fix="the numbers above say which; all others are whole")


def interrupted_in(folder: Path) -> list[Path]:
    """The sessions of a folder that nobody is writing and nobody finished."""
    from fieldkit.errors import SessionError
    from fieldkit.sessions.lock import is_locked
    from fieldkit.sessions.reader import open_session

    found = []
    for path in sessions_in(folder):
        journal = path.with_name(path.name + ".journal")
        try:
            with open_session(path) as session:
                waits = session.state == "interrupted"
        except SessionError:
            waits = journal.exists()
        if waits and not is_locked(journal):
            found.append(path)
    return found


def _print(report: RecoveryReport) -> None:
    if report.was_complete:
        click.echo(f"{report.path}: complete, nothing to do")
        return
    click.echo(f"recovered {report.path}  {report.bytes / 1e6:.1f} MB")
    for name, count in report.counts.items():
        lost = "  ".join(f"{first}-{last}" for first, last in report.lost.get(name, []))
        tail = f", LOST numbers {lost}" if lost else ""
        click.echo(
            f"  {name}: {count} samples, {report.from_journal[name]} of them only in the journal{tail}"
        )
    for line in report.damage:
        click.echo(f"  damaged: {line}")
    if report.crashed is not None:
        say(f"the file as it was: {report.crashed.name} (fieldkit recover --tidy deletes it)")


def _document(report: RecoveryReport) -> dict[str, object]:
    return {
        "session": str(report.path),
        "was_complete": report.was_complete,
        "samples": report.counts,
        "from_journal": report.from_journal,
        "lost": report.lost,
        "damage": list(report.damage),
    }
