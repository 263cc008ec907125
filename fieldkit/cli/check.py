"""``fieldkit check``: is everything there, and does it make sense? Nothing is changed, unless asked for."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.session_paths import find_sessions
from fieldkit.model.errors import FieldkitError, IntegrityError, RefusedError

if TYPE_CHECKING:
    from fieldkit.sessions.check import Finding

_MARKS = {"ok": ("ok  ", None), "warn": ("warn", "yellow"), "fail": ("FAIL", "red")}
_AGREE_DEG = 1e-9


@click.command(cls=Command)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
@click.option("--strict", is_flag=True, help="Warnings count as failures: exit code 7.")
@click.option(
    "--apply", "apply_map", is_flag=True, help="Write the proposed time map into the session, as data."
)
@click.option("--no-estimates", is_flag=True, help="Do not compute the slopes again to compare them.")
@click.pass_context
def command(
    ctx: click.Context, paths: tuple[Path, ...], strict: bool, apply_map: bool, no_estimates: bool
) -> None:
    """Check sessions: checksums, gaps, rates, clocks, units, slopes.

    PATHS are sessions or folders; without any, the campaign's. Exit code 7 where one is damaged.
    """
    from fieldkit.sessions.check import worst

    documents, failed = [], False
    for path in find_sessions(ctx, paths):
        findings = findings_for(path, estimates=not no_estimates)
        level = worst(findings)
        failed = failed or level == "fail" or (strict and level == "warn")
        documents.append(
            {"session": str(path), "level": level, "findings": [asdict(one) for one in findings]}
        )
        if not options(ctx).json:
            _print(path, findings)
        if apply_map:
            _apply(path, alone=len(paths) == 1 and not paths[0].is_dir())
    if options(ctx).json:
        print_json({"sessions": documents})
    if failed:
        raise IntegrityError("not everything is in order", fix="the lines marked FAIL say what to do")


def findings_for(path: Path, *, estimates: bool = True) -> list[Finding]:
    """What there is to say about a session, its slopes computed again included."""
    from fieldkit.sessions.check import check

    findings = check(path)
    if estimates and not any(one.what == "file" for one in findings):
        findings += _estimates(path)
    return findings


def _estimates(path: Path) -> list[Finding]:
    """The slopes of the recording against those the same samples give now."""
    from fieldkit.sessions.check import Finding
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.estimate import estimator_for, minutes_of
    from fieldkit.workflows.sources import config_for

    with open_session(path) as session:
        stored = session.estimates()
        if not stored or session.time_map():
            return []
        try:
            # streams that were imported beside it had no part in what the recording estimated
            recorded = tuple(info for info in session.streams.values() if info.driver != "import")
            estimator = estimator_for(session, config_for(session), streams=recorded)
            again = [one for minute in minutes_of(session, estimator) for one in minute.estimates]
        except FieldkitError as error:
            return [Finding("warn", "slopes", f"could not be computed again: {error}", error.fix or "")]
    computed = {(one.time_ns // 1000, one.region): one for one in again}  # stored to the microsecond
    differing = 0
    for one in stored:
        other = computed.get((one.time_ns // 1000, one.region))
        same = other is not None and _agree(one.tilt_deg, other.tilt_deg)
        differing += not (same and other is not None and _agree(one.azimuth_deg, other.azimuth_deg))
    if differing:
        text = f"{differing} of {len(stored)} slopes come out differently from the stored samples"
        return [Finding("warn", "slopes", text, "another version of fieldkit, or samples that were lost")]
    return [Finding("ok", "slopes", f"{len(stored)} slopes come out the same from the stored samples")]


def _agree(one: float, other: float) -> bool:
    return abs(one - other) <= _AGREE_DEG or (one != one and other != other)


def _apply(path: Path, *, alone: bool) -> None:
    """Correct a session's clock as proposed; only for one named `alone` is nothing to correct an error."""
    from fieldkit.sessions.clock_correction import apply_time_map, propose_time_map
    from fieldkit.sessions.reader import open_session

    with open_session(path) as session:
        steps = propose_time_map(session)
        if not steps:
            told = f"{path.name}: its clock comparisons ask for no correction"
            if alone:
                raise RefusedError(told)
            say(told)
            return
        if steps == session.time_map():
            say(f"{path.name}: this time map is in force already")
            return
    apply_time_map(path, steps)
    for step in steps:
        say(f"{path.name}: {step.add_ns / 1e9:+.3f} s from now on when reading ({step.reason})")


def _print(path: Path, findings: list[Finding]) -> None:
    click.echo(path)
    for finding in findings:
        mark, colour = _MARKS[finding.level]
        text = click.style(mark, fg=colour) if colour and not options().no_color else mark
        click.echo(f"  {text}  {finding.what:<14} {finding.text}")
        if finding.fix and finding.level != "ok":
            click.echo(f"        fix: {finding.fix}")
