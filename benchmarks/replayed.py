"""Instruments for benchmarks that cost the recorder's process next to nothing.

The camera hands over prepared bytes at its rate by the computer's own clock; the meters'
far ends run in a process of their own, so that what is measured is the recorder.
"""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import time
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fieldkit.model.clock import HostClock
from fieldkit.model.device import Buffer
from fieldkit.model.units import SECOND_NS


class PreparedCamera:
    """A `FrameSource` that repeats prepared frames at a rate, stamped when they are due.

    Like the kernel it keeps four buffers; a reader that comes later finds a gap in `sequence`.
    """

    backend = "prepared"
    port = "prepared"
    kept = 4

    def __init__(self, frames: Sequence[bytes], rate_hz: float, clock: HostClock) -> None:
        self._frames, self._clock = tuple(frames), clock
        self._period_ns = round(SECOND_NS / rate_hz)
        self.begin()

    def begin(self) -> None:
        """Start now: what came before was for opening."""
        self._start_ns, self._next, self.skipped = self._clock.mono_ns(), 0, 0

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame once it is due."""
        now = self._clock.mono_ns()
        oldest = (now - self._start_ns) // self._period_ns - self.kept + 1
        self.skipped += max(0, oldest - self._next)
        self._next = max(self._next, oldest)
        due = self._start_ns + self._next * self._period_ns
        self._clock.sleep(min(max(0, due - now) / SECOND_NS, timeout_s))
        if self._clock.mono_ns() < due:
            return None
        number, self._next = self._next, self._next + 1
        return Buffer(self._frames[number % len(self._frames)], due, number)

    def skip_until(self, mono_ns: int) -> None:
        """Let frames go by."""
        self._clock.sleep((mono_ns - self._clock.mono_ns()) / SECOND_NS)

    def close(self) -> None:
        """Nothing is held."""


@contextmanager
def meters() -> Iterator[tuple[str, str]]:
    """Paths of a Lutron light meter and a Center 309 whose far ends live in another process."""
    far_ends = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.replayed"], stdout=subprocess.PIPE, text=True
    )
    assert far_ends.stdout is not None
    lux, thermometer = far_ends.stdout.readline().split()
    try:
        yield lux, thermometer
    finally:
        far_ends.terminate()
        far_ends.wait()


def _serve() -> None:
    """Talk as the light meter once a second, answer as the thermometer."""
    lutron = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")  # 98 760 lux
    center = (
        bytes.fromhex("02 80 80 00 00 00 00 00 FD 01 CC 03 ED 01 FF")
        + bytes(24)
        + bytes.fromhex("0000000000 03")
    )
    (lux, lux_end), (thermometer, thermometer_end) = pty.openpty(), pty.openpty()
    tty.setraw(lux_end)
    tty.setraw(thermometer_end)
    print(os.ttyname(lux_end), os.ttyname(thermometer_end), flush=True)
    due = time.monotonic()
    while True:
        ready, _, _ = select.select([thermometer], [], [], max(0.0, due - time.monotonic()))
        if ready:
            letters = os.read(thermometer, 16)
            os.write(thermometer, center if letters.endswith(b"A") else b"309\r")
        if time.monotonic() >= due:
            os.write(lux, lutron)
            due += 1.0


if __name__ == "__main__":
    _serve()
