"""Marks: what somebody notes while a recording runs, dropped as small files for the recorder.

``fieldkit mark`` writes one JSON file per mark beside the journal; the recorder looks there
each second and turns each file into an event. A mark's time is absolute (ISO 8601) or in
seconds before now: "now" is the recording's, which need not be the wall's when the field is
simulated.
"""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path

from fieldkit.model.clock import Clock
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.entry_rows import event_fits

_LATEST_NS = 2**63 - 1
TEN_YEARS_S = 10 * 365.25 * 86_400
When = float | str
"""Seconds before now (zero or negative), or an ISO 8601 time with its zone."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A note on the recording: at one time, or from `at` to `to`; `label` is one word to sort by."""

    text: str
    label: str = ""
    at: When = 0.0
    to: When | None = None


def marks_folder(session: Path) -> Path:
    """Where the marks of a session that is being recorded are dropped."""
    return session.with_name(session.name + ".journal") / "marks"


def drop_mark(folder: Path, mark: Mark) -> Path:
    """Write a mark so that it is there as a whole or not at all.

    Raises `ConfigError` for one that is too long to be kept whole, and `OSError`; without the folder nobody
    takes marks any more.
    """
    if not event_fits(Event(EventKind.MARK, 0, 0, mark.text, data=_details(mark, _LATEST_NS))):
        size = len(f"{mark.text}{mark.label}".encode())
        fix = "make two of it, and its kind one short word"
        raise ConfigError(f"the mark is too long to be kept whole: {size} bytes", fix=fix)
    name = uuid.uuid4().hex
    draft, final = folder / f".{name}", folder / f"{name}.json"
    draft.write_text(json.dumps(asdict(mark), ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(draft, final)
    return final


@dataclass
class MarkInbox:
    """Takes the marks dropped for a recording, once each, oldest first.

    The file of a mark is removed when the next one is asked for: who cannot store one stops there, and it
    comes again. The folder is there from the start to `close`, so that nobody can drop a mark that nobody
    would take.
    """

    folder: Path
    clock: Clock
    _taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        with suppress(OSError):  # without marks a recording is still a recording
            self.folder.mkdir(exist_ok=True)

    def __call__(self) -> Iterator[Event]:
        """Events for the marks dropped since the last call.

        A file that is no mark becomes a warning, because a note must not vanish without a word. A folder that
        cannot be read just now is looked at again.
        """
        try:
            files = _oldest_first(self.folder)
        except StorageError:
            files = []
        yield from self._take(files)

    def _take(self, files: Iterable[Path]) -> Iterator[Event]:
        for file in files:
            if file.name not in self._taken:
                now = self.clock.mono_ns()
                yield _read(file, now, self.clock.to_utc_ns(now))
                self._taken.add(file.name)
                with suppress(OSError):  # a folder of somebody else's, as after sudo
                    file.unlink()

    def close(self) -> Iterator[Event]:
        """Events for the last marks; one that comes later finds no folder.

        Raises `StorageError` where they cannot be read: there is no further look, and sealing removes them.
        """
        with suppress(OSError):
            self.folder = self.folder.rename(_closed(self.folder))
        return self._take(_oldest_first(self.folder))


def left_marks(folder: Path) -> list[Event]:
    """Events for the marks that a recording ended too early to take; their files stay.

    "Now" is when each was dropped, by the computer's own time; `mono_ns` is not known. Raises `StorageError`.
    """
    files = [*_oldest_first(_closed(folder)), *_oldest_first(folder)]
    return [replace(_read(file, 0, file.stat().st_mtime_ns), mono_ns=0) for file in files]


def _closed(folder: Path) -> Path:
    """What the folder is called when no more marks are taken."""
    return folder.with_name(f"{folder.name}-closed")


def _oldest_first(folder: Path) -> list[Path]:
    try:
        return sorted(folder.glob("*.json"), key=lambda file: file.stat().st_mtime_ns)
    except OSError as error:
        raise StorageError(
            f"the marks in {folder} cannot be read: {error.strerror or error}",
            fix="see that the disk answers, then: fieldkit recover",
        ) from error


def _read(file: Path, now_mono_ns: int, now_ns: int) -> Event:
    text = file.name
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
        return _event(Mark(**json.loads(text)), now_mono_ns, now_ns)
    except (OSError, ValueError, TypeError) as error:
        said = f"a mark could not be read ({error}): {text.strip()}"
        return Event(EventKind.MARK, now_mono_ns, now_ns, said, severity=Severity.WARNING)


def _event(mark: Mark, now_mono_ns: int, now_ns: int) -> Event:
    start_ns = _time_ns(mark.at, now_ns)
    data = _details(mark, now_ns if mark.to is None else _time_ns(mark.to, now_ns))
    return Event(EventKind.MARK, now_mono_ns - (now_ns - start_ns), start_ns, mark.text, data=data)


def _details(mark: Mark, end_ns: int) -> dict[str, str | int]:
    """What an event keeps of a mark besides its text; the end of one that lasted."""
    label: dict[str, str | int] = {"label": mark.label} if mark.label else {}
    return label if mark.to is None else {**label, "end_ns": end_ns}


def _time_ns(when: When, now_ns: int) -> int:
    if isinstance(when, int | float):
        _check_near(when, when)
        return now_ns + round(when * SECOND_NS)
    moment = datetime.fromisoformat(when)
    if moment.tzinfo is None:
        raise ValueError(f"{when!r} has no time zone")
    _check_near(when, moment.timestamp() - now_ns / SECOND_NS)
    return round(moment.timestamp() * 1e6) * 1000


def _check_near(when: When, away_s: float) -> None:
    """Raise `ConfigError` for a mistyped year: no recording is ten years long."""
    if not abs(away_s) <= TEN_YEARS_S:  # nor is what is no number
        raise ConfigError(
            f"{when!r} is more than ten years away", fix="give the time again: fieldkit mark --at"
        )
