"""The catalogue of a folder: a row for each session and region, without opening the sessions that are known.

What is known of finished sessions is kept in one file in the user's cache folder, which may be deleted at any
time; a running recording reports its own.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import platformdirs

from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.version import __version__
from fieldkit.phrases import counted
from fieldkit.recording.recordings import recordings_in, sessions_in
from fieldkit.recording.status_request import recorder_status
from fieldkit.sessions.lock import is_locked, journal_path

if TYPE_CHECKING:
    import pandas as pd

Row = dict[str, Any]

_OF_SESSION = ("start", "title", "fieldkit_version", "settings", "length_s", "bytes")
_OF_REGION = ("region", "state", "tilt_deg", "tilt_low_deg", "tilt_high_deg", "azimuth_deg", "true_tilt_deg")
_NUMBERS = {"length_s", "bytes", *_OF_REGION[2:]}
COLUMNS: Mapping[str, type] = {
    name: float if name in _NUMBERS else str
    for name in ("session", "session_state", *_OF_SESSION, *_OF_REGION)
}
"""Columns of a catalogue and their kinds. `settings` is a digest of those that an estimate depends on,
`state` that of the slope."""
_DATE = re.compile(r"\d{4}(-\d\d(-\d\d(T\d\d(:\d\d){0,2})?)?)?")
MANY = 100
"""Sessions that are not opened faster by several processes, which take a second to start."""


@dataclass(frozen=True, repr=False)
class Catalogue:
    """Sessions of a folder and their regions with the final slopes, as recorded.

    `sessions` are the documents of ``fieldkit ls --json``. Tilt and azimuth are in degrees, None where there
    is no slope; `true_tilt_deg` is the tilt that is known. A session without slopes has one row, its region
    and the slope's state empty. Times are ISO 8601 at the site.

    Examples
    --------
    >>> sessions = fieldkit.catalogue("sandslope")
    >>> sessions
    <Catalogue of 1 session, 3 regions>
    >>> sessions.where("tilt < 10").columns()["region"]
    ['b05']
    >>> len(sessions.since("2016-01-02")), sessions.rows()[0]["session_state"]
    (0, 'sealed')
    >>> list(sessions.to_frame())[:3]
    ['session', 'session_state', 'start']
    """

    sessions: tuple[Row, ...]

    def where(self, condition: str) -> Catalogue:
        """The rows that meet a condition, such as ``tilt > 10 and state == "ok"``.

        It compares columns with numbers and texts, or with each other; a column's unit may be omitted.
        Raises `ConfigError` with the columns there are for anything else.
        """
        from fieldkit.model.row_filter import row_filter

        is_met = row_filter(condition, COLUMNS)
        rows = [(session, [row for row in _rows(session) if is_met(row)]) for session in self.sessions]
        return Catalogue(tuple({**session, "regions": _regions(met)} for session, met in rows if met))

    def since(self, date: str) -> Catalogue:
        """The sessions that began then or later: ``2026-11``, ``2026-11-03``, ``2026-11-03T12:30``.

        At the site of each. Raises `ConfigError` for anything else.
        """
        if not _DATE.fullmatch(date):
            raise ConfigError(
                "not a date", place=Argument("since", date), fix="write it as 2026-11 or 2026-11-03T12:30"
            )
        return Catalogue(tuple(session for session in self.sessions if (session.get("start") or "") >= date))

    def rows(self) -> list[Row]:
        """A row for each session and region, by the names of `COLUMNS`."""
        return [row for session in self.sessions for row in _rows(session)]

    def columns(self) -> dict[str, list[Any]]:
        """The table by column."""
        rows = self.rows()
        return {name: [row[name] for row in rows] for name in COLUMNS}

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def __len__(self) -> int:
        return len(self.sessions)

    def __repr__(self) -> str:
        regions = sum(len(session["regions"]) for session in self.sessions)
        return f"<Catalogue of {counted(len(self), 'session')}, {counted(regions, 'region')}>"


def _rows(session: Row) -> Iterator[Row]:
    about = {name: session.get(name) for name in _OF_SESSION}
    for region in session["regions"] or [{**dict.fromkeys(_OF_REGION), "region": "", "state": ""}]:
        yield {"session": session["name"], "session_state": session["state"], **about, **region}


def _regions(rows: Iterable[Row]) -> list[Row]:
    """The part of a session's rows that is about its regions."""
    return [{name: row[name] for name in _OF_REGION} for row in rows if row["region"]]


def catalogue(folder: str | Path = ".") -> Catalogue:
    """List the sessions of a campaign or folder with the slopes of their regions.

    Sessions are opened when they are new or have changed; one that cannot be read has a row as well. Links,
    folders and devices among them are skipped.

    Examples
    --------
    >>> len(fieldkit.catalogue("sandslope"))
    1
    """
    inside = recordings_in(Path(folder))
    return catalogue_of(inside, sessions_in(inside))


def catalogue_of(folder: Path, sessions: Sequence[Path], jobs: int = 1) -> Catalogue:
    """The catalogue of sessions of a folder; `jobs` processes open those that are not known, if many."""
    cache = _cache_file(folder)
    before = _read(cache)
    keys = {path: _key(path) for path in sessions}
    new = iter(_describe([path for path, key in keys.items() if key not in before], jobs))
    rows = {path: before[key] if key in before else next(new) for path, key in keys.items()}
    finished = {key: rows[path] for path, key in keys.items() if key and "problem" not in rows[path]}
    if finished != before:
        _keep(cache, finished)
    return Catalogue(tuple(rows.values()))


def _key(path: Path) -> str:
    """The identity of a finished session; empty for any other."""
    if journal_path(path).exists():
        return ""
    about = path.stat()
    return f"{path.name} {about.st_ino} {about.st_size} {about.st_mtime_ns} {about.st_ctime_ns}"


def _describe(paths: Sequence[Path], jobs: int) -> list[Row]:
    if jobs == 1 or len(paths) < MANY:
        return list(map(_row, paths))
    from fieldkit.results.executors import results, workers

    starts = range(0, len(paths), MANY // 2)
    pieces = [(start, partial(_describe, paths[start : start + MANY // 2], 1)) for start in starts]
    with workers(jobs) as executor:
        parts = dict(results(executor, pieces))
    return [row for start in starts for row in parts[start]]


def _row(path: Path) -> Row:
    if is_locked(journal_path(path)) and (status := recorder_status(path)) is not None:
        row: Row = status["brief"]
        return row
    from fieldkit.results.describe import describe_briefly

    return describe_briefly(path)


def _cache_file(folder: Path) -> Path:
    name = hashlib.sha256(f"{__version__} {folder.resolve()}".encode(errors="surrogateescape")).hexdigest()
    return platformdirs.user_cache_path("fieldkit") / "catalogues" / f"{name[:16]}.json"


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
