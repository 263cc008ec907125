"""``fieldkit ls``: the sessions of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, options, print_json, print_table, say, say_warning
from fieldkit.cli.session_paths import recordings_folder
from fieldkit.recording.recordings import sessions_in


@click.command(cls=Command)
@click.argument("folder", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
def command(folder: Path | None) -> None:
    """List sessions: when, how long, how many samples, which state."""
    from fieldkit.recording.listing import session_rows

    folder = folder or recordings_folder()
    if (folder / "recordings").is_dir():
        folder = folder / "recordings"
    rows = session_rows(folder, sessions_in(folder, say_warning))
    if options().json:
        print_json({"folder": str(folder), "sessions": rows})
        return
    if not rows:
        say(f"no sessions in {folder}")
        return
    cells = [
        (*map(row.get, ("name", "state", "began", "length")), _counts(row), f"{row['bytes'] / 1e6:.1f}")
        for row in rows
    ]
    print_table(("session", "state", "began", "length", "samples", "MB"), cells)
    if any(row["state"] == "interrupted" for row in rows):
        say("finish interrupted sessions with: fieldkit recover")


def _counts(row: dict[str, Any]) -> str:
    return "  ".join(f"{name} {count}" for name, count in row["samples"].items()) or row.get("problem", "")
