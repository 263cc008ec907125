"""Konica Minolta T-10, T-10A (illuminance) and CL-200, CL-200A (illuminance and colour).

9600 7E1. One framing: 02, head (2 digits), command (2 digits), 4 characters of parameters or status,
three data fields of 6 characters in a long record, 03, check (2 hexadecimal characters), CR LF.
The check is the XOR of every byte after 02 up to and including 03. Source: the communication
manuals as several independent public drivers follow them; framing and data fields are certain,
the CL-200 commands rest on one source.

Status: hold digit (odd: held, which is how a CL-200 measures), error (space or ``7`` none, ``1`` head off,
``2`` ``3`` EEPROM, ``4`` not held, in the reply to 40 alone, ``5`` over range, ``6`` too dark for colour),
range in use (CL-200: ``6`` outside of all), battery (``1`` ``3`` low). Data field: sign, four digits, padded
by spaces, exponent e; value = digits x 10^(e-4). A field of spaces is a value the meter does not have.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import reduce
from operator import xor

from fieldkit.drivers import options
from fieldkit.drivers.decoding import Layout, Parsed, Record, Rejected, Value, skip_to
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceError, DeviceTimeoutError
from fieldkit.model.samples import Quality

SHORT, LONG = 14, 32
LINE = Line(9600, 7, "E")
HEADS = (0, 29)
KINDS = ((0x0403, 0x6001),)
LATENCY_S = 0.25  # half of the 500 ms after which the meter refreshes its value
FIELDS = {  # command: (channel, unit) of its three data fields
    b"10": (("illuminance", "lx"), ("difference", "lx"), ("percent", "%")),
    b"11": (("integrated", "lx h"), ("integrated hours", "h"), ("percent", "%")),
    b"01": (("X", ""), ("Y", "lx"), ("Z", "")),
    b"02": (("illuminance", "lx"), ("x", ""), ("y", "")),
    b"03": (("illuminance", "lx"), ("u'", ""), ("v'", "")),
    b"08": (("illuminance", "lx"), ("colour temperature", "K"), ("duv", "")),
    b"15": (("illuminance", "lx"), ("dominant wavelength", "nm"), ("purity", "%")),
}
ERRORS = {ord("1"): "head_off", ord("2"): "eeprom", ord("3"): "eeprom", ord("5"): "over_range"}
OUT_OF_RANGE = ord("6")
FREE_RUNNING = (b"10", b"11")
"""Commands of a T-10, whose value stands still while it is held."""

BROKEN = {"1": "its head is off", "2": "its EEPROM fails", "3": "its EEPROM fails", "4": "it is not held"}
_START = b"\x02"
_START_WITH_PARITY = b"\x82"  # as a port sees it that does not strip the parity
_HEADER = re.compile(rb"\x02([0-9]{2})([0-9]{2})(.{4})", re.DOTALL)
_STATUS = re.compile(rb"[0-9 ][0-7 ][0-6 ][0-3 ]")
_FIELD = re.compile(rb"([+-])( *[0-9]+)([0-9])")
_HINT = "switch the meter on with its PC mode reachable; the line is 9600 7E1"


def check(body: bytes) -> bytes:
    """The two check characters of everything between 02 and CR LF, 03 included."""
    return b"%02X" % reduce(xor, body, 0)


def pack_request(head: int, command: str, parameters: str) -> bytes:
    """A request to the meter, ready to send."""
    body = f"{head:02d}{command}{parameters:4}".encode() + b"\x03"
    return _START + body + check(body) + b"\r\n"


def parse(buffer: bytes) -> Parsed:
    """The record at the start of `buffer`, short or long."""
    if buffer[:1] not in (_START, _START_WITH_PARITY):
        return Rejected(skip_to(_START, buffer), "does not begin with 02")
    if len(buffer) < SHORT:
        return None
    length = SHORT if buffer[9] & 0x7F == 0x03 else LONG
    if len(buffer) < length:
        return None
    wrong = _wrong(buffer[:length])
    if wrong:
        return Rejected(skip_to(_START, buffer), wrong)
    return _short(buffer) if length == SHORT else _long(buffer)


def _wrong(record: bytes) -> str:
    """Reason why a record is none, empty if it is one."""
    body, tail = record[1:-4], record[-4:]
    if max(record) > 0x7F:
        masked = bytes(byte & 0x7F for byte in record)
        return "high bits are set" if _wrong(masked) else "bit 7 is parity: open this port 7E1"
    if body[-1] != 0x03 or tail[2:] != b"\r\n" or not _HEADER.match(record):
        return "not of the form 02 head command status [data] 03 check CR LF"
    if tail[:2].upper() != check(body):
        return f"check is {tail[:2].decode()}, should be {check(body).decode()}"
    return ""


def _short(buffer: bytes) -> Record:
    head, command = buffer[1:3].decode(), buffer[3:5].decode()
    return Record(SHORT, note=f"head {head}, command {command}, {buffer[5:9].decode()!r}")


def _long(buffer: bytes) -> Parsed:
    head, command, status = buffer[1:3].decode(), buffer[3:5], buffer[5:9]
    fields = [buffer[start : start + 6] for start in (9, 15, 21)]
    matches = [_FIELD.fullmatch(field) for field in fields]
    names = FIELDS.get(command)
    if names is None:
        return Rejected(skip_to(_START, buffer), f"no measured values: command {command.decode()}")
    if not _STATUS.fullmatch(status):
        return Rejected(skip_to(_START, buffer), f"no status of a meter: {status.decode()!r}")
    if any(match is None and field.strip() for match, field in zip(matches, fields, strict=True)):
        return Rejected(skip_to(_START, buffer), "data fields are not sign, digits, exponent")
    quality, states = _states(command, status)
    where = "" if head == "00" else f" head {head}"
    is_known = not quality & Quality.NO_VALUE
    values = [
        Value(_number(match) if is_known else math.nan, unit, name + where, quality, states)
        for (name, unit), match in zip(names, matches, strict=True)
        if match
    ]
    if matches[0] is None:
        values.insert(0, Value(math.nan, names[0][1], names[0][0] + where, Quality.NO_VALUE, states))
    note = f"head {head}, command {command.decode()}, range {chr(status[2])}"
    return Record.of(LONG, values, note)


def _states(command: bytes, status: bytes) -> tuple[Quality, tuple[str, ...]]:
    """Quality and states from the four status characters."""
    hold, error, range_status, battery = status
    quality = Quality.GOOD
    states = [ERRORS[error]] if error in ERRORS else []
    if states:
        quality |= Quality.NO_VALUE  # the digits are still sent, and mean nothing
    if range_status == OUT_OF_RANGE:
        states.append("out_of_range")
        quality |= Quality.NO_VALUE
    if error == ord("5") or range_status == OUT_OF_RANGE:
        quality |= Quality.OVERRANGE
    if error == ord("6"):
        states.append("too_dark_for_colour")
    if hold in b"13579" and command in FREE_RUNNING:
        quality |= Quality.STALE
        states.append("hold")
    if battery in b"13":
        states.append("low_battery")
    return quality, tuple(states)


def _number(field: re.Match[bytes]) -> float:
    sign, digits, exponent = field.groups()
    value = int(digits + b"0" * int(exponent)) / 10**4  # whole numbers first: 35.8, not 35.800000000000004
    return -value if sign == b"-" else value


LAYOUT = Layout(parse, LONG)


class KonicaMinolta(SerialDriver):
    """Driver of the illuminance meters T-10(A) and CL-200(A).

    Options: `model` (``t-10`` or ``cl-200``), `head` (0-29), and those of every meter.
    """

    name = "konica-minolta"
    title = "Konica Minolta T-10(A), CL-200(A)"
    quantity = "illuminance"
    options: tuple[str, ...] = (*meter.OPTIONS, "model", "head")
    layout = LAYOUT
    kinds = KINDS
    probes: Sequence[Probe] = (Probe(LINE, pack_request(0, "54", "1")),)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and put the meter into its PC mode."""
        model = options.text(settings, "model", "t-10", ("t-10", "cl-200"))
        head = options.whole(settings, "head", 0, HEADS)
        port = open_port(settings, LINE, clock, kinds=KINDS)
        _enter_pc_mode(port, clock, settings.name)
        poll = _prepare(port, clock, model, head, settings.every_s)
        info = meter.describe(
            settings, port, LAYOUT, "illuminance", "lx", ("lux",), model=model, latency_s=LATENCY_S
        )
        key = "illuminance" if head == 0 else f"illuminance head {head:02d}"
        return meter.Meter(info, port, LAYOUT, clock, (key,), poll=poll)


