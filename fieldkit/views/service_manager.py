"""Reports to the service manager that started this program (systemd): ready, alive, stopping, status.

The protocol is one datagram to the Unix socket that ``NOTIFY_SOCKET`` names, as sd_notify(3) describes it.
Started by hand there is none, and nothing is sent.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time

from fieldkit.model.samples import Event, EventKind, Frame, Health, Reading
from fieldkit.views import formatting
from fieldkit.views.latest import Item

EVERY_S = 1.0
"""Simulated seconds may be short; the service manager needs one report in a real one."""


def notify(*states: str) -> None:
    """Send states such as ``READY=1`` or ``STATUS=recording``; never waits, never raises."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        sender.sendto("\n".join(states).encode(), address.replace("@", "\0", 1))


def is_expected() -> bool:
    """True if a service manager started this program, or the one that started it, and awaits reports."""
    return "NOTIFY_SOCKET" in os.environ


def is_main_process() -> bool:
    """True if this process is the service itself; a child must not report that the service is stopping."""
    return os.environ.get("SYSTEMD_EXEC_PID", str(os.getpid())) == str(os.getpid())


class RecordingReports:
    """A view that feeds the service manager's watchdog from the recorder's thread.

    ``WATCHDOG=1`` follows from the health that the recorder shows once a second after storing it: a recorder
    that hangs, is stopped or waits for its disk feeds nothing. ``READY=1`` is sent with the first stored
    sample, ``STOPPING=1`` before the session is sealed, both only by the service's main process.
    """

    def __init__(self) -> None:
        self._session = ""
        self._awaits_sample = self._is_main = is_main_process()
        self._next_s = 0.0

    def show(self, item: Item) -> None:
        """Report what the item means to the service manager."""
        if isinstance(item, Health):
            self._alive(item)
        elif self._awaits_sample and isinstance(item, Frame | Reading):
            self._awaits_sample = False
            notify("READY=1", f"STATUS=recording {self._session}")
        elif isinstance(item, Event) and item.kind is EventKind.START:
            self._session = item.data.get("session", self._session)
        elif self._is_main and isinstance(item, Event) and _is_end(item):
            notify("STOPPING=1", f"STATUS=sealing {self._session}")

    def close(self) -> None:
        """Nothing to close."""

    def _alive(self, health: Health) -> None:
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + EVERY_S
        samples = sum(stream.received for stream in health.streams)
        free = formatting.size(health.disk_free_bytes)
        notify("WATCHDOG=1", f"STATUS=recording {self._session}: {samples} samples, {free} free")


def _is_end(event: Event) -> bool:
    """Whether the recording ends, and not only a session that another one follows."""
    return event.kind is EventKind.STOP and "next_session" not in event.data
