"""Position and time from a running gpsd, by its JSON lines on TCP port 2947.

``TPV`` lines carry position and time; ``PPS`` lines the host clock's error, ``clock - real``, which is
recorded and never applied. Source: gpsd's own protocol pages.
"""

from __future__ import annotations

import json
import math
import socket
from datetime import datetime
from typing import Any

from fieldkit.drivers.connections import SocketPort, address_of
from fieldkit.drivers.decoding import Layout, Parsed, Record, RecordDriver, Rejected, Value
from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.nmea import altitude, position, receiver
from fieldkit.model.clock import Clock, utc_ns
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.samples import NO_COUNTER

LONGEST = 16_384
PORT = 2947
WATCH = b'?WATCH={"enable":true,"json":true,"pps":true};\n'
CHANNELS = (("latitude", "°"), ("longitude", "°"), ("altitude", "m"), ("clock error", "s"))
NOT_MEASURED = (5, 8)
"""Values of `status` that are no fix: dead reckoning, simulated."""

_ADVICE = "sudo systemctl start gpsd, or give port = host:port"
_HINT = "is a receiver attached to gpsd? cgps shows it"


def parse(buffer: bytes) -> Parsed:
    """The line at the start of `buffer`."""
    end = buffer.find(b"\n")
    if end < 0:
        return None if len(buffer) < LONGEST else Rejected(len(buffer), "no line end found")
    try:
        report = json.loads(buffer[:end])
        if not isinstance(report, dict):
            return Rejected(end + 1, "not a gpsd report: JSON, but not an object")
        return _meaning(report, end + 1)
    except KeyError as error:
        return Rejected(end + 1, f"not a gpsd report: {error} is missing")
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        return Rejected(end + 1, f"not a gpsd report: {error}")


def _meaning(report: dict[str, Any], length: int) -> Record:
    kind = report.get("class")
    if kind == "TPV":
        return _position(report, length)
    if kind == "PPS":
        seconds = float(report["clock_sec"] - report["real_sec"])
        error_s = seconds + float(report["clock_nsec"] - report["real_nsec"]) * 1e-9
        if not math.isfinite(error_s):
            raise ValueError("the clock's error is not a number")
        return Record.of(length, (Value(error_s, "s", "clock error"),), "PPS")
    return Record(length, note=f"{str(kind)[:20]}: not read")


def _position(report: dict[str, Any], length: int) -> Record:
    mode = report.get("mode", 0) if report.get("status") not in NOT_MEASURED else 0
    place = position(report.get("lat"), report.get("lon"), mode in (2, 3))
    height = altitude(report.get("alt", report.get("altMSL")), mode == 3)
    return Record.of(length, (*place, height), f"TPV mode {mode}", _time_ns(report.get("time")))


def _time_ns(text: Any) -> int:
    """UTC; a position without a time, or with one that cannot be held (a leap second), is still one."""
    try:
        return utc_ns(datetime.fromisoformat(text))
    except (ValueError, TypeError):
        return NO_COUNTER


LAYOUT = Layout(parse, LONGEST)


class Gpsd(RecordDriver):
    """Driver of gpsd; `port` is ``host:port`` (localhost:2947), options are those of every meter."""

    name = "gpsd"
    title = "gpsd (position, time, clock error)"
    host_port = PORT
    quantity = "position"
    options: tuple[str, ...] = meter.OPTIONS
    layout = LAYOUT

    def find(self) -> list[DiscoveredDevice]:
        """A gpsd on this computer."""
        with socket.socket() as probe:
            probe.settimeout(0.2)
            if probe.connect_ex(("127.0.0.1", PORT)):
                return []
        return [DiscoveredDevice(self.name, "", f"localhost:{PORT}", self.title)]

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Connect, start watching, and wait for the first report."""
        port = SocketPort(address_of(settings, PORT, "localhost"), clock, "gpsd", _ADVICE)
        port.write(WATCH)
        meter.first_record(port, LAYOUT, settings.name, _HINT, settings.every_s)
        return receiver(settings, port, LAYOUT, clock, CHANNELS)
