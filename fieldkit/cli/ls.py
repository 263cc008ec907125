"""``fieldkit ls``: the sessions of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, options, print_json, print_table, say
from fieldkit.cli.session_paths import recordings_folder
from fieldkit.model.errors import SessionError
from fieldkit.views import formatting
from fieldkit.workflows.recordings import sessions_in

if TYPE_CHECKING:
    from fieldkit.sessions.reader import Session


@click.command(cls=Command)
@click.argument("folder", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.pass_context
def command(ctx: click.Context, folder: Path | None) -> None:
    """List sessions: when, how long, how many samples, which state."""
    folder = folder or recordings_folder(ctx)
    if (folder / "recordings").is_dir():
        folder = folder / "recordings"
    rows = [_row(path) for path in sessions_in(folder)]
    if options(ctx).json:
        print_json({"folder": str(folder), "sessions": rows})
        return
    if not rows:
        say(f"no sessions in {folder}")
        return
    print_table(
        ("session", "state", "began", "length", "samples", "MB"),
        [
            (
                row["name"],
                row["state"],
                row["began"],
                row["length"],
                _counts(row),
                f"{row['bytes'] / 1e6:.1f}",
            )
            for row in rows
        ],
    )
    if any(row["state"] == "interrupted" for row in rows):
        say("interrupted sessions wait for: fieldkit recover")


def _row(path: Path) -> dict[str, Any]:
    from fieldkit.sessions.reader import open_session

    size = path.stat().st_size if path.exists() else 0
    try:
        with open_session(path) as session:
            counts = {name: session.count(name) for name in session.streams}
            length_s = (session.end_ns - session.start_ns) / 1e9
            return {
                "name": path.name, "state": session.state, "began": local_time(session, session.start_ns),
                "start": iso_time(session, session.start_ns), "end": iso_time(session, session.end_ns),
                "length": duration(length_s), "length_s": length_s, "samples": counts, "bytes": size,
                "title": session.header.title,
            }  # fmt: skip
    except SessionError as error:
        waits = path.with_name(path.name + ".journal").exists()
        state = "interrupted" if waits else "unreadable"
        unknown = {"began": "", "length": "", "samples": {}, "bytes": size}
        return {"name": path.name, "state": state, **unknown, "problem": error.message}


def local_time(session: Session, time_ns: int) -> str:
    """A moment in the site's zone, which is named; empty for none."""
    if not time_ns:
        return ""
    return formatting.local_time(time_ns, session.site).strftime("%Y-%m-%d %H:%M:%S %Z")


def iso_time(session: Session, time_ns: int) -> str | None:
    """A moment as ISO 8601 with the site's offset; None for none."""
    return formatting.local_time(time_ns, session.site).isoformat() if time_ns else None


def duration(seconds: float) -> str:
    """``3 h 09 min``, ``12 min 30 s`` or ``4.2 s``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02} min"


def _counts(row: dict[str, Any]) -> str:
    return "  ".join(f"{name} {count}" for name, count in row["samples"].items()) or row.get("problem", "")
