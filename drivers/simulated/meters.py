"""The far ends of the serial meters: what they measure, and the bytes they send.

Written from the same protocol sheets as the drivers (see `fieldkit.drivers.meters`), in
the other direction, and sharing nothing with them but the line's speed.
"""

from __future__ import annotations

import fcntl
import logging
import math
import os
import select
import struct
import termios
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.drivers.framing import Line
from fieldkit.model.arrays import FloatArray
from fieldkit.model.channels import is_air_temperature
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.simulation import Scene
from fieldkit.simulation.simulated_clock import SimulatedClock

_LINE = Line(9600)
_SPOILT_SHARE = 0.7  # of the records during a garbled minute
_OPEN_PROBE = 0x7FFF


class SimulatedMeter(ABC):
    """An instrument on a pseudo-terminal, looking at the scene through the clock.

    `latency_s` is how old the value is that the first byte of a record announces, and
    `response_s` the time constant of the sensor: the truth, which `declared` puts into the
    options unless others are given.
    """

    latency_s: float = 0.0
    response_s: float = 0.0

    def __init__(self, scene: Scene, clock: SimulatedClock, settings: DeviceSettings) -> None:
        self._scene, self._clock = scene, clock
        self._every_ns = max(1, round(settings.every_s * SECOND_NS))
        self._terminal = PseudoTerminal(clock)
        self._closed = False
        self.path: str = self._terminal.path
        self._start()

    def timing_options(self) -> dict[str, float]:
        """Options by which the driver's stream declares latency and response."""
        return {"latency_s": self.latency_s, "response_s": self.response_s}

    def close(self) -> None:
        """Pull the plug."""
        self._closed = True
        self._terminal.close()

    @abstractmethod
    def _start(self) -> None:
        """Begin to send or to receive."""

    def _measured_ns(self, first_byte_ns: int) -> int:
        """UTC of the value that a record beginning at this monotonic time announces."""
        return self._clock.to_utc_ns(first_byte_ns - round(self.latency_s * SECOND_NS))

    def _send_from(self, first_byte_ns: int, record: bytes) -> int:
        """Put a record on the wire from that time on; returns when its last byte is out."""
        out_ns = first_byte_ns + len(record) * _LINE.byte_ns
        self._clock.call_at(out_ns, lambda: self._deliver(record))
        return out_ns

    def _deliver(self, record: bytes) -> None:
        if self._closed:
            return
        now_ns = self._clock.to_utc_ns(self._clock.mono_ns())
        if self._scene.is_on(FaultKind.GARBLED, now_ns):
            record = garble(record, np.random.default_rng([self._scene.seed, now_ns]))
        self._terminal.send(record)


class SimulatedLutron(SimulatedMeter):
    """A light meter that lies flat and sends a record every `every_s`, unrequested."""

    latency_s: float = 0.2

    def _start(self) -> None:
        self._clock.call_at(self._clock.mono_ns() + self._every_ns, self._measure)

    def _measure(self) -> None:
        if self._closed:
            return
        now_ns = self._clock.mono_ns()
        lux = self._scene.lux_reading(self._measured_ns(now_ns))
        overload = self._scene.is_on(FaultKind.OVERRANGE, self._clock.to_utc_ns(now_ns))
        self._send_from(now_ns, lutron_overload("15") if overload else lutron_record(lux, "15"))
        self._clock.call_at(now_ns + self._every_ns, self._measure)


