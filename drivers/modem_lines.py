"""The modem lines of a serial port as a meter's port: ``port = "lines:///dev/ttyUSB1"``, driver ``text``.

A switch, a relay or another instrument's output between an adapter's DTR and its CTS or DSR is recorded so,
and can be a trigger. The port gives a line of text for each change, and every second: ``cts=100 %, dsr=0 %``,
where 100 is asserted.
"""

from __future__ import annotations

import fcntl
import os
import struct
import termios

from fieldkit.drivers.framing import Port
from fieldkit.drivers.identity import unplugged
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock
from fieldkit.model.errors import DeviceNotFoundError

SCHEME = "lines://"
EVERY_S, LOOK_EVERY_S = 1.0, 0.02
LINES = {"cts": termios.TIOCM_CTS, "dsr": termios.TIOCM_DSR}


class ModemLines(Port):
    """The state of CTS and DSR as text; the port's own DTR and RTS stay asserted, to feed a switch."""

    def __init__(self, path: str, clock: Clock) -> None:
        """Raises `DeviceNotFoundError` if there is no such port, or one without modem lines."""
        super().__init__(path, {"line": "modem lines"}, clock, 0)
        self._fd = -1
        close_on_failure(self.close)
        self._printed, self._printed_ns = b"", 0
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            self._text()
        except OSError as error:
            fix = "name a serial port that has modem lines; a pseudo-terminal has none"
            raise DeviceNotFoundError(
                f"its modem lines cannot be read: {error}", place=path, fix=fix
            ) from error

    def write(self, data: bytes) -> None:
        """Nothing is sent on a line that is only looked at."""

    def close(self) -> None:
        """Close the port; a second call does nothing."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _receive(self, timeout_s: float) -> bytes:
        self._clock.sleep(min(timeout_s, LOOK_EVERY_S))
        now_ns = self._clock.mono_ns()
        try:
            text = self._text()
        except OSError as error:
            raise unplugged(self.path, "gone") from error
        if text == self._printed and now_ns - self._printed_ns < EVERY_S * 1e9:
            return b""
        self._printed, self._printed_ns = text, now_ns
        return text

    def _text(self) -> bytes:
        (state,) = struct.unpack("I", fcntl.ioctl(self._fd, termios.TIOCMGET, bytes(4)))
        levels = (f"{name}={100 if state & bit else 0} %" for name, bit in LINES.items())
        return f"{', '.join(levels)}\n".encode()
