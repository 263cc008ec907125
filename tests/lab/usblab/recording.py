"""A recording that runs in the guest, from its start to what it left behind."""

from __future__ import annotations

import itertools
import json
import signal
import time
from collections.abc import Callable, Mapping
from typing import Any

from usblab.campaign import ALL, toml
from usblab.field import Field
from usblab.lab import OBSERVER, Ended, Lab
from usblab.port import UsbPort

_folders = itertools.count(1)


class Recording:
    """``fieldkit record`` in a campaign folder of its own, as the observer.

    `prepare` is called just before it starts.
    """

    def __init__(
        self,
        lab: Lab,
        field: Field,
        devices: Mapping[str, Mapping[str, object]] = ALL,
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        self.lab = lab
        self.folder = f"/home/observer/campaign{next(_folders)}"
        lab.put(f"{self.folder}/fieldkit.toml", toml(field.scene, devices))
        prepare()
        self.job = lab.start("fieldkit", "record", "--json", folder=self.folder)

    def until(self, port: UsbPort, pictures: int, timeout_s: float = 20.0) -> None:
        """Wait until a camera has delivered this many more pictures."""
        self.wait(lambda goal=port.count.pictures + pictures: port.count.pictures >= goal, timeout_s)

    def flows(self, stream: str = "camera") -> None:
        """Wait until a sample taken after now is stored, seen by a second reader of the live session."""
        now_ns = self.lab.mono_ns()
        self.wait(lambda: self._newest_ns(stream) > now_ns, 40.0, every_s=0.5)

    def remove(self) -> None:
        """Delete the campaign: the guest's disk is memory."""
        self.lab.run("rm", "-rf", self.folder, user="root")

    def _newest_ns(self, stream: str) -> int:
        newest: int = self.lab.guest.call(
            "usblab.inside.session:newest_ns", folder=self.folder, stream=stream
        )
        return newest

    def wait(self, done: Callable[[], bool], timeout_s: float = 20.0, every_s: float = 0.05) -> None:
        """Wait for something while the recording runs; what asks the guest should do so seldom."""
        deadline = time.monotonic() + timeout_s
        look = time.monotonic() + 2.0
        while not done():
            time.sleep(every_s)
            if time.monotonic() > look:
                look += 2.0
                ended = self.job.poll()
                assert ended is None, f"the recording ended by itself: {ended}"
            if time.monotonic() > deadline:
                self.job.signal(signal.SIGABRT)
                raise TimeoutError(f"waited {timeout_s} s in vain: {self.job.wait(10)}")

    def stop(self) -> dict[str, Any]:
        """Stop it as Ctrl-C does, and look at the session."""
        self.job.signal(signal.SIGINT)
        return self.finish()

    def finish(self, timeout_s: float = 30.0) -> dict[str, Any]:
        """Wait for its end, see that it sealed a session, and look at that."""
        ended = self.job.wait(timeout_s)
        assert ended.code == 0, ended
        return self.look(json.loads(ended.out)["session"])

    def look(self, session: str) -> dict[str, Any]:
        """The session's contents, see `usblab.inside.session.summary`."""
        self.session = session if session.startswith("/") else f"{self.folder}/{session}"
        found: dict[str, Any] = self.lab.guest.call(
            "usblab.inside.session:summary", path=self.session, timeout_s=60
        )
        return found

    def fieldkit(self, *arguments: str) -> Ended:
        """Another verb in the same campaign folder."""
        return self.lab.run("fieldkit", *arguments, folder=self.folder, user=OBSERVER)


def events(session: Mapping[str, Any], kind: str, stream: str = "") -> list[str]:
    """The texts of a session's events of a kind, of one stream if it is named."""
    found = [
        event for event in session["events"] if event["kind"] == kind and stream in ("", event["stream"])
    ]
    return [event["text"] for event in found]
