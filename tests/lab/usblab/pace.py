"""When a camera sends: pictures at its own rate, isochronous packets at the rate of the cable.

Times are seconds of this computer's monotonic clock.
"""

from __future__ import annotations

import itertools
import time

from usblab.uvc.camera import UvcCamera

QEMU_HOLDS_BACK_S = 0.06
"""Of a stream that has just begun or ran dry, by the intervals that `redir.endpoint_info` tells."""


class PictureClock:
    """When the next picture is due; a late one is not made up for."""

    def __init__(self, rate_hz: float) -> None:
        self._interval_s = 1.0 / rate_hz
        self.start(0.0)

    def start(self, now_s: float) -> None:
        """The first picture is due one interval from now."""
        self.due_s = now_s + self._interval_s

    def tick(self, now_s: float) -> bool:
        """Whether a picture is due; the next one is then waited for."""
        if now_s < self.due_s:
            return False
        missed = int((now_s - self.due_s) / self._interval_s)
        self.due_s += (missed + 1) * self._interval_s
        return True


class IsoPace:
    """Which isochronous packets to send by now, in bursts of the size QEMU asked for.

    QEMU keeps them in a queue, from which the guest takes one in each service interval and never more.
    What it leaves there while this computer is busy stays, until the queue overflows and QEMU drops packets
    ("bufpq overflow", says its ``usb-redir`` when debugged). So the queue must run dry again and again: no
    interval is made up for, and of the intervals without data only as many get a packet, an empty one, as
    QEMU wants to have in its queue before it gives the first away.
    """

    def __init__(self, camera: UvcCamera, burst: int) -> None:
        pipe = camera.shape.endpoint
        base_s = 125e-6 if camera.shape.high_speed else 1e-3
        self._interval_s = base_s * 2 ** (pipe.interval - 1)
        self._burst = max(1, burst)
        held_back = round(QEMU_HOLDS_BACK_S / base_s)
        room = round(1.0 / (camera.shape.rate_hz * self._interval_s))
        self._at_least = held_back if held_back <= room else 0  # else the pictures follow each other closely
        self._in_a_row = 0
        self._numbers = itertools.count(1)
        self._begin_burst(time.monotonic())

    def _begin_burst(self, now_s: float) -> None:
        self.due_s = now_s + self._burst * self._interval_s
        """When the next burst is due."""

    def owed(self, now_s: float) -> int:
        """Service intervals that have passed: those of one burst, or none."""
        if now_s < self.due_s:
            return 0
        late_s = now_s - self.due_s
        self._begin_burst(now_s if late_s > self._interval_s else self.due_s)
        return self._burst

    def carries_a_packet(self, has_data: bool) -> bool:
        """Whether an interval does, for which there are data or not."""
        carries = has_data or 0 < self._in_a_row < self._at_least
        self._in_a_row = self._in_a_row + 1 if carries else 0
        return carries

    def next_id(self) -> int:
        """The number of the packet that is sent now."""
        return next(self._numbers)
