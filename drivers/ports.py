"""Serial ports, found by identity and opened exclusively, and the records in the bytes they deliver.

pyserial opens and configures the port; the session's clock does the waiting. Exceptions of
other libraries end here.

A record's stamp is when its first byte was on the wire: the moment the chunk that brought it was read, less
the wire time of that byte and what came after it in the same chunk. On a computer that falls behind, that
moment means nothing: bytes wait in the port and are read in one bunch. The wire time then gives way, so
that stamps keep their order and none lies before the end of the record before it, or after its arrival; such
records are marked `bunched`. Bytes that belong to no record are dropped up to the next possible start; a run
of them counts as one rejection.
"""

from __future__ import annotations

import errno
import fcntl
import math
import os
import termios
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

from fieldkit.drivers import options
from fieldkit.drivers.decoding import Channel, Layout, Record, RecordDriver
from fieldkit.drivers.identity import (
    SYSFS,
    UDEV_FIX,
    Found,
    Kind,
    candidates,
    fitting,
    group_of,
    listing,
    only_one,
    refusal,
    usb_parent,
)
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.next_step import Action
from fieldkit.model.units import SECOND_NS

# --- records out of a stream of bytes

_CHUNKS_KEPT = 64  # far more than one record is made of
_REFUSED_KEPT = 4096
_LONG_AGO_NS = -(2**63)
_HELD_BACK_NS = 20_000_000  # by an adapter at most: the latency timer of an FTDI chip is 16 ms


class Stamped(NamedTuple):
    """A record, its bytes, when its first byte was on the wire, and whether it waited among others."""

    record: Record
    raw: bytes
    mono_ns: int
    bunched: bool = False


class Arrival(NamedTuple):
    """A chunk: bytes received up to its end, when it was read, and how long after the one before it."""

    received: int
    mono_ns: int
    after_ns: int


_NOTHING_BEFORE: tuple[Arrival, tuple[Channel, ...], bool] = (Arrival(0, 0, 0), (), False)


