"""Serial ports, found by identity and opened exclusively.

pyserial opens and configures the port; the session's clock does the waiting. Exceptions of
other libraries end here.
"""

from __future__ import annotations

import errno
import fcntl
import math
import os
import termios
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from fieldkit.drivers import options
from fieldkit.drivers.connections import connect, is_address
from fieldkit.drivers.decoding import Layout, RecordDriver
from fieldkit.drivers.framing import BAUDS, CHUNK_BYTES, Framer, Line, Port, Stamped
from fieldkit.drivers.identity import (
    SYSFS,
    UDEV_FIX,
    Found,
    Kind,
    candidates,
    group_of,
    listing,
    only_one,
    refusal,
    text_in,
    unplugged,
    usb_parent,
)
from fieldkit.drivers.modem_lines import SCHEME, ModemLines
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceNotFoundError
from fieldkit.model.next_step import Action

_LONGEST_TENTHS = 255


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
            raise unplugged(self.path, "gone") from error

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
            raise unplugged(self.path, "gone") from error
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
            raise unplugged(self.path, "gone")
        return chunk

    def _block_for(self, timeout_s: float) -> None:
        """Let a read wait that long, to the next tenth of a second."""
        attributes = termios.tcgetattr(self._fd)
        tenths = min(math.ceil(timeout_s * 10.0), _LONGEST_TENTHS)
        if tenths != attributes[6][termios.VTIME]:
            attributes[6][termios.VTIME] = tenths
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        self._blocks_for_s = timeout_s


def open_port(settings: DeviceSettings, line: Line, clock: Clock, *, kinds: Sequence[Kind] = ()) -> Port:
    """The port at the address that `settings` name, or at `port_path`, opened."""
    if settings.port.startswith(SCHEME):
        return ModemLines(settings.port.removeprefix(SCHEME), clock)
    if is_address(settings.port):
        return connect(settings, line, clock)
    return SerialPort(port_path(settings, kinds), line, clock)


def baud(settings: DeviceSettings, usual: int) -> int:
    """The option `baud`; raises `ConfigError`."""
    return options.whole(settings, "baud", usual, (BAUDS[0], BAUDS[-1]))


def serial_ports() -> list[Found]:
    """(path, identity) of every USB serial port of this computer."""
    nodes = sorted((SYSFS / "class/tty").glob("tty[UA]*"))
    parents = ((f"/dev/{node.name}", usb_parent((node / "device").resolve())) for node in nodes)
    return [(path, identity) for path, identity in parents if identity is not None]


class Probe(NamedTuple):
    """A way to recognise an instrument, which sends by itself on a line, or replies to a `request` there.

    The driver decodes what came with `options`; they belong into its configuration.
    """

    line: Line
    request: bytes = b""
    options: Mapping[str, Any] = MappingProxyType({})
    is_tcp: bool = False
    """True for a request that no serial line has."""


class SerialDriver(RecordDriver):
    """Base of the drivers of instruments at serial ports: any adapter is a candidate, or those of `kinds`.

    Only what it sends or replies decides; by its `probes` `fieldkit.drivers.recognition` finds out.
    """

    name: str
    title: str
    options: tuple[str, ...] = ()
    needs: Mapping[str, Sequence[str]] = MappingProxyType({})
    probes: Sequence[Probe] = ()
    kinds: Sequence[Kind] = ()
    caveat = "any adapter: only what it sends or replies decides"

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
    return only_one(settings, ports, kinds, "USB serial port")[0]


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
    return refusal(path, error, group_of(path), fix) or DeviceAccessError(
        f"cannot be opened: {error}", place=path, fix=Action.DOCTOR() + " checks the cause"
    )


def _shorten_usb_latency(port: Any) -> int | None:
    """Ask an FTDI adapter to deliver at once; its latency timer in ms as read back, None for others.

    By default the chip holds a short packet for 16 ms, which would move every stamp by as much.
    """
    with suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)
    node = SYSFS / "class/tty" / os.path.basename(os.path.realpath(port.port))
    latency_ms = text_in(node / "device" / "latency_timer")
    return int(latency_ms) if latency_ms else None
