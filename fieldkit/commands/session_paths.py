"""Which sessions a verb is about: the ones named, those of a folder, or the campaign's newest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from fieldkit.commands.common import options
from fieldkit.errors import ConfigError, SessionError

JOURNAL = ".journal"


def recordings_folder(ctx: click.Context) -> Path:
    """``recordings/`` of the campaign that ``-C`` names or around the current folder, else the folder."""
    from fieldkit.config import find_campaign

    start = options(ctx).directory or Path.cwd()
    try:
        return find_campaign(start).parent / "recordings"
    except ConfigError:
        return start


def sessions_in(folder: Path) -> list[Path]:
    """The sessions of a folder by name, and so by age; those included of which only the journal is left."""
    names = {path.name for path in folder.glob("*.h5")}
    names |= {path.name.removesuffix(JOURNAL) for path in folder.glob(f"*.h5{JOURNAL}")}
    return [folder / name for name in sorted(names)]


def resolved(ctx: click.Context, paths: Sequence[Path]) -> list[Path]:
    """The sessions meant by files and folders; the campaign's own where none is named.

    Raises `SessionError` where a path does not exist or there is no session at all.
    """
    found: list[Path] = []
    for path in paths or [recordings_folder(ctx)]:
        if path.is_dir():
            inside = path / "recordings" if (path / "recordings").is_dir() else path
            found.extend(sessions_in(inside))
        elif path.exists() or path.with_name(path.name + JOURNAL).exists():
            found.append(path)
        else:
            raise SessionError(
                f"there is no session {path}", fix="fieldkit ls shows the sessions of a campaign"
            )
    if not found:
        where = f"in {', '.join(map(str, paths))}" if paths else "here"
        raise SessionError(f"there are no sessions {where}", fix="name one, or record one: fieldkit record")
    return found


def newest(ctx: click.Context, path: Path | None) -> Path:
    """The session named, or the campaign's newest."""
    return resolved(ctx, [path] if path else [])[-1]
