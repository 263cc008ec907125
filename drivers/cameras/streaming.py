"""Cameras that send frames by themselves, over a serial line or a network, as sources of buffers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import suppress

from fieldkit.drivers.decoding import Layout
from fieldkit.drivers.framing import Port, Stamped
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceError, DeviceLostError

SILENT_S = 10.0
"""A network does not report that the other end was switched off: silence this long does."""


class StreamSource(ABC):
    """The part of `fieldkit.model.device.FrameSource` that these cameras share; `port` names the far end."""

    backend: str

    def __init__(self, port: str, clock: Clock) -> None:
        self.port = port
        self._clock = clock
        self._last_received_ns = clock.mono_ns()

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame, or None; raises `DeviceLostError` after `SILENT_S` without any."""
        buffer = self._receive(timeout_s)
        now_ns = self._clock.mono_ns()
        if buffer is not None:
            self._last_received_ns = now_ns
        elif now_ns - self._last_received_ns > SILENT_S * 1e9:
            raise DeviceLostError(
                f"the camera has sent nothing for {SILENT_S:g} s",
                place=self.port,
                fix="check its power and its connection; it is opened again by itself",
            )
        return buffer

    def skip_until(self, mono_ns: int) -> None:
        """Let frames go by until a monotonic time."""
        while (left_ns := mono_ns - self._clock.mono_ns()) > 0:
            self.read(left_ns / 1e9)

    @abstractmethod
    def _receive(self, timeout_s: float) -> Buffer | None:
        """The next frame, damaged or not, or None."""

    @abstractmethod
    def close(self) -> None:
        """Release the camera; a second call does nothing."""


class PortSource(StreamSource):
    """Frames out of a port: what `layout` finds is a frame's bytes, unless it is a note.

    `goodbye` is sent before the port is closed. Bytes that are no frame count as one damaged buffer.
    """

    def __init__(self, port: Port, layout: Layout, clock: Clock, goodbye: bytes = b"") -> None:
        super().__init__(port.path, clock)
        self.backend: str = str(port.facts["line"])
        self._port, self._layout, self._goodbye = port, layout, goodbye
        self._held: Stamped | None = None
        self._rejected = 0

    def close(self) -> None:
        """Say goodbye once, and close the port."""
        goodbye, self._goodbye = self._goodbye, b""
        with suppress(DeviceError):
            if goodbye:
                self._port.write(goodbye)
        self._port.close()

    def _receive(self, timeout_s: float) -> Buffer | None:
        stamped, self._held = self._held or self._frame(timeout_s), None
        if self._port.framer.rejected > self._rejected:
            self._rejected, self._held = self._port.framer.rejected, stamped
            return Buffer(b"", self._clock.mono_ns(), error=True)
        return Buffer(stamped.raw, stamped.mono_ns) if stamped else None

    def _frame(self, timeout_s: float) -> Stamped | None:
        """The next record that is not a note."""
        for left_s in time_left(self._clock, timeout_s):
            record = self._port.read(self._layout, left_s)
            if record is None or record.record.numbers:
                return record
        return None
