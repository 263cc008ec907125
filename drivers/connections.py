"""Instruments in the network: an address of the configuration, and a connection as a port.

A serial adapter in the network is ``host:port`` or ``socket://host:port`` (bytes by TCP: ser2net's raw mode,
USR, Moxa, ESPHome's stream server), ``rfc2217://host:port`` (RFC 2217, where the far end sets its line as
asked) or ``esphome://host/?port_name=NAME&key=KEY`` (ESPHome's serial_proxy, by serialx of the extra
``network``).
"""

from __future__ import annotations

import re
import socket
from importlib import import_module

from fieldkit.drivers.framing import CHUNK_BYTES, Line, Port
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.installation import install_extra

CONNECT_S = 5.0
SLICE_S = 0.1  # of a wait for a library, whose time-out cannot be changed while a port is open
ANNOUNCED_S = 1.5  # replies to a question that many may answer are delayed and put together
LAST_PORT = 65_535
_ADDRESS = re.compile(r"\w+://.*|(?![\da-fA-F]{4}:[\da-fA-F]{4}$)[^/:]+:\d*|\[.*\](:.*)?")
_HOST = re.compile(r"(?:\w+://)?(?:\[(.*)\]|([^:]*?))(?::(.*?))?/?", re.DOTALL)
_PEER, _ADVICE = "serial adapter", "switch the adapter on and join its network"


def is_address(port: str) -> bool:
    """True for ``host:port``, ``[IPv6]:port`` and URLs, False for the path of a port and a USB identity."""
    return _ADDRESS.fullmatch(port) is not None


def has_line(port: str) -> bool:
    """True where a serial line is set as asked, not only at an adapter by hand."""
    return not is_address(port) or port.startswith(("rfc2217:", "esphome:"))


def address_of(settings: DeviceSettings, usual_port: int, usual_host: str = "") -> tuple[str, int]:
    """(host, port) of ``port = "host:port"``, ``"host"`` or a URL; raises `ConfigError` if one is not known.

    Without a `usual_port` the address must have one.
    """
    match = _HOST.fullmatch(settings.port or usual_host)
    host, number = (match[1] or match[2], match[3]) if match else ("", None)
    if not host:
        raise ConfigError(
            f"the driver {settings.driver} needs the instrument's address",
            place=settings.name,
            fix='set port = "192.168.4.1", or with another port "192.168.4.1:5001"',
        )
    if number is None and usual_port:
        return host, usual_port
    if not (number and number.isdecimal() and 0 < int(number) <= LAST_PORT):
        raise ConfigError(
            f"behind the host stands {number or ''!r}, not a number from 1 to {LAST_PORT}",
            place=f"{settings.name}.port",
            fix=f'set port = "{host}:{usual_port or 4001}"',
        )
    return host, int(number)


def announced(service: str) -> list[tuple[str, str, int]]:
    """(name, address, port) of what announces a service by mDNS; empty without zeroconf."""
    try:
        from zeroconf import IPVersion, ServiceBrowser, Zeroconf
    except ImportError:
        return []
    names: list[str] = []
    try:
        with Zeroconf(ip_version=IPVersion.V4Only) as network:
            browser = ServiceBrowser(network, service, [lambda name, **_: names.append(name)])
            HostClock().sleep(ANNOUNCED_S)
            browser.cancel()
            replies = [(name, network.get_service_info(service, name)) for name in dict.fromkeys(names)]
    except OSError:  # no network
        return []
    return [
        (name.removesuffix(f".{service}"), address, info.port or 0)
        for name, info in replies
        if info
        for address in info.parsed_addresses(IPVersion.V4Only)[:1]
    ]


def connect(settings: DeviceSettings, line: Line, clock: Clock) -> Port:
    """The serial port at an address, opened; raises `ConfigError` or `DeviceNotFoundError`."""
    scheme = settings.port.partition("://")[0] if "://" in settings.port else "socket"
    if scheme in ("socket", "tcp"):
        return SocketPort(address_of(settings, 0), clock, _PEER, _ADVICE, line.byte_ns)
    if scheme in ("rfc2217", "esphome"):
        return UrlPort(settings, line, clock)
    raise ConfigError(
        f"{scheme}:// is not a way to a serial port",
        place=f"{settings.name}.port",
        fix="write host:port, socket://host:port, rfc2217://host:port or esphome://host/?port_name=NAME",
    )


class SocketPort(Port):
    """A TCP connection as a port: `peer` is what answers at the address, `advice` is for where nothing does.

    `byte_ns` is the wire time of a byte on a serial line behind it.
    """

    def __init__(
        self, address: tuple[str, int], clock: Clock, peer: str, advice: str, byte_ns: int = 0
    ) -> None:
        super().__init__(f"{address[0]}:{address[1]}", {"line": "tcp"}, clock, byte_ns)
        self._peer, self._advice = peer, advice
        try:
            self._socket = socket.create_connection(address, timeout=CONNECT_S)
        except (OSError, UnicodeError) as error:  # no name of a host
            raise DeviceNotFoundError(f"no {peer} there: {error}", place=self.path, fix=advice) from error
        self._socket.setblocking(False)
        close_on_failure(self.close)

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError`."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost() from error

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        self._socket.close()

    def _receive(self, timeout_s: float) -> bytes:
        if not self._clock.wait_readable(self._socket.fileno(), timeout_s):
            return b""
        try:
            chunk = self._socket.recv(CHUNK_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost() from error
        if not chunk:
            raise self._lost()
        return chunk

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(f"{self._peer} hung up", place=self.path, fix=self._advice)


class UrlPort(Port):
    """A serial port behind a URL as a port: by pyserial, those of ESPHome by serialx."""

    def __init__(self, settings: DeviceSettings, line: Line, clock: Clock) -> None:
        super().__init__(_without_secrets(settings.port), {"line": str(line)}, clock, line.byte_ns)
        try:
            library = import_module("serialx" if settings.port.startswith("esphome:") else "serial")
            self._serial = library.serial_for_url(
                settings.port,
                baudrate=line.baud,
                bytesize=line.bits,
                parity=line.parity,
                stopbits=line.stop,
                timeout=SLICE_S,
            )
            close_on_failure(self.close)
            if not self._serial.is_open:  # serialx leaves that to its caller
                self._serial.open()
        except ImportError as error:
            raise ConfigError("needs serialx", place=self.path, fix=install_extra("network")) from error
        except (OSError, ValueError) as error:
            raise DeviceNotFoundError(f"no {_PEER} there: {error}", place=self.path, fix=_ADVICE) from error

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError`."""
        try:
            self._serial.write(data)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        connection = getattr(self._serial, "_socket", None)
        self._serial.close()
        if connection is not None:  # which pyserial leaves open where the far end is gone
            connection.close()

    def _receive(self, timeout_s: float) -> bytes:
        try:
            first = bytes(self._serial.read(1))
            return first + bytes(self._serial.read(self._serial.in_waiting)) if first else b""
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> DeviceLostError:
        return DeviceLostError(f"{_PEER} hung up: {error}", place=self.path, fix=_ADVICE)


def _without_secrets(url: str) -> str:
    """A URL for messages and files: keys and passwords stand behind its host."""
    return url.partition("?")[0]
