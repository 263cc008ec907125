"""The running recording of a campaign, one at a time: which session, whether it responds; stop, requests.

Nothing here opens the session: another process is writing it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta, tzinfo
from datetime import time as time_of_day
from pathlib import Path
from typing import TypeVar

from fieldkit.config import Config, read_config
from fieldkit.config.edit import restoring
from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import ConfigError, RefusedError, SessionError, StorageError
from fieldkit.model.site import Site
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.lock import SessionLock, is_locked, owner
from fieldkit.views import formatting
from fieldkit.workflows.marks import Mark, When, shade_test
from fieldkit.workflows.recordings import is_interrupted
from fieldkit.workflows.regions import check_configured, read_regions
from fieldkit.workflows.requests import Acknowledgement, NewRegions, Request, Shutter, inbox, send

LOCK_NAME = ".recording"
"""File in ``recordings/`` that the recorder of a campaign holds locked, so that there is only one."""
PREVIEW_LOCK_NAME = ".preview"
"""File in ``recordings/`` that a preview holds locked while it has the instruments open."""
PREVIEW_ENDS_WITHIN_S = 10.0
SILENT_AFTER_S = 5.0
"""A recorder writes its state every second; a slow disk may hold up some of them."""
SEALED_WITHIN_S = 60.0
CLOCKS_DIFFER = timedelta(minutes=5)
"""A clock time up to this far ahead means now, by a watch that is fast; beyond, it means yesterday."""
YEAR_S = 365.25 * 86_400.0
FAR_S, FAR_IN_SIMULATION_S = 10.0 * YEAR_S, 100.0 * YEAR_S
"""A mark further from now is a typing error; a simulated day may lie decades back."""
T = TypeVar("T")
log: logging.Logger = logging.getLogger(__name__)


def running_session(config: Config) -> Path:
    """The session that is being recorded in a campaign; raises `RefusedError` if there is none."""
    path = session_in_progress(config.recordings)
    if path is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    return path


def session_in_progress(recordings: Path) -> Path | None:
    """The session that a living process is writing, or None; an interrupted one is not in progress."""
    for journal in sorted(recordings.glob("*.h5.journal")):
        if is_locked(journal):
            return journal.with_name(journal.name.removesuffix(".journal"))
    return None


@contextmanager
def only_recorder(recordings: Path) -> Iterator[None]:
    """Be the one process that records in this campaign, from before its instruments are opened.

    Raises `RefusedError` while another one is, `StorageError` if the folder cannot be written.
    """
    _refuse_second(recordings)  # a recorder of an earlier version holds only its session's lock
    try:
        recordings.mkdir(parents=True, exist_ok=True)
        lock = SessionLock(recordings, LOCK_NAME)
    except RefusedError as error:
        _refuse_second(recordings)  # by the name of its session, once it has one
        raise _already_recorded(error.message) from error
    except OSError as error:
        raise StorageError(
            f"cannot record into {recordings}: {error.strerror}", fix="choose a folder that can be written"
        ) from error
    try:
        yield
    finally:
        lock.release()


def is_recorder_present(recordings: Path) -> bool:
    """Whether a process records in this campaign, or opens its instruments in order to."""
    return is_locked(recordings, LOCK_NAME) or session_in_progress(recordings) is not None


@contextmanager
def previewing(recordings: Path) -> Iterator[None]:
    """Hold the instruments for a preview that ends as soon as a recorder is present.

    Raises `RefusedError` while another preview holds them, `OSError` if the folder cannot be written.
    """
    recordings.mkdir(parents=True, exist_ok=True)
    lock = SessionLock(recordings, PREVIEW_LOCK_NAME)
    try:
        yield
    finally:
        lock.release()


def await_preview_end(recordings: Path) -> None:
    """Wait until a preview has released the instruments, at most ten seconds; call as `only_recorder`."""
    deadline = time.monotonic() + PREVIEW_ENDS_WITHIN_S
    while is_locked(recordings, PREVIEW_LOCK_NAME) and time.monotonic() < deadline:
        time.sleep(0.05)


def _refuse_second(recordings: Path) -> None:
    if (running := session_in_progress(recordings)) is not None:
        raise _already_recorded(running.name)


def _already_recorded(what: str) -> RefusedError:
    return RefusedError(
        f"this campaign is being recorded already: {what}",
        fix="fieldkit status shows it, fieldkit stop ends it",
    )


@dataclass(frozen=True, slots=True)
class UnresponsiveRecorder:
    """A recorder that holds its session and writes nothing: since when (UTC), and whether it was stopped."""

    pid: int | None
    since_ns: int
    is_stopped: bool

    def at(self, site: Site) -> str:
        """In words, with the time at the site and what to do."""
        zone = formatting.zone_name(self.since_ns, site)
        since = f"since {formatting.clock_time(self.since_ns, site, seconds=True)} {zone}"
        if self.is_stopped:
            remedy = f"it was stopped (Ctrl-Z); kill -CONT {self.pid} continues it"
            return f"process {self.pid} does not respond {since}: {remedy}"
        return f"process {self.pid} has written nothing {since}: it is sealing, its disk is slow, or it hangs"


def unresponsive_recorder(session: Path) -> UnresponsiveRecorder | None:
    """Whether the recorder of a session in progress does not respond; None where it does, or has ended."""
    pid = owner(journal_path(session))
    if pid is None:
        return None
    since_ns, is_stopped = _last_write_ns(session), _is_stopped(pid)
    if not is_stopped and time.time() - since_ns / 1e9 < SILENT_AFTER_S:
        return None
    return UnresponsiveRecorder(pid, since_ns, is_stopped)


def _last_write_ns(session: Path) -> int:
    written = [0]
    for file in (session, *journal_path(session).glob("*")):
        with contextlib.suppress(OSError):  # a part of the journal that has just been retired
            written.append(file.stat().st_mtime_ns)
    return max(written)


def _is_stopped(pid: int) -> bool:
    """Whether the kernel has stopped a process, as by Ctrl-Z; false without ``/proc``."""
    try:
        about = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return about.rpartition(")")[2].split()[0] in ("T", "t")


def stop_recording(config: Config, notify: Callable[[str], None] = log.warning) -> Path:
    """Ask the running recording to stop and seal, and wait for it; the sealed session.

    A recorder suspended by Ctrl-Z is continued, so that it can seal; `notify` receives a warning if it does
    not respond. Raises `RefusedError` if none is running or it takes more than a minute, `SessionError`
    if it ended without sealing.
    """
    path = running_session(config)
    pid = owner(journal_path(path))
    if pid is None:  # it has ended since
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    os.kill(pid, signal.SIGTERM)
    deadline, is_reported = time.monotonic() + SEALED_WITHIN_S, False
    while is_locked(journal_path(path)):
        if not is_reported and (silent := unresponsive_recorder(path)) is not None:
            is_reported = True
            notify(silent.at(config.site))
            _continue(silent, pid, notify)
        if time.monotonic() > deadline:
            raise RefusedError(
                f"process {pid} has not sealed {path.name} within a minute", fix="look at its terminal"
            )
        time.sleep(0.1)
    if is_interrupted(path):
        raise SessionError(
            f"the recording ended without sealing {path.name}; its journal is kept",
            fix=f"fieldkit recover {shlex.quote(str(path))}",
        )
    return path


def _continue(silent: UnresponsiveRecorder, pid: int, notify: Callable[[str], None]) -> None:
    if silent.is_stopped:
        notify("the recorder was suspended; continuing it, so that it can seal")
        os.kill(pid, signal.SIGCONT)


# --- requests to the running recording; an event of its session answers each


def add_mark(config: Config, mark: Mark) -> Path:
    """Add a note to the running recording; its session. Raises as `sent`."""
    return sent(config, mark).session


def request_shutter(config: Config) -> SentRequest:
    """Ask for a shutter correction of the camera now. Raises as `sent`."""
    return sent(config, Shutter())


def acknowledge(config: Config, alarm: str) -> SentRequest:
    """Acknowledge the alarm of that id. Raises as `sent`."""
    return sent(config, Acknowledgement(alarm))


def change_regions(file: Path, change: Callable[[Path], T]) -> tuple[T, SentRequest | None]:
    """Change the regions of a ``fieldkit.toml``, and those of its campaign's recording if one is running.

    Estimates of the running session use the new regions from the next full minute on.

    Parameters
    ----------
    file
        The campaign's ``fieldkit.toml``.
    change
        What `fieldkit.workflows.regions` does to the file:
        ``partial(add_region, name="b15", rect=(60, 60, 30, 30))``, or `edit_region`, or `remove_region`.

    Returns
    -------
    tuple
        What `change` returned, and the request to the recording; None where nothing is being recorded.

    Raises
    ------
    ConfigError
        The regions would be invalid, or the recording could not use them; nothing is changed then.
    RefusedError, StorageError
        As `sent`; the file is changed then, and the recording is not.
    """
    config, _ = read_config(file)
    if config is None or session_in_progress(config.recordings) is None:
        return change(file), None
    with restoring(file):
        made = change(file)
        changed = read_regions(file)[0]
        check_configured(changed, unless=config)
    return made, sent(config, NewRegions(changed.regions))


@dataclass(frozen=True, slots=True)
class SentRequest:
    """A request on its way: the session, and the id that the event that answers will carry."""

    session: Path
    id: str


def sent(config: Config, request: Request) -> SentRequest:
    """Send a request to the running recording.

    Raises `RefusedError` if none is running or it has just ended, `StorageError` if the request cannot be
    written, `ConfigError` if a mark is too long.
    """
    session = running_session(config)
    try:
        return SentRequest(session, send(inbox(session), request))
    except FileNotFoundError:
        what = "mark" if isinstance(request, Mark) else "request"
        raise RefusedError(
            f"{session.name} has just ended and is being sealed: the {what} comes too late",
            fix=f"write it down beside {session.name}",
        ) from None
    except OSError as error:
        raise StorageError(f"the request could not be written beside {session}: {error.strerror}") from error


def mark_of(config: Config, text: str, *, kind: str = "", at: str = "-0s", to: str | None = None) -> Mark:
    """A note with its time, or interval, as people write them: ``-30s``, ``12:31`` at the site, ISO 8601.

    Raises `ConfigError` for a time that cannot be read, that is years away, or an end before its start, and
    for a shade test of an unknown region.
    """
    _reject_unknown_region(config, text)
    zone = formatting.zone(config.site)
    now = datetime.now(zone)
    mark = Mark(text, kind, parse_when(at, zone, now), parse_when(to, zone, now) if to else None)
    reject_impossible(mark, now, FAR_IN_SIMULATION_S if config.simulation else FAR_S)
    return mark


def _reject_unknown_region(config: Config, text: str) -> None:
    names = [region.name for region in config.regions]
    if (test := shade_test(text)) is not None and test[0] not in names:
        raise ConfigError(
            f"no region is called {test[0]!r}", fix=f"shade-test and one of {', '.join(names) or 'none'}"
        )


def parse_when(text: str, zone: tzinfo, now: datetime) -> When:
    """Seconds before `now` from ``-30s``, ``-5m``, ``-1h``; else a time as ISO 8601, by default in `zone`.

    ``12:31`` is the last time that clocks showed it. Raises `ConfigError` for anything else.
    """
    try:
        if text.startswith("-"):
            return -parse_duration(text[1:])
        if ":" in text[:3]:
            return _last(time_of_day.fromisoformat(text), zone, now).isoformat()
        moment = datetime.fromisoformat(text)
    except ValueError:  # also a `ConfigError`
        raise ConfigError(
            f"{text!r} is not a valid time; use -30s, 12:31 or 2026-12-11T12:31+09:00"
        ) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=zone)).isoformat()


def _last(shown: time_of_day, zone: tzinfo, now: datetime) -> datetime:
    """When clocks last showed a time, in its own zone if it has one."""
    own_zone = shown.tzinfo or zone
    latest = (now + CLOCKS_DIFFER).timestamp()
    day = now.astimezone(own_zone).date()
    moments = [datetime.combine(day + timedelta(days), shown, own_zone) for days in (1, 0, -1)]
    return next(moment for moment in moments if moment.timestamp() <= latest)


def reject_impossible(mark: Mark, now: datetime, far_s: float) -> None:
    """Raise `ConfigError` for a time further than `far_s` from now, or an end before its start."""
    ends = [mark.at] if mark.to is None else [mark.at, mark.to]
    after_s = [_after_s(end, now) for end in ends]
    for end, seconds in zip(ends, after_s, strict=True):
        if abs(seconds) > far_s:
            shown = f"{seconds:g} s" if isinstance(end, float) else end
            raise ConfigError(f"{shown} is more than {far_s / YEAR_S:.0f} years from now; correct the time")
    if after_s[-1] < after_s[0]:
        raise ConfigError("the end lies before the start; give the earlier time to --from")


def _after_s(when: When, now: datetime) -> float:
    return datetime.fromisoformat(when).timestamp() - now.timestamp() if isinstance(when, str) else when
