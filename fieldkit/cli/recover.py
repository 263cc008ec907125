"""``fieldkit recover``: finish a session whose recording was interrupted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.session_paths import find_session, recordings_folder
from fieldkit.cli.types import PATH
from fieldkit.model.errors import FieldkitError, IntegrityError
from fieldkit.phrases import counted
from fieldkit.recording.recordings import delete_crash_files, is_interrupted, sessions_in
from fieldkit.results.json_document import attributes

if TYPE_CHECKING:
    from fieldkit.sessions.recovery import RecoveryReport
    from fieldkit.sessions.salvage import LostRange


@click.command(cls=Command)
@click.argument("paths", nargs=-1, type=PATH)
@click.option("--tidy", is_flag=True, help="Delete files kept from crashes (NAME.h5.crashed).")
def command(paths: tuple[Path, ...], tidy: bool) -> None:
    """Finish interrupted sessions from their journals; without PATHS, all of the campaign.

    Safe to interrupt and to run again; a finished session is not changed. Exit code 7 if anything is lost, or
    may be at the end.
    """
    from fieldkit.recording.request_reader import recover_session

    folder = recordings_folder()
    named_sessions = [find_session(path) for path in paths]
    interrupted = named_sessions or [path for path in sessions_in(folder) if is_interrupted(path)]
    if not interrupted:
        say(f"no interrupted session in {folder}: nothing to recover")
    reports: list[RecoveryReport] = []
    first_error: FieldkitError | None = None
    for path in interrupted:
        try:
            reports.append(recover_session(path))
        except FieldkitError as error:  # the others are recovered all the same
            if len(interrupted) > 1:
                say(f"{path}: " + error.explanation)
            first_error = error
            continue
        if not options().json:
            _print(reports[-1], keeps_file=not tidy)
    deleted = _tidy(named_sessions or sessions_in(folder)) if tidy else []
    if options().json:
        names = [str(path) for path in deleted]
        print_json({"sessions": [_document(report) for report in reports], "deleted": names})
    if first_error is not None:
        raise first_error
    if lost := sum(report.lost_samples + report.lost_entries for report in reports):
        raise IntegrityError(f"{lost} records are lost", fix="use the session: all others are intact")
    if any(report.doubt for report in reports):
        raise IntegrityError("the end is not known", fix="use the session: all samples in it are intact")


def _tidy(sessions: Sequence[Path]) -> list[Path]:
    deleted = delete_crash_files(sessions)
    for path in deleted:
        say(f"deleted {path}")
    if not deleted:
        say("nothing to tidy: no file of a crash is left (NAME.h5.crashed)")
    return deleted


def _print(report: RecoveryReport, *, keeps_file: bool) -> None:
    if report.was_complete:
        click.echo(f"{report.path}: complete, nothing to do")
        return
    if not report.counts:
        click.echo(f"{report.path}: nothing was recorded; what was left of its start is deleted")
        return
    click.echo(f"recovered {report.path}  {report.bytes / 1e6:.1f} MB")
    for name, count in report.counts.items():
        samples, journal = counted(count, "sample"), report.from_journal[name]
        click.echo(f"  {name}: {samples}, {journal} of them only in the journal")
    for run in report.lost:
        samples, between = counted(run.count, "sample"), " ".join(_between(run))
        click.echo(f"  LOST {run.stream}: {samples}, numbers {run.first} to {run.last}, {between}")
    for line in report.damage:
        click.echo(f"  damaged: {line}")
    click.echo(f"  {_conclusion(report)}")
    if keeps_file and report.crashed is not None:
        say(f"the file as it was: {report.crashed.name} (fieldkit recover --tidy deletes it)")


def _conclusion(report: RecoveryReport) -> str:
    """Which of the three it was: complete, its end not known, or so much lost."""
    lost = f"lost: {report.lost_samples} samples, {report.lost_entries} other records"
    lines = [lost] * (report.outcome == "lost") + [f"end not known: {report.doubt}"] * bool(report.doubt)
    return "; ".join(lines) or "complete: everything that was recorded is there"


def _between(run: LostRange) -> Iterator[str]:
    """Time of the lost samples: after the last one kept before them, before the next one kept."""
    yield f"after {_utc(run.after_ns)}" if run.after_ns else "from the beginning"
    yield f"and before {_utc(run.before_ns)}" if run.before_ns else "to the end"


def _utc(time_ns: int) -> str | None:
    if not time_ns:
        return None
    return datetime.fromtimestamp(time_ns // 1_000_000 / 1000, UTC).isoformat(timespec="milliseconds")


def _document(report: RecoveryReport) -> dict[str, object]:
    counts = {"samples": report.counts, "from_journal": report.from_journal}
    state = attributes(report, "was_complete", "outcome", "doubt", "lost_samples", "lost_entries")
    lost = list(map(_lost_document, report.lost))
    return {"session": str(report.path), **state, **counts, "lost": lost, "damage": list(report.damage)}


def _lost_document(run: LostRange) -> dict[str, object]:
    times = {"after": _utc(run.after_ns), "before": _utc(run.before_ns)}
    return {**attributes(run, "stream", "first", "last"), "samples": run.count, **times}
