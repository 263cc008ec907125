"""Sessions as ``fieldkit ls`` lists them, without opening those that are known.

Rows of finished sessions are kept in the user's cache folder and may be deleted at any time; a running
recording reports its own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import platformdirs

from fieldkit.disk import replacing
from fieldkit.model.version import __version__
from fieldkit.recording.status_request import recorder_status
from fieldkit.sessions.lock import is_locked, journal_path

Row = dict[str, Any]


def session_rows(folder: Path, sessions: Sequence[Path]) -> list[Row]:
    """The rows of all sessions of a folder, as `describe_briefly` has them."""
    cache = _cache_file(folder)
    before = _read(cache)
    keys = [_key(path) for path in sessions]
    rows = [before.get(key) or _row(path) for key, path in zip(keys, sessions, strict=True)]
    finished = {key: row for key, row in zip(keys, rows, strict=True) if key and "problem" not in row}
    if finished != before:
        _keep(cache, finished)
    return rows


def _key(path: Path) -> str:
    """The identity of a finished session; empty for any other."""
    if journal_path(path).exists():
        return ""
    about = path.stat()
    return f"{path.name} {about.st_ino} {about.st_size} {about.st_mtime_ns} {about.st_ctime_ns}"


def _row(path: Path) -> Row:
    if is_locked(journal_path(path)) and (status := recorder_status(path)) is not None:
        row: Row = status["brief"]
        return row
    from fieldkit.results.describe import describe_briefly

    return describe_briefly(path)


def _cache_file(folder: Path) -> Path:
    name = hashlib.sha256(f"{__version__} {folder.resolve()}".encode(errors="surrogateescape")).hexdigest()
    return platformdirs.user_cache_path("fieldkit") / "listings" / f"{name[:16]}.json"


def _read(cache: Path) -> dict[str, Row]:
    try:
        rows = json.loads(cache.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return rows if isinstance(rows, dict) else {}


def _keep(cache: Path, rows: Mapping[str, Row]) -> None:
    with suppress(OSError):  # the sessions are opened again next time
        cache.parent.mkdir(parents=True, exist_ok=True)
        with replacing(cache, synced=False) as draft:
            draft.write_text(json.dumps(rows), encoding="utf-8")
