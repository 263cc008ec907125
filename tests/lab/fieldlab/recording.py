"""A recording that runs in the guest, from its start to what it left behind."""

from __future__ import annotations

import itertools
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from usblab.lab import OBSERVER, Ended, Lab
from usblab.port import UsbPort

from fieldlab.campaign import ALL, toml
from fieldlab.field import Field

_folders = itertools.count(1)


class Recording:
    """``fieldkit record`` in a campaign folder of its own, as the observer.

    What it tells while it runs, an event a line, is what tests wait for: never for a time.
    """

    def __init__(self, lab: Lab, field: Field, devices: Mapping[str, Mapping[str, object]] = ALL) -> None:
        self.lab = lab
        self.folder = f"/home/observer/campaign{next(_folders)}"
        lab.put(f"{self.folder}/fieldkit.toml", toml(field.scene, devices))
        self.job = lab.start("fieldkit", "record", folder=self.folder)

    def until(self, port: UsbPort, pictures: int) -> None:
        """Wait until a camera has sent this many more pictures."""
        self.wait(lambda goal=port.count.pictures + pictures: port.count.pictures >= goal, 0.05)

    def flows(self, stream: str = "camera") -> None:
        """Wait until a sample taken after now is stored, seen by a second reader of the live session."""
        now_ns = self.lab.mono_ns()
        self.wait(lambda: self._newest_ns(stream) > now_ns, 0.5)

    @contextmanager
    def telling(self, text: str, times: int = 1) -> Iterator[None]:
        """What happens inside makes it tell of an event that often; wait until it has."""
        goal = self.job.stderr().count(text) + times
        yield
        self.wait(lambda: self.job.stderr().count(text) >= goal, 0.1)

    def wait(self, done: Callable[[], bool], every_s: float, timeout_s: float = 120.0) -> None:
        """Wait for something while the recording runs; what asks the guest should do so seldom."""
        deadline = time.monotonic() + timeout_s
        look = time.monotonic() + 2.0
        while not done():
            time.sleep(every_s)  # the guest answers what it is asked and sends nothing by itself
            if time.monotonic() > look:
                look += 2.0
                ended = self.job.poll()
                assert ended is None, f"the recording ended by itself: {ended}"
            if time.monotonic() > deadline:
                blocked = self.lab.guest.call("usblab.inside.nodes:blocked")
                self.job.signal(signal.SIGABRT)
                raise TimeoutError(f"waited {timeout_s} s in vain: {blocked=} {self.job.wait(10)}")

    def stop(self) -> dict[str, Any]:
        """Stop it as Ctrl-C does, see that it sealed a session, and look at that."""
        self.job.signal(signal.SIGINT)
        ended = self.job.wait()
        assert ended.code == 0, ended
        sealed = re.search(r"^sealed (\S+)", ended.err, re.MULTILINE)
        assert sealed is not None, ended
        return self.look(sealed[1])

    def look(self, session: str) -> dict[str, Any]:
        """The session's contents, see `inside_guest.session.summary`."""
        self.session = session if session.startswith("/") else f"{self.folder}/{session}"
        found: dict[str, Any] = self.lab.guest.call("inside_guest.session:summary", path=self.session)
        return found

    def fieldkit(self, *arguments: str) -> Ended:
        """Another command in the same campaign folder."""
        return self.lab.run("fieldkit", *arguments, folder=self.folder, user=OBSERVER)

    def remove(self) -> None:
        """Delete the campaign: the guest's disk is memory."""
        self.lab.run("rm", "-rf", self.folder, user="root")

    def _newest_ns(self, stream: str) -> int:
        newest: int = self.lab.guest.call("inside_guest.session:newest_ns", folder=self.folder, stream=stream)
        return newest


def events(session: Mapping[str, Any], kind: str, stream: str = "") -> list[str]:
    """The texts of a session's events of a kind, of one stream if it is named."""
    found = [
        event for event in session["events"] if event["kind"] == kind and stream in ("", event["stream"])
    ]
    return [event["text"] for event in found]
