"""Requests to the recorder while it records: small files in its inbox, each answered by an event.

A request is one JSON file beside the journal, named by its id: a mark, new regions, a shutter correction, the
acknowledgement of an alarm. Once a second the recorder takes them in order and carries them out
(`fieldkit.recording.request_reader`). Sending one imports neither numpy nor the configuration.
"""

from __future__ import annotations

import json
import time
import uuid
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError, RefusedError, StorageError
from fieldkit.model.marks import Mark, mark_details
from fieldkit.model.next_step import Argument
from fieldkit.phrases import Words
from fieldkit.recording.running import running_session
from fieldkit.sessions.lock import is_locked, journal_path

STARTED_WITHIN_S = 10.0
"""How long a recording that has begun may take until it accepts requests."""
_LATEST_NS = 2**63 - 1
_SHORT_BYTES = 300
"""A mark of this size as JSON fits into an event with its id and times, whatever it says."""


class Request(Protocol):
    """A dataclass that asks the recorder for something, and the name of its kind: `Mark`, `Shutter` ..."""

    do: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Shutter:
    """A shutter correction of the camera, now."""

    do: ClassVar[str] = "shutter"


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """The alarm of that id was seen."""

    alarm: str
    do: ClassVar[str] = "acknowledge"


def inbox(session: Path) -> Path:
    """The folder in which the recorder of a session looks for requests."""
    return journal_path(session) / "marks"


def closed_inbox(folder: Path) -> Path:
    """The folder's name once no more requests are accepted."""
    return folder.with_name(f"{folder.name}-closed")


def send(folder: Path, request: Request) -> str:
    """Write a request into an inbox atomically; its id.

    Raises `ConfigError` if it is too long to be stored whole, and `OSError` if it cannot be written: without
    the folder the recording no longer accepts requests.
    """
    number = uuid.uuid4().hex
    _check_length(request, number)
    with replacing(folder / f"{number}.json", synced=False) as draft:
        body = {"do": request.do, **asdict(request)}
        # an outline is the model that a campaign's file has too, and no dataclass
        text = json.dumps(body, ensure_ascii=False, default=lambda outline: outline.model_dump())
        draft.write_text(text + "\n", encoding="utf-8")
    return number


def _check_length(request: Request, number: str) -> None:
    if not isinstance(request, Mark) or len(json.dumps(asdict(request))) <= _SHORT_BYTES:
        return
    from fieldkit.model.samples import Event, EventKind
    from fieldkit.sessions.entry_rows import event_fits

    data = {**mark_details(request, _LATEST_NS, _LATEST_NS), "request": number}
    if not event_fits(Event(EventKind.MARK, 0, 0, request.text, data=data)):
        size = len(f"{request.text}{request.label}".encode())
        what, fix = Words("error.mark_too_long", size=size), Words("fix.split")
        raise ConfigError(what, place=Argument("text"), fix=fix)


@dataclass(frozen=True, slots=True)
class SentRequest:
    """A request on its way: the session, and the id that the event that answers will carry.

    `unused` are the changed keys of regions that the recording does not use, such as ``b15: offset_k``.
    """

    session: Path
    id: str
    unused: tuple[str, ...] = ()


def send_to_recorder(recordings: Path, request: Request) -> SentRequest:
    """Send a request to the recording that runs in a campaign's folder of recordings.

    Raises `RefusedError` if none is running or it has just ended, `StorageError` if the request cannot be
    written, `ConfigError` if a mark is too long.
    """
    session = running_session(recordings)
    await_inbox(session)
    try:
        return SentRequest(session, send(inbox(session), request))
    except FileNotFoundError:
        if running_session(recordings) != session:  # the next one of a recording that is split
            return send_to_recorder(recordings, request)
        problem, fix = Words("error.too_late"), Words("fix.beside", session=session.name)
        raise RefusedError(problem, place=session.name, fix=fix) from None
    except OSError as error:
        raise StorageError(
            f"the request could not be written beside it: {error.strerror}", place=session
        ) from error


def await_inbox(session: Path) -> None:
    """Wait until a recording that has just begun accepts requests, unless it has ended."""
    folder, deadline = inbox(session), time.monotonic() + STARTED_WITHIN_S
    while not (folder.exists() or closed_inbox(folder).exists() or time.monotonic() > deadline):
        if not is_locked(journal_path(session)):
            return
        time.sleep(0.05)
