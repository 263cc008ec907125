"""The recorder's end of requests: files in its inbox, each answered by an event.

The inbox is read once a second. The event of the session that answers has ``data["request"]``, the id, and
says what was done, or why it was not.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fieldkit.config.toml_schema import RegionOutline
from fieldkit.model.clock import Clock
from fieldkit.model.errors import StorageError, message_of, os_errors_as
from fieldkit.model.marks import Mark, mark_event
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.site import RegionRecord
from fieldkit.recorder import ShutterRequest
from fieldkit.recording.redrawing import NewRegions, Redrawing
from fieldkit.recording.requests import Acknowledgement, Request, Shutter, closed_inbox, inbox
from fieldkit.sessions.json_forms import build
from fieldkit.sessions.recovery import RecoveryReport, recover

log: logging.Logger = logging.getLogger(__name__)
_KINDS: dict[str, type[Request]] = {kind.do: kind for kind in (Mark, NewRegions, Shutter, Acknowledgement)}


@dataclass
class RequestReader:
    """Yields what the recorder is to do for the requests in its inbox, once each, oldest first.

    Events are to be stored, changes of regions stored and followed, shutters run. A request's file is removed
    when the next one is asked for: a caller that cannot store something stops there and receives it again.
    The folder exists only until `close`, so that no request is sent that would not be read.
    `redrawing` knows the regions, None where they cannot change.
    """

    folder: Path
    clock: Clock
    redrawing: Redrawing | None = None
    _taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        with suppress(OSError):  # a recording without requests is better than none
            self.folder.mkdir(exist_ok=True)

    def __call__(self) -> Iterator[Event | RegionRecord | ShutterRequest]:
        """Tasks from the requests sent since the last call.

        An invalid file becomes a warning with its text, so that no note is lost. A folder that cannot be read
        is tried again at the next call.
        """
        try:
            files = _oldest_first(self.folder)
        except StorageError:
            files = []
        yield from self._take(files)

    def _take(self, files: Iterable[Path]) -> Iterator[Event | RegionRecord | ShutterRequest]:
        for file in files:
            if file.name not in self._taken:
                yield from self._carry_out(file)
                self._taken.add(file.name)
                with suppress(OSError):  # a folder owned by another user, as after sudo
                    file.unlink()

    def _carry_out(self, file: Path) -> Iterator[Event | RegionRecord | ShutterRequest]:
        mono_ns = self.clock.mono_ns()
        now = mono_ns, self.clock.to_utc_ns(mono_ns)
        request = _read(file, *now)
        if isinstance(request, Shutter):
            yield ShutterRequest(file.stem)
        elif isinstance(request, NewRegions) and self.redrawing is not None:
            regions = [outline.region for outline in request.regions]
            yield from self.redrawing.carry_out(regions, file.stem, *now)
        else:
            yield _answer(request, file.stem, *now)

    def close(self) -> Iterator[Event | RegionRecord | ShutterRequest]:
        """Tasks from the last requests; a later one finds no folder.

        Raises `StorageError` if they cannot be read: this is the last attempt, and sealing removes them.
        """
        with suppress(OSError):
            self.folder.rename(closed_inbox(self.folder))
        return self._take([*_oldest_first(closed_inbox(self.folder)), *_oldest_first(self.folder)])


def recover_session(path: Path) -> RecoveryReport:
    """Finish an interrupted session from its journal, with the requests that were left for it.

    May be interrupted and run again; a finished session is not changed. Raises `SessionError`,
    `StorageError`, or `RefusedError` while the session is being written.
    """
    return recover(path, left_requests(inbox(path)))


def left_requests(folder: Path) -> list[Event]:
    """Events for requests that an interrupted recording did not read; their files stay.

    "Now" is the time at which each was sent, by the computer's clock; `mono_ns` is unknown. Only marks and
    acknowledgements can still be kept. Raises `StorageError`.
    """
    files = [*_oldest_first(closed_inbox(folder)), *_oldest_first(folder)]
    sent_ns = {file: file.stat().st_mtime_ns for file in files}
    events = [_answer(_read(file, 0, sent_ns[file]), file.stem, 0, sent_ns[file]) for file in files]
    return [replace(event, mono_ns=0) for event in events]


def _answer(request: Request | Event, number: str, mono_ns: int, time_ns: int) -> Event:
    """The event that answers a request which needs nothing but to be kept."""
    match request:
        case Event():
            event = request
        case Acknowledgement():
            data = {"acknowledge": request.alarm}
            event = Event(EventKind.MARK, mono_ns, time_ns, f"acknowledged: {request.alarm}", data=data)
        case _:
            text = f"the recording ended before this was done: {request.do}"
            kind = EventKind.REGION if isinstance(request, NewRegions) else EventKind.SHUTTER
            event = Event(kind, mono_ns, time_ns, text, severity=Severity.WARNING)
    return replace(event, data={**event.data, "request": number})


_UNREADABLE = "check that the disk is accessible, then: " + Action.RECOVER()


def _oldest_first(folder: Path) -> list[Path]:
    with os_errors_as(StorageError, "the marks cannot be read", place=folder, fix=_UNREADABLE):
        try:
            names = os.listdir(folder)
        except FileNotFoundError:
            return []
        files = [folder / name for name in names if name.endswith(".json")]
        return sorted(files, key=lambda file: file.stat().st_mtime_ns)


def _read(file: Path, mono_ns: int, time_ns: int) -> Request | Event:
    """A request; of a mark, and of a file that is none, already the event."""
    text = file.name
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
        request = _request(json.loads(text))
        if not isinstance(request, Mark):
            return request
        text = f"{request.text} (at {request.at}" + (")" if request.to is None else f" to {request.to})")
        return mark_event(request, mono_ns, time_ns)
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        text = f"a request could not be read ({message_of(error)}): {text.strip()}"
        return Event(EventKind.MARK, mono_ns, time_ns, text, severity=Severity.WARNING)


def _request(body: Any) -> Request:
    fields = dict(body)
    kind = _KINDS[fields.pop("do")]
    if kind is NewRegions:
        return NewRegions(tuple(map(RegionOutline.model_validate, fields["regions"])))
    return Mark(**fields) if kind is Mark else build(kind, fields)
