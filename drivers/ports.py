"""Serial ports, found by identity and opened exclusively.

pyserial opens and configures the port; the session's clock does the waiting. Exceptions of
other libraries end here.
"""

from __future__ import annotations

import errno
import fcntl
import os
import termios
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from fieldkit.drivers import identity, options
from fieldkit.drivers.connections import connect, is_address
from fieldkit.drivers.decoding import RecordDriver
from fieldkit.drivers.framing import BAUDS, CHUNK_BYTES, Line, Port
from fieldkit.drivers.modem_lines import SCHEME, ModemLines
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceNotFoundError
from fieldkit.model.next_step import Action


class SerialPort(Port):
    """An open serial port, for one program only.

    DTR stays asserted: some meters draw the power of their transmitter from it.
    Raises what `open_failure` explains when the port cannot be opened.
    """

    def __init__(self, path: str, line: Line, clock: Clock) -> None:
        import serial

        self._serial = serial.Serial()
        self._serial.port = path
        self._serial.baudrate = line.baud
        self._serial.bytesize, self._serial.parity, self._serial.stopbits = line.bits, line.parity, line.stop
        self._serial.exclusive = True
        try:
            self._serial.open()
            self._fd = self._serial.fileno()
            # The lock above only excludes programs that check it; this excludes the others.
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
        except (OSError, termios.error) as error:
            self._serial.close()
            raise open_failure(path, error) from error
        facts = {"line": str(line), **_shorten_usb_latency(self._serial)}
        super().__init__(path, facts, clock, line.byte_ns, _identity_of(path))
        close_on_failure(self.close)

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError` when the port is gone."""
        with self._errors():
            os.write(self._fd, data)

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        if self._serial.is_open:
            with suppress(OSError):
                fcntl.ioctl(self._fd, termios.TIOCNXCL)
            with suppress(OSError):
                self._serial.close()

    def _discard(self) -> None:
        with self._errors():
            termios.tcflush(self._fd, termios.TCIFLUSH)
        super()._discard()

    def _receive(self, timeout_s: float) -> bytes:
        if not self._clock.wait_readable(self._fd, timeout_s):
            return b""
        with self._errors(), suppress(BlockingIOError):
            if chunk := os.read(self._fd, CHUNK_BYTES):
                return chunk
            raise OSError("hung up")
        return b""

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Around calls on the port: their errors become `DeviceLostError`."""
        try:
            yield
        except (OSError, termios.error) as error:
            raise identity.unplugged(self.path, "gone") from error


def _identity_of(path: str) -> str:
    """Identity of a port's USB adapter, empty for a port that is none."""
    real, ports = os.path.realpath(path), serial_ports()
    return next((usb.as_text([usb for _, usb in ports]) for path, usb in ports if path == real), "")


def open_port(
    settings: DeviceSettings, line: Line, clock: Clock, *, kinds: Sequence[identity.Kind] = ()
) -> Port:
    """The port at the address that `settings` name, or at `port_path`, opened."""
    if settings.port.startswith(SCHEME):
        return ModemLines(settings.port.removeprefix(SCHEME), clock)
    if is_address(settings.port):
        return connect(settings, line, clock)
    return SerialPort(port_path(settings, kinds), line, clock)


def baud(settings: DeviceSettings, usual: int) -> int:
    """The option `baud`; raises `ConfigError`."""
    return options.whole(settings, "baud", usual, (BAUDS[0], BAUDS[-1]))


def serial_ports() -> list[identity.Found]:
    """(path, identity) of every USB serial port of this computer."""
    nodes = sorted((identity.SYSFS / "class/tty").glob("tty[UA]*"))
    parents = ((f"/dev/{node.name}", identity.usb_parent((node / "device").resolve())) for node in nodes)
    return [(path, usb) for path, usb in parents if usb is not None]


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
    kinds: Sequence[identity.Kind] = ()
    caveat = "any adapter: only what it sends or replies decides"

    def find(self) -> list[DiscoveredDevice]:
        """Serial adapters that the instrument may have."""
        adapters = identity.candidates(
            self.name, "serial adapter", serial_ports(), self.kinds or None, self.caveat
        )
        return [replace(adapter, title=f"{self.title} ({adapter.title})") for adapter in adapters]


def port_path(settings: DeviceSettings, kinds: Sequence[identity.Kind] = ()) -> str:
    """Path of the port that `settings` names, by path or identity; with neither, of the only matching one.

    `kinds` are the (vendor, product) pairs that a meter's own adapter may have. Raises
    `DeviceNotFoundError` with what is connected instead.
    """
    ports = serial_ports()
    if settings.port:
        _refuse_another(settings, ports)
        return settings.port
    return identity.only_one(settings, ports, kinds, "USB serial port")[0]


def _refuse_another(settings: DeviceSettings, ports: list[identity.Found]) -> None:
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
        f"{wrong}; {identity.listing(ports, 'USB serial port')}",
        place=settings.name,
        fix=f'omit port from the configuration: the identity is enough, of {settings.port} "{own}"',
    )


def open_failure(path: str, error: Exception) -> DeviceError:
    """Error of a port that would not open, with what to type."""
    code = getattr(error, "errno", None)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return DeviceNotFoundError(
            f"no such serial port; {identity.listing(serial_ports(), 'USB serial port')}",
            place=path,
            fix="plug the instrument in; " + Action.FIND_DEVICES() + " shows the identity",
        )
    fix = (
        f"close it (fuser -v {path} names it); if it is ModemManager, install the rules: " + identity.UDEV_FIX
    )
    return identity.refusal(path, error, identity.group_of(path), fix) or DeviceAccessError(
        f"cannot be opened: {error}", place=path, fix=Action.DOCTOR() + " checks the cause"
    )


def _shorten_usb_latency(port: Any) -> dict[str, int]:
    """Ask an FTDI adapter to deliver at once; its latency timer in ms as read back, nothing for others.

    By default the chip holds a short packet for 16 ms, which would move every stamp by as much.
    """
    with suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)
    node = identity.SYSFS / "class/tty" / os.path.basename(os.path.realpath(port.port))
    latency_ms = identity.text_in(node / "device" / "latency_timer")
    return {"usb_latency_ms": int(latency_ms)} if latency_ms else {}
