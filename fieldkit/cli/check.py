"""``fieldkit check``: whether sessions are complete and plausible."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.next_steps import finding_in_commands, in_commands
from fieldkit.cli.session_paths import find_sessions
from fieldkit.cli.types import PATH
from fieldkit.model.errors import IntegrityError, RefusedError
from fieldkit.phrases import text_document

if TYPE_CHECKING:
    from fieldkit.results.check import CheckedSession

_MARKS = {"ok": ("ok  ", None), "warn": ("warn", "yellow"), "fail": ("FAIL", "red")}


@click.command(cls=Command)
@click.argument("paths", nargs=-1, type=PATH)
@click.option("--strict", is_flag=True, help="Warnings count as failures: exit code 7.")
@click.option(
    "--apply", "apply_map", is_flag=True, help="Write the proposed time map into the session, as data."
)
@click.option("--no-estimates", is_flag=True, help="Do not compute the slopes again to compare them.")
def command(paths: tuple[Path, ...], strict: bool, apply_map: bool, no_estimates: bool) -> None:
    """Check sessions: checksums, gaps, rates, clocks, units, slopes.

    PATHS are sessions or folders; without any, the campaign's. Exit code 7 where one is damaged.
    """
    from fieldkit.results.check import check

    checks = []
    for path in find_sessions(paths):
        session_check = check(path, estimates=not no_estimates)
        checks.append(session_check)
        if not options().json:
            _print(session_check)
    if options().json:
        print_json({"sessions": [_document(session_check) for session_check in checks]})
    for session_check in checks if apply_map else ():
        _correct_clock(session_check.path, is_only=len(paths) == 1 and not paths[0].is_dir())
    failing = {"fail", "warn"} if strict else {"fail"}
    if failing & {session_check.level for session_check in checks}:
        raise IntegrityError("not everything is in order", fix="see the lines marked FAIL")


def _correct_clock(path: Path, *, is_only: bool) -> None:
    """Correct a session's clock as proposed; that there is nothing to correct is an error for one session."""
    from fieldkit.results.check import correct_clock

    try:
        steps = correct_clock(path)
    except RefusedError as error:
        if is_only:
            raise
        say(error.explanation)
        return
    if not steps:
        say(f"{path.name}: this time map is active already")
    for step in steps:
        say(f"{path.name}: {step.add_ns / 1e9:+.3f} s from now on when reading ({step.reason})")


def _document(session_check: CheckedSession) -> dict[str, Any]:
    findings = [
        asdict(finding_in_commands(finding)) | text_document(finding.text)
        for finding in session_check.findings
    ]
    return {"session": str(session_check.path), "level": session_check.level, "findings": findings}


def _print(session_check: CheckedSession) -> None:
    click.echo(session_check.path)
    for finding in session_check.findings:
        mark, colour = _MARKS[finding.level]
        text = click.style(mark, fg=colour) if colour and not options().no_color else mark
        click.echo(f"  {text}  {finding.what:<14} {finding.text}")
        if finding.fix and finding.level != "ok":
            click.echo(f"        fix: {in_commands(finding.fix)}")
