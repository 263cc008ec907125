"""The lab as tests see it: plug instruments in, run the program in the guest, inspect what happened."""

from __future__ import annotations

import base64
import itertools
import json
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from usblab.guest.machine import Guest
from usblab.port import UsbPort
from usblab.serial_port import Meter, SerialPort
from usblab.uvc.camera import UvcCamera

OBSERVER, STRANGER = "observer", "stranger"
PATIENCE_S = 120.0
"""A slow computer is no failure; only what hangs is ended."""


@dataclass(frozen=True)
class Ended:
    """How a program in the guest ended: exit code (negative: by that signal) and what it wrote."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON document."""
        return json.loads(self.out)


class Job:
    """A program running in the guest."""

    def __init__(self, guest: Guest, process: int) -> None:
        self._guest, self._process = guest, process

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._guest.ask("signal", process=self._process, number=int(number))

    def poll(self) -> Ended | None:
        """How it ended, or None while it runs."""
        answer = self._guest.ask("ended", process=self._process)
        return Ended(**answer) if answer else None

    def stderr(self) -> str:
        """What it has written to standard error so far."""
        text: str = self._guest.ask("stderr", process=self._process)
        return text

    def wait(self, timeout_s: float = PATIENCE_S) -> Ended:
        """Wait for its end; after `timeout_s` it is aborted, and the error tells where it was."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if (ended := self.poll()) is not None:
                return ended
            time.sleep(0.1)  # asked over the guest's channel, which is not to be full of it
        self.signal(signal.SIGABRT)
        raise TimeoutError(f"not done after {timeout_s} s: {self.wait(10)}")


class Lab:
    """A booted guest with its sockets for instruments."""

    def __init__(self, guest: Guest) -> None:
        self.guest = guest
        self._numbers = itertools.count()
        self._warm = False
        self.set_clock(None)

    def set_clock(self, utc_ns: int | None) -> None:
        """Set the guest's UTC (None: leave it), and learn how its clocks relate to this computer's."""
        begun_ns = time.monotonic_ns()
        guest_utc_ns, guest_mono_ns = self.guest.call("usblab.inside.nodes:clock", set_utc_ns=utc_ns)
        middle_ns = (begun_ns + time.monotonic_ns()) // 2
        self._utc_offset_ns = guest_utc_ns - middle_ns
        self._mono_offset_ns = guest_mono_ns - middle_ns

    def utc_ns(self, host_s: float) -> int:
        """The guest's UTC at a time of this computer's monotonic clock."""
        return round(host_s * 1e9) + self._utc_offset_ns

    def mono_ns(self) -> int:
        """The guest's monotonic clock now."""
        return time.monotonic_ns() + self._mono_offset_ns

    def idle_s(self) -> float:
        """For how long the guest's processors have had nothing to do since power-on, on average."""
        idle: float = self.guest.call("usblab.inside.nodes:idle_s")
        return idle

    def camera(self, model: UvcCamera, socket: int = 0) -> UsbPort:
        """A port to plug the camera into; a context manager."""
        return UsbPort(model, self.guest.camera_socket(socket))

    def meter(self, model: Meter, socket: int = 0) -> SerialPort:
        """A serial adapter to plug the meter into; a context manager."""
        return SerialPort(model, self.guest.serial_socket(socket))

    def nodes(self) -> Mapping[str, Mapping[str, str]]:
        """See `usblab.inside.nodes.present`."""
        found: Mapping[str, Mapping[str, str]] = self.guest.call(
            "usblab.inside.nodes:present", folders=self.guest.program.links
        )
        return found

    def wait_for(self, *paths: str, present: bool = True) -> None:
        """Wait until all these nodes of the guest are there, or gone: plugging in takes the guest a while."""
        for path in paths:
            self.guest.call("usblab.inside.nodes:wait_for", path=path, present=present)

    def wait_for_empty_sockets(self) -> None:
        """Wait until the guest has removed what was unplugged, or the next test finds its nodes."""
        self.guest.call("usblab.inside.nodes:wait_for_none")

    def put(self, path: str, content: str, user: str = OBSERVER) -> None:
        """Write a text file for a user."""
        self.guest.ask("put", path=path, content=base64.b64encode(content.encode()).decode(), user=user)

    def warm(self) -> None:
        """Import what the program needs, once; it takes the guest ten seconds or more."""
        program = self.guest.program
        if program.warm_up and not self._warm:
            self.guest.call(program.warm_up, timeout_s=300, **program.warm_up_arguments)
        self._warm = True

    def start(self, *arguments: str, user: str = OBSERVER, folder: str = "/tmp") -> Job:
        """Start a program in the guest; the one under test starts warm, see the command loop."""
        program, entry = self.guest.program, ""
        if arguments[0] == program.command:
            self.warm()
            entry = program.entry
        output = f"/tmp/job-{next(self._numbers)}"
        process = self.guest.ask(
            "start", arguments=arguments, user=user, folder=folder, output=output, entry=entry
        )
        return Job(self.guest, process)

    def run(self, *arguments: str, user: str = OBSERVER, folder: str = "/tmp") -> Ended:
        """Run a program in the guest to its end."""
        return self.start(*arguments, user=user, folder=folder).wait()
