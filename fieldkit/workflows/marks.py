"""Marks: notes made while a recording runs, passed to the recorder as small files.

``fieldkit mark`` writes one JSON file per mark beside the journal; once a second the recorder turns each file
into an event. A mark's time is absolute (ISO 8601) or in seconds before now, where "now" is the time of the
recording, which differs from the wall clock in a simulated field.

A mark "shade-test b15", or "shade-test b15 end", tells the estimator that a board shades the region b15.
"""

from __future__ import annotations

import json
import re
import uuid
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path

from fieldkit.disk import replacing
from fieldkit.model.clock import Clock
from fieldkit.model.errors import ConfigError, StorageError, message_of
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.entry_rows import event_fits

_LATEST_NS = 2**63 - 1
_SHADE_TEST = re.compile(r"shade[ -]test (?:of )?(?P<region>.+?)(?: (?P<phase>begin|end))?", re.IGNORECASE)
TEN_YEARS_S = 10 * 365.25 * 86_400
When = float | str
"""Seconds before now (zero or negative), or an ISO 8601 time with its zone."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A note on the recording at one time, or from `at` to `to`; `label` is one word to group by."""

    text: str
    label: str = ""
    at: When = 0.0
    to: When | None = None


def marks_folder(session: Path) -> Path:
    """The folder in which the recorder of a session looks for marks."""
    return session.with_name(session.name + ".journal") / "marks"


def drop_mark(folder: Path, mark: Mark) -> Path:
    """Write a mark atomically.

    Raises `ConfigError` if it is too long to be stored whole, and `OSError` if it cannot be written: without
    the folder the recording no longer accepts marks.
    """
    if not event_fits(Event(EventKind.MARK, 0, 0, mark.text, data=_details(mark, _LATEST_NS, _LATEST_NS))):
        size = len(f"{mark.text}{mark.label}".encode())
        fix = "split it in two, and use one short word as its kind"
        raise ConfigError(f"the mark is too long to be stored whole: {size} bytes", fix=fix)
    name = uuid.uuid4().hex
    path = folder / f"{name}.json"
    with replacing(path, synced=False) as draft:
        draft.write_text(json.dumps(asdict(mark), ensure_ascii=False) + "\n", encoding="utf-8")
    return path


@dataclass
class MarkReader:
    """Yields the marks dropped for a recording, once each, oldest first.

    A mark's file is removed when the next mark is requested: a caller that cannot store a mark stops there
    and receives it again. The folder exists only until `close`, so that no mark is dropped that would not
    be read.
    """

    folder: Path
    clock: Clock
    _taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        with suppress(OSError):  # a recording without marks is better than none
            self.folder.mkdir(exist_ok=True)

    def __call__(self) -> Iterator[Event]:
        """Events for the marks dropped since the last call.

        An invalid file becomes a warning with its text, so that no note is lost. A folder that cannot be read
        is tried again at the next call.
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
                with suppress(OSError):  # a folder owned by another user, as after sudo
                    file.unlink()

    def close(self) -> Iterator[Event]:
        """Events for the last marks; a later mark finds no folder.

        Raises `StorageError` if they cannot be read: this is the last attempt, and sealing removes them.
        """
        with suppress(OSError):
            self.folder = self.folder.rename(_closed(self.folder))
        return self._take(_oldest_first(self.folder))


def left_marks(folder: Path) -> list[Event]:
    """Events for marks that an interrupted recording did not read; their files stay.

    "Now" is the time at which each was dropped, by the computer's clock; `mono_ns` is unknown. Raises
    `StorageError`.
    """
    files = [*_oldest_first(_closed(folder)), *_oldest_first(folder)]
    return [replace(_read(file, 0, file.stat().st_mtime_ns), mono_ns=0) for file in files]


def _closed(folder: Path) -> Path:
    """The folder's name once no more marks are accepted."""
    return folder.with_name(f"{folder.name}-closed")


def _oldest_first(folder: Path) -> list[Path]:
    try:
        return sorted(folder.glob("*.json"), key=lambda file: file.stat().st_mtime_ns)
    except OSError as error:
        raise StorageError(
            f"the marks in {folder} cannot be read: {error.strerror or error}",
            fix="check that the disk is accessible, then: fieldkit recover",
        ) from error


def _read(file: Path, now_mono_ns: int, now_ns: int) -> Event:
    text = file.name
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
        return _event(Mark(**json.loads(text)), now_mono_ns, now_ns)
    except (OSError, ValueError, TypeError) as error:
        text = f"a mark could not be read ({message_of(error)}): {text.strip()}"
        return Event(EventKind.MARK, now_mono_ns, now_ns, text, severity=Severity.WARNING)


def _event(mark: Mark, now_mono_ns: int, now_ns: int) -> Event:
    start_ns = _time_ns(mark.at, now_ns)
    data = _details(mark, now_ns if mark.to is None else _time_ns(mark.to, now_ns), now_ns)
    return Event(EventKind.MARK, now_mono_ns - (now_ns - start_ns), start_ns, mark.text, data=data)


def shade_test(text: str) -> tuple[str, str] | None:
    """Region and phase, "begin" or "end", of a mark about a shade test; None for any other text."""
    found = _SHADE_TEST.fullmatch(text.strip())
    return None if found is None else (found["region"], found["phase"] or "begin")


def _details(mark: Mark, end_ns: int, noted_ns: int) -> dict[str, str | int]:
    """What an event keeps of a mark besides its text: its label, a span's end, what it says of shade."""
    label: dict[str, str | int] = {"label": mark.label} if mark.label else {}
    span = label if mark.to is None else {**label, "end_ns": end_ns}
    if (test := shade_test(mark.text)) is None:
        return span
    phase = {"phase": test[1]} if mark.to is None else {}
    # when it was noted: live estimates did not know it earlier, so later ones must not either
    return {**span, "shade_test": test[0], "noted_ns": noted_ns, **phase}


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
    if not abs(away_s) <= TEN_YEARS_S:  # NaN is rejected too
        raise ConfigError(
            f"{when!r} is more than ten years away", fix="give the time again: fieldkit mark --at"
        )