def _enter_pc_mode(port: Port, clock: Clock, name: str) -> None:
    """Command 54 must come first; the meter then needs half a second."""
    if port.read(LAYOUT, meter.REPLY_TIMEOUT_S, pack_request(0, "54", "1")) is None:
        raise DeviceTimeoutError(f"no reply to the PC mode command from {port.path}", place=name, fix=_HINT)
    clock.sleep(0.5)


def _prepare(port: Port, clock: Clock, model: str, head: int, every_s: float) -> meter.PollSettings:
    """Set the measuring conditions; returns how to poll each reading."""
    if model == "t-10":
        running = pack_request(head, "10", "0200")  # run, no colour correction, automatic range
        port.write(running)
        clock.sleep(3.0)  # until the automatic range has settled
        return meter.PollSettings(running, every_s)
    _hold(port, clock, head)
    trigger = pack_request(99, "40", "21")
    return meter.PollSettings(pack_request(head, "02", "1200"), every_s, trigger=trigger, settle_s=0.5)


def _hold(port: Port, clock: Clock, head: int) -> None:
    """Hold the meter, so that each trigger takes one measurement; it may need the command twice."""
    refusal = ""
    for _ in range(2):
        port.write(pack_request(99, "55", "1  0"))
        clock.sleep(0.5)
        reply = port.read(LAYOUT, meter.REPLY_TIMEOUT_S, pack_request(head, "40", "10"))
        refusal = BROKEN.get(reply.raw[6:7].decode(), "") if reply else "it does not reply"
        if not refusal:
            return
    raise DeviceError(f"cannot be triggered: {refusal}", place=port.path, fix=_HINT)
