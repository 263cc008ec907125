"""When a camera sends: pictures at its own rate, isochronous packets at the rate of the cable.

Times are seconds of this computer's monotonic clock.
"""

from __future__ import annotations

import time

from usblab.uvc.camera import UvcCamera


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
    """How many isochronous packets are owed by now, in bursts of the size QEMU asked for."""

    def __init__(self, camera: UvcCamera, burst: int) -> None:
        pipe = camera.shape.endpoint
        base_s = 125e-6 if camera.shape.high_speed else 1e-3
        self._interval_s = base_s * 2 ** (pipe.interval - 1)
        self._burst = max(1, burst)
        self._begun_s = time.monotonic()
        self._sent = 0

    @property
    def due_s(self) -> float:
        """When the next burst is due."""
        return self._begun_s + (self._sent + self._burst) * self._interval_s

    def owed(self, now_s: float) -> int:
        """Packets to send now: whole bursts only."""
        behind = int((now_s - self._begun_s) / self._interval_s) - self._sent
        return behind // self._burst * self._burst

    def next_id(self) -> int:
        """The number of the packet that is sent now."""
        self._sent += 1
        return self._sent