class SimulatedCenter309(SimulatedMeter):
    """A thermometer that replies to `A` and `K`.

    Of its four probes, those that the option `labels` names as air hang in the air, the others lie in the
    first regions.
    """

    latency_s: float = 0.1
    _THINKS_NS = 20_000_000

    def __init__(self, scene: Scene, clock: SimulatedClock, settings: DeviceSettings) -> None:
        self.response_s: float = scene.response_s
        labels = [str(label) for label in settings.options.get("labels", ())]
        self._in_air = [is_air_temperature(label) for label in (*labels, "", "", "", "")[:4]]
        super().__init__(scene, clock, settings)

    def _start(self) -> None:
        self._terminal.listen(self._receive)

    def _receive(self, letters: bytes) -> None:
        """Reply to each letter in turn; the others are key presses without a reply."""
        free_ns = self._clock.mono_ns()
        for letter in letters:
            first_byte_ns = free_ns + self._THINKS_NS
            if letter == ord("K"):
                free_ns = self._send_from(first_byte_ns, b"309\r")
            elif letter == ord("A"):
                kelvin = self._probes_k(self._measured_ns(first_byte_ns))
                free_ns = self._send_from(first_byte_ns, center_309_record(kelvin - CELSIUS_ZERO_K))

    def _probes_k(self, time_ns: int) -> FloatArray:
        in_beds = iter(self._scene.probe_readings(time_ns).tolist())
        air_k = self._scene.air_reading(time_ns) if any(self._in_air) else np.nan
        return np.array([air_k if in_air else next(in_beds, np.nan) for in_air in self._in_air])


def lutron_record(value: float, unit: str) -> bytes:
    """16 bytes of the Lutron stream: as many decimals as fit a display of five digits."""
    decimals = 0 if abs(value) >= 10_000 else 1 if abs(value) >= 1_000 else 2
    digits = round(abs(value) * 10**decimals)
    sign = "1" if value < 0 else "0"
    return b"\x02" + f"41{unit}{sign}{decimals}{digits:08}".encode() + b"\r"


def lutron_overload(unit: str) -> bytes:
    """16 bytes of the Lutron stream for a value beyond the range: 18 in place of its digits."""
    return b"\x02" + f"41{unit}00".encode() + b"\x18" * 8 + b"\r"


def center_309_record(celsius: ArrayLike) -> bytes:
    """45 bytes of the Center 309 for up to four probes, tenths of °C; NaN and absent probes are open."""
    probes = (*np.atleast_1d(celsius)[:4].tolist(), *[math.nan] * 4)[:4]
    record = bytearray(45)
    # automatic power off (bit 7 of the second status byte) is disabled, as for any long recording
    record[0], record[1], record[2], record[44] = 0x02, 0x80, 0x00, 0x03
    tenths = [_OPEN_PROBE if math.isnan(probe) else round(10.0 * probe) for probe in probes]
    struct.pack_into(">4h", record, 7, *tenths)
    record[39] = sum(1 << place for place, probe in enumerate(probes) if math.isnan(probe))
    return bytes(record)


def garble(record: bytes, random: np.random.Generator) -> bytes:
    """A record after a bad contact: mostly with bytes lost and others changed."""
    if random.random() > _SPOILT_SHARE:
        return record
    damaged = bytearray(record)
    for _ in range(int(random.integers(1, 4))):
        del damaged[int(random.integers(len(damaged)))]
        damaged[int(random.integers(len(damaged)))] ^= int(random.integers(1, 256))
    return bytes(damaged)


# --- the line between an instrument and its driver


log: logging.Logger = logging.getLogger(__name__)

_MOST_UNREAD = 2048  # then nothing reads, and bytes are lost as on a wire
_ARRIVES_S = 1.0


class PseudoTerminal:
    """A pseudo-terminal, opened at once; closing it is pulling the plug. Raises `DeviceAccessError`.

    The driver opens `path` with pyserial like any serial port. Bytes arrive a little later in real time, so
    `send` waits until they are there: simulated time must not advance while bytes are in transit. Baud rates
    have no effect: an instrument sends a record when its last byte would have left a real wire.
    """

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
        self._clock.watch(self._master, lambda: receive(self._receive()))
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

    def _receive(self) -> bytes:
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
            fix="mount /dev/pts, which a container or chroot may lack: mount -t devpts devpts /dev/pts",
        ) from error