class Port(Protocol):
    """Transport of a meter's bytes: a serial line, a HID bridge, a socket."""

    path: str
    framer: Framer

    @property
    def facts(self) -> dict[str, Any]:
        """Details of the port for the stream's record."""

    @property
    def identity(self) -> str:
        """Identity of the USB adapter, empty for a port that is none."""

    @property
    def byte_ns(self) -> int:
        """Wire time of one byte."""

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError` when the port is gone."""

    def read(self, layout: Layout, timeout_s: float, request: bytes = b"") -> Stamped | None:
        """The next record, or None if none is complete within `timeout_s`.

        With a `request`, everything received so far is discarded and the record is the reply.
        """

    def close(self) -> None:
        """Release the port; a second call does nothing."""


class Framer:
    """Takes chunks in, gives records out; `byte_ns` is the wire time of one byte.

    `feed` has a short path for a chunk that is exactly one record: it is the usual case, and the goals of
    ``benchmarks/drivers_serial.py`` are out of reach without it.
    """

    def __init__(self, byte_ns: int) -> None:
        self.received: int = 0
        """Bytes received so far."""
        self.left: bytes = b""
        """Bytes of earlier chunks that are no record yet, or further ones."""
        self.rejected: int = 0
        self.reason: str = ""
        """Reason why the last bytes that are no record were rejected."""
        self._byte_ns = byte_ns
        self._arrivals: deque[Arrival] = deque(maxlen=_CHUNKS_KEPT)
        self._read_ns = self._passed_ns = _LONG_AGO_NS
        self._passed = 0  # bytes up to the end of the last record, which was on the wire at `_passed_ns`
        self._before = _NOTHING_BEFORE
        self._asked = False
        self._refused = b""

    @property
    def unread(self) -> bytes:
        """The last bytes received, as far as they were no record."""
        return self._refused + self.left

    def feed(self, layout: Layout, chunk: bytes, mono_ns: int) -> Stamped | None:
        """The next record after a chunk that was read at `mono_ns`, None if the bytes do not make one yet."""
        length = len(chunk)
        self.received += length
        if not self.left and 0 < length <= layout.longest:  # the short path
            record = layout.parse(chunk)
            begun_ns = mono_ns - length * self._byte_ns
            if isinstance(record, Record) and record.length == length and begun_ns >= self._passed_ns:
                self._refused = b""
                self._passed = self.received
                self._passed_ns = self._read_ns = mono_ns
                return Stamped(record, chunk, begun_ns)
        self.left += chunk
        self._arrivals.append(Arrival(self.received, mono_ns, mono_ns - self._read_ns))
        self._read_ns = mono_ns
        return self.next_record(layout)

    def discard(self) -> None:
        """Discard everything received so far: the next record is a reply and did not wait."""
        self._asked = True
        self.left = self._refused = b""

    def next_record(self, layout: Layout) -> Stamped | None:
        """The next record of what is left of earlier chunks, None if there is none."""
        while buffer := self.left:
            parsed = layout.parse(buffer[: layout.longest])
            if parsed is None and len(buffer) < layout.longest:
                return None
            length = parsed.length if parsed else 1
            self.left = buffer[length:]
            if isinstance(parsed, Record):
                self._refused = b""
                return self._stamp(layout, parsed, buffer[:length])
            if not self._refused:
                self.rejected += 1
                self.reason = parsed.reason if parsed else "no end of record found"
            self._refused = (self._refused + buffer[:length])[-_REFUSED_KEPT:]
        return None

    def _stamp(self, layout: Layout, record: Record, raw: bytes) -> Stamped:
        """A record that was just taken, with its place in time; the place of its end is kept for the next."""
        end = self.received - len(self.left)
        arrival = self._arrival_of(end - len(raw))
        bunched = not self._asked and self._has_waited(layout, arrival, record)
        self._before, self._asked = (arrival, record.channels, bunched), False
        begun_ns = self._when(arrival, end - len(raw))
        self._when(self._arrival_of(end - 1), end)
        return Stamped(record, raw, begun_ns, bunched)

    def _has_waited(self, layout: Layout, arrival: Arrival, record: Record) -> bool:
        """True if a record waited in the port: the wire had no time for it, or two alike came in one chunk.

        Different records that an instrument sends in one burst did not wait, nor what an adapter
        delivers together in its own time.
        """
        before, channels, bunched = self._before
        if before == arrival and bunched:
            return True
        if self._wire_ns(arrival) > arrival.mono_ns - self._passed_ns + _HELD_BACK_NS:
            return True
        if arrival.after_ns <= _HELD_BACK_NS:
            return False
        behind = layout.parse(self.left[: layout.longest]) if self.left else None
        return (before == arrival and channels == record.channels) or (
            isinstance(behind, Record) and behind.channels == record.channels
        )

    def _arrival_of(self, place: int) -> Arrival:
        """The chunk that brought the byte with `place` others before it."""
        while self._arrivals[0].received <= place:
            self._arrivals.popleft()
        return self._arrivals[0]

    def _wire_ns(self, arrival: Arrival) -> int:
        """Wire time of all that came since the end of the last record, up to the end of a chunk."""
        return (arrival.received - self._passed) * self._byte_ns

    def _when(self, arrival: Arrival, place: int) -> int:
        """Time of so many bytes: spread by the wire's time, or over less if there was no more."""
        spread_ns = min(self._wire_ns(arrival), arrival.mono_ns - self._passed_ns)
        behind = arrival.received - place
        self._passed_ns = arrival.mono_ns - behind * spread_ns // (arrival.received - self._passed)
        self._passed = place
        return self._passed_ns


CHUNK_BYTES = 4096
_LONGEST_TENTHS = 255
BAUDS = range(50, 4_000_001)
"""From the slowest to the fastest line that Linux names."""
PARITIES = ("N", "E", "O")


@dataclass(frozen=True, slots=True)
class Line:
    """Settings of a serial line; `start + bits + parity + stop` bits make one byte on the wire."""

    baud: int = 9600
    bits: int = 8
    parity: str = "N"
    stop: int = 1

    def __post_init__(self) -> None:
        """Raise `ValueError` for settings that no line has."""
        if self.baud not in BAUDS:
            raise ValueError(f"baud {self.baud!r} is not a whole number from {BAUDS[0]} to {BAUDS[-1]}")
        if self.bits not in (5, 6, 7, 8) or self.parity not in PARITIES or self.stop not in (1, 2):
            raise ValueError(f"no line has bits {self.bits!r}, parity {self.parity!r}, stop {self.stop!r}")

    @property
    def byte_ns(self) -> int:
        """Wire time of one byte in nanoseconds."""
        length = 1 + self.bits + (self.parity != "N") + self.stop
        return length * SECOND_NS // self.baud

    def __str__(self) -> str:
        return f"{self.baud} {self.bits}{self.parity}{self.stop}"


class SerialPort:
    """An open serial port, for one program only.

    DTR stays asserted: some meters draw the power of their transmitter from it.
    Raises what `open_failure` explains when the port cannot be opened.
    """

    def __init__(self, path: str, line: Line, clock: Clock) -> None:
        import serial

        self.path = path
        self.line = line
        self.framer: Framer = Framer(line.byte_ns)
        self._clock = clock
        self._serial = serial.Serial()
        self._serial.port = path
        self._serial.baudrate = line.baud
        self._serial.bytesize, self._serial.parity, self._serial.stopbits = line.bits, line.parity, line.stop
        self._serial.exclusive = True
        try:
            self._serial.open()
            self._fd = self._serial.fileno()
            self._blocks_for_s = math.nan
            os.set_blocking(self._fd, True)  # for as long as `_block_for` sets
            # The lock above only excludes programs that check it; this excludes the others.
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
        except (OSError, termios.error) as error:
            self._serial.close()
            raise open_failure(path, error) from error
        self.usb_latency_ms: int | None = _shorten_usb_latency(self._serial)
        close_on_failure(self.close)

    @property
    def byte_ns(self) -> int:
        """Wire time of one byte."""
        return self.line.byte_ns

    @property
    def facts(self) -> dict[str, Any]:
        """Details of the port for the stream's record."""
        facts: dict[str, Any] = {"line": str(self.line)}
        if self.usb_latency_ms is not None:
            facts["usb_latency_ms"] = self.usb_latency_ms
        return facts

    @property
    def identity(self) -> str:
        """Identity of the USB adapter, empty for a port that is none."""
        real, ports = os.path.realpath(self.path), serial_ports()
        present = [usb for _, usb in ports]
        return next((usb.as_text(present) for path, usb in ports if path == real), "")

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError` when the port is gone."""
        try:
            os.write(self._fd, data)
        except OSError as error:
            raise self._lost() from error

    def read(self, layout: Layout, timeout_s: float, request: bytes = b"") -> Stamped | None:
        """The next record, or None if none is complete within `timeout_s`, or a tenth of a second more.

        With a `request`, everything received so far is discarded and the record is the reply.
        """
        clock, framer = self._clock, self.framer
        try:
            if request:
                termios.tcflush(self._fd, termios.TCIFLUSH)
                framer.discard()
                os.write(self._fd, request)
            record = framer.next_record(layout) if framer.left else None
            left_s, started_ns = timeout_s, clock.mono_ns()
            while (
                record is None and left_s >= 0.0 and (left_s == self._blocks_for_s or self._will_wait(left_s))
            ):
                chunk = os.read(self._fd, CHUNK_BYTES) or self._late_bytes()
                if not chunk:
                    break
                now_ns = clock.mono_ns()
                record = framer.feed(layout, chunk, now_ns)
                if record is None:
                    left_s = timeout_s - (now_ns - started_ns) / 1e9
        except (OSError, termios.error) as error:
            raise self._lost() from error
        return record

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        if self._serial.is_open:
            with suppress(OSError):
                fcntl.ioctl(self._fd, termios.TIOCNXCL)
            with suppress(OSError):
                self._serial.close()

    def _will_wait(self, timeout_s: float) -> bool:
        """Let the next read wait for bytes, or wait for them by the clock; False if none came by then.

        The terminal's own time-out saves a system call for every reading.
        """
        if not self._clock.is_real:
            return self._clock.wait_readable(self._fd, timeout_s)
        self._block_for(timeout_s)
        return True

    def _late_bytes(self) -> bytes:
        """Bytes that came just after a read gave up, empty if nothing did; raises when the port is gone."""
        if not self._clock.wait_readable(self._fd, 0.0):
            return b""
        chunk = os.read(self._fd, CHUNK_BYTES)
        if not chunk:
            raise self._lost()
        return chunk

    def _block_for(self, timeout_s: float) -> None:
        """Let a read wait that long, to the next tenth of a second."""
        attributes = termios.tcgetattr(self._fd)
        tenths = min(math.ceil(timeout_s * 10.0), _LONGEST_TENTHS)
        if tenths != attributes[6][termios.VTIME]:
            attributes[6][termios.VTIME] = tenths
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        self._blocks_for_s = timeout_s

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(
            "gone", place=self.path, fix="plug the cable back in; it is opened again by identity"
        )


def open_port(
    settings: DeviceSettings, line: Line, clock: Clock, *, kinds: Sequence[Kind] = ()
) -> SerialPort:
    """The port at `port_path`, opened."""
    return SerialPort(port_path(settings, kinds), line, clock)


def baud(settings: DeviceSettings, usual: int) -> int:
    """The option `baud`; raises `ConfigError`."""
    return options.whole(settings, "baud", usual, (BAUDS[0], BAUDS[-1]))


def serial_ports() -> list[Found]:
    """(path, identity) of every USB serial port of this computer."""
    nodes = sorted((SYSFS / "class/tty").glob("tty[UA]*"))
    parents = ((f"/dev/{node.name}", usb_parent((node / "device").resolve())) for node in nodes)
    return [(path, identity) for path, identity in parents if identity is not None]


class SerialDriver(RecordDriver):
    """Base of the drivers of instruments at serial ports: any adapter is a candidate, or those of `kinds`.

    `caveat` says what decides.
    """

    name: str
    title: str
    kinds: Sequence[Kind] = ()
    caveat: str

    def find(self) -> list[DiscoveredDevice]:
        """Serial adapters that the instrument may have."""
        adapters = candidates(self.name, "serial adapter", serial_ports(), self.kinds or None, self.caveat)
        return [replace(adapter, title=f"{self.title} ({adapter.title})") for adapter in adapters]


def port_path(settings: DeviceSettings, kinds: Sequence[Kind] = ()) -> str:
    """Path of the port that `settings` names, by path or identity; with neither, of the only matching one.

    `kinds` are the (vendor, product) pairs that a meter's own adapter may have. Raises
    `DeviceNotFoundError` with what is connected instead.
    """
    ports = serial_ports()
    if settings.port:
        _refuse_another(settings, ports)
        return settings.port
    return only_one(settings, fitting(settings, ports, kinds), ports, "USB serial port")[0]


def _refuse_another(settings: DeviceSettings, ports: list[Found]) -> None:
    """A port that is given with an identity must have it: node numbers change at every boot."""
    real, present = os.path.realpath(settings.port), [usb for _, usb in ports]
    usb = next((usb for path, usb in ports if path == real), None)
    if usb is None or not settings.identity:
        return
    matching = [port for port in usb.ports(present) if port.matches(settings.identity)]
    if matching == [usb]:
        return
    own = usb.as_text(present)
    wrong = f"{settings.port} is {own}, not {settings.identity}"
    if usb in matching:
        wrong = f"identity {settings.identity} is that of {len(matching)} ports of one adapter"
    raise DeviceNotFoundError(
        f"{wrong}; {listing(ports, 'USB serial port')}",
        place=settings.name,
        fix=f'omit port from the configuration: the identity is enough, of {settings.port} "{own}"',
    )


def open_failure(path: str, error: Exception) -> DeviceError:
    """Error of a port that would not open, with what to type."""
    code = getattr(error, "errno", None)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return DeviceNotFoundError(
            f"no such serial port; {listing(serial_ports(), 'USB serial port')}",
            place=path,
            fix="plug the instrument in; " + Action.FIND_DEVICES() + " shows the identity",
        )
    fix = f"close it (fuser -v {path} names it); if it is ModemManager, install the rules: " + UDEV_FIX
    if cause := refusal(path, error, group_of(path), fix):
        return cause
    return DeviceAccessError(
        f"cannot be opened: {error}", place=path, fix=Action.DOCTOR() + " checks the cause"
    )


def _shorten_usb_latency(port: Any) -> int | None:
    """Ask an FTDI adapter to deliver at once; its latency timer in ms as read back, None for others.

    By default the chip holds a short packet for 16 ms, which would move every stamp by as much.
    """
    with suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)
    try:
        node = SYSFS / "class/tty" / os.path.basename(os.path.realpath(port.port))
        return int((node / "device" / "latency_timer").read_text())
    except (OSError, ValueError):
        return None
