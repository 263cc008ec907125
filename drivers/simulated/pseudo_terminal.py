"""A pseudo-terminal with an instrument at its far end.

The driver opens `path` with pyserial like any serial port. Bytes pass through the kernel's
terminal driver and arrive a little later in real time, so `send` waits until they are
there: simulated time must not advance while bytes are in transit. Baud rates have no effect here;
an instrument sends a record when its last byte would have left a real wire.
"""

from __future__ import annotations

import fcntl
import logging
import os
import select
import struct
import termios
import threading
import time
import tty
from collections.abc import Callable

from fieldkit.model.errors import DeviceAccessError
from fieldkit.simulation.simulated_clock import SimulatedClock

log: logging.Logger = logging.getLogger(__name__)

_MOST_UNREAD = 2048  # then nothing reads, and bytes are lost as on a wire
_ARRIVES_S = 1.0


class PseudoTerminal:
    """Opened at once; closing it is pulling the plug. Raises `DeviceAccessError`."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock
        self._master, self._slave = _both_ends()
        tty.setraw(self._slave)  # before the driver opens it, nothing may echo
        os.set_blocking(self._master, False)
        self.path: str = os.ttyname(self._slave)
        self._watched = False
        self._open = threading.Lock()  # held while the descriptors are in use

    def listen(self, receive: Callable[[bytes], None]) -> None:
        """Call `receive` with what the driver sends."""
        self._clock.watch(self._master, lambda: receive(self._received()))
        self._watched = True

    def send(self, data: bytes) -> None:
        """Deliver bytes to the driver; they are lost if nothing has been read for long."""
        with self._open:
            unread = self._unread()
            if not data or unread > _MOST_UNREAD:
                return
            os.write(self._master, data)
            if not self._arrives(unread + len(data)):
                log.warning("%s did not take %d bytes", self.path, len(data))

    def close(self) -> None:
        """Hang up; a second call does nothing."""
        if self._watched:
            self._clock.forget(self._master)
            self._watched = False
        with self._open:
            for fd in (self._master, self._slave):
                if fd >= 0:
                    os.close(fd)
            self._master = self._slave = -1

    def _arrives(self, count: int) -> bool:
        """Wait until so many bytes lie ready for the driver; False if they never do."""
        arrival = select.poll()
        arrival.register(self._slave, select.POLLIN)
        deadline = time.monotonic() + _ARRIVES_S
        while time.monotonic() < deadline:
            arrival.poll(0)  # makes Linux deliver pending bytes at once
            if self._unread() >= count:
                return True
            time.sleep(20e-6)
        return False

    def _received(self) -> bytes:
        with self._open:
            try:
                return os.read(self._master, 4096) if self._master >= 0 else b""
            except BlockingIOError:
                return b""

    def _unread(self) -> int:
        """Bytes that wait for the driver; as if endless once hung up."""
        if self._slave < 0:
            return _MOST_UNREAD + 1
        (count,) = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4))
        return int(count)


def _both_ends() -> tuple[int, int]:
    try:
        return os.openpty()
    except OSError as error:  # some containers have none
        raise DeviceAccessError(
            f"cannot open a pseudo-terminal for a simulated instrument: {error.strerror}",
            fix="in a container or a chroot, mount /dev/pts: mount -t devpts devpts /dev/pts",
        ) from error
