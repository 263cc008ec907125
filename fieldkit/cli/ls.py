"""``fieldkit ls``: the sessions of a campaign."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, options, print_json, print_table, say, say_warning
from fieldkit.cli.session_paths import recordings_folder
from fieldkit.recording.recordings import recordings_in, sessions_in

_SHOWN = ("session", "region", "tilt_deg", "tilt_low_deg", "tilt_high_deg", "state", "true_tilt_deg", "start")


@click.command(cls=Command)
@click.argument("folder", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--where", metavar="CONDITION", help="Only regions that meet it, such as 'tilt > 10 and state == \"ok\"'."
)
@click.option("--since", metavar="DATE", help="Only sessions since then: 2026-11, 2026-11-03, 2026-11-03T12.")
def command(folder: Path | None, where: str | None, since: str | None) -> None:
    """List sessions: when, how long, how many samples, which state.

    With --where, the slopes of their regions as recorded, a row each: columns compared with numbers and texts
    by < <= > >= == != and joined by and, or, not. Columns: session, session_state, start, length, bytes,
    title, fieldkit_version, settings (a digest of those of the estimate), region, state, tilt, tilt_low,
    tilt_high, azimuth, true_tilt.
    """
    from fieldkit.recording.catalogue import catalogue_of

    folder = recordings_in(folder or recordings_folder())
    listed = catalogue_of(folder, sessions_in(folder, say_warning), jobs=os.cpu_count() or 1)
    listed = listed.since(since) if since else listed
    listed = listed.where(where) if where else listed
    rows = list(listed.sessions)
    if options().json:
        print_json({"folder": str(folder), "sessions": rows})
    elif not rows:
        say(f"no such sessions in {folder}" if where or since else f"no sessions in {folder}")
    elif where:
        print_table(_SHOWN, [tuple(map(_cell, map(row.get, _SHOWN))) for row in listed.rows()])
    else:
        _print(rows)


def _print(rows: list[dict[str, Any]]) -> None:
    cells = [
        (*map(row.get, ("name", "state", "began", "length")), _counts(row), f"{row['bytes'] / 1e6:.1f}")
        for row in rows
    ]
    print_table(("session", "state", "began", "length", "samples", "MB"), cells)
    if any(row["state"] == "interrupted" for row in rows):
        say("finish interrupted sessions with: fieldkit recover")


def _counts(row: dict[str, Any]) -> str:
    return "  ".join(f"{name} {count}" for name, count in row["samples"].items()) or row.get("problem", "")


def _cell(value: Any) -> str:
    return f"{value:.1f}" if isinstance(value, float) else value or ""
