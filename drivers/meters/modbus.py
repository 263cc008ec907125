"""Modbus RTU instruments: pyranometers, pyrheliometers, RTD modules, by a register map.

The engine reads one block of registers in one request and stamps the answer; what the registers mean
is said by a map (`fieldkit.drivers.meters.modbus_map`), ours or the user's own TOML file. Frames:
unit, function, byte count, registers big-endian, CRC-16 low byte first (Modbus over Serial Line 1.02).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.framing import Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.modbus_map import RegisterMap, load_map, packaged
from fieldkit.drivers.meters.units import STREAM_UNITS
from fieldkit.drivers.ports import Line, find_ports, open_port
from fieldkit.drivers.records import Decoded, Layout, Record, Rejected, Taken, Value, decode_records
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found
from fieldkit.model.errors import ConfigError

LONGEST = 255
HIGHEST_UNIT = 247
REQUEST_LENGTH = 8
REFUSALS = {
    1: "illegal function",
    2: "illegal address",
    3: "illegal value",
    4: "device failure",
    5: "it has begun, ask later",
    6: "busy",
    8: "memory parity error",
    10: "no path through the gateway",
    11: "nobody answers behind the gateway",
}
_CRC_TABLE: list[int] = []
_HINT = "check A and B of the wiring, the unit number and the line settings of the instrument"


def crc16(data: bytes) -> int:
    """CRC-16 of Modbus: polynomial A001 reflected, start FFFF."""
    if not _CRC_TABLE:
        _CRC_TABLE.extend(_crc_of_byte(byte) for byte in range(256))
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def _crc_of_byte(crc: int) -> int:
    for _ in range(8):
        crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def request(unit: int, function: int, first: int, count: int) -> bytes:
    """A question for `count` registers from `first`, ready to send."""
    body = struct.pack(">BBHH", unit, function, first, count)
    return body + crc16(body).to_bytes(2, "little")


def take(buffer: bytes, register_map: RegisterMap | None = None) -> Taken:
    """The answer (or a question) at the start of `buffer`; without a map its registers as they are."""
    if len(buffer) < 2:
        return None
    unit, function = buffer[0], buffer[1]
    if unit > HIGHEST_UNIT or function & 0x7F not in (3, 4):
        return Rejected(1, "no answer with registers: unit and function do not fit")
    if function & 0x80:
        return _refusal(buffer)
    if len(buffer) < 3:
        return None
    length = 5 + buffer[2]
    if buffer[2] and buffer[2] % 2 == 0:
        if len(buffer) >= length and _is_whole(buffer[:length]):
            return _answer(buffer[:length], register_map)
    else:
        length = 0
    if len(buffer) >= REQUEST_LENGTH and _is_whole(buffer[:REQUEST_LENGTH]):
        return _question(buffer)
    waits = len(buffer) < max(length, REQUEST_LENGTH)
    return None if waits else Rejected(1, "the CRC does not fit")


def _is_whole(frame: bytes) -> bool:
    return crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


def _refusal(buffer: bytes) -> Taken:
    if len(buffer) < 5:
        return None
    if not _is_whole(buffer[:5]):
        return Rejected(1, "the CRC does not fit")
    return Rejected(5, f"the instrument refuses: {REFUSALS.get(buffer[2], f'code {buffer[2]}')}")


def _question(buffer: bytes) -> Record:
    unit, function, first, count = struct.unpack_from(">BBHH", buffer)
    return Record(
        REQUEST_LENGTH, note=f"question to unit {unit}, function {function}: {count} registers from {first}"
    )


def _answer(frame: bytes, register_map: RegisterMap | None) -> Taken:
    registers = struct.unpack(f">{frame[2] // 2}H", frame[3:-2])
    note = f"answer of unit {frame[0]}, function {frame[1]}, {len(registers)} registers"
    if register_map is None:
        values = (Value(float(count), "", f"register {place}") for place, count in enumerate(registers))
        return Record.of(len(frame), values, note)
    if len(registers) != register_map.count:
        return Rejected(
            len(frame), f"{len(registers)} registers; the map {register_map.title} has {register_map.count}"
        )
    return Record.of(len(frame), register_map.values(registers), note)


def layout(register_map: RegisterMap | None) -> Layout:
    """How answers look on the wire; with a map, what they mean."""
    return Layout(partial(take, register_map=register_map), LONGEST)


class Modbus:
    """Driver of Modbus RTU instruments.

    Options: `map` (a packaged map or a TOML file), `unit` (the instrument's number, 1), `baud` and `parity`
    where they are not the map's, and those of every meter.
    """

    name = "modbus"
    title = "Modbus RTU instrument by register map"
    quantity = "irradiance"
    options = (*meter.OPTIONS, "map", "unit", "baud", "parity")

    def find(self) -> list[Found]:
        """Serial adapters; an RS-485 adapter does not tell what hangs on it."""
        return find_ports(self.name, self.title, (), f"any adapter; needs map = {' | '.join(packaged())}")

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; see `fieldkit.drivers.records.Decodes`. Option `map`; without it raw registers."""
        name = options.get("map")
        decoded = decode_records(data, layout(load_map(str(name)) if name else None))
        rest = data[len(data) - decoded.rest :]
        if len(rest) < 7 or rest[2] % 2 or len(rest) != 5 + rest[2]:
            return decoded
        # as long as an answer says it is, and shorter than the question that a port would wait for
        damaged = Rejected(len(rest), "the CRC does not fit", len(data) - len(rest))
        return replace(decoded, rejected=(*decoded.rejected, damaged), rest=0)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and wait for the first answer."""
        name = options.text(settings, "map", "")
        if not name:
            raise ConfigError(
                f"{settings.name}: which instrument?", fix=f"map = one of {', '.join(packaged())}, or a file"
            )
        register_map = load_map(name)
        question = request(_unit(settings), register_map.function, register_map.first, register_map.count)
        port = open_port(settings, _line(settings, register_map), clock)
        answers = layout(register_map)
        meter.first_answer(port, question, answers, settings.name, _HINT)
        keys = [channel.name for channel in register_map.channels if channel.unit == register_map.unit]
        names = options.labels(settings, keys)
        unit = STREAM_UNITS.get(register_map.unit, register_map.unit)
        info = meter.describe(settings, port, answers, register_map.quantity, unit, names, register_map.title)
        if component := _component(settings, port, register_map):
            info = replace(info, measures=(component,) * len(names))
        asking = meter.Asking(question, settings.every_s)
        return meter.Meter(info, port, answers, clock, keys[: len(names)], asking=asking)


def _unit(settings: DeviceSettings) -> int:
    """The number of the instrument on its line; 0 addresses all of them and is never answered."""
    return int(options.number(settings, "unit", 1, (1, HIGHEST_UNIT)))


def _component(settings: DeviceSettings, port: Port, register_map: RegisterMap) -> str:
    """What the instrument measures, by its map or its type; empty where neither says."""
    if register_map.type_register is None:
        return register_map.measures.get("", "")
    question = request(_unit(settings), register_map.function, register_map.type_register, 1)
    found = port.read(layout(None), meter.ANSWER_S, question)
    while found is not None and not found.record.numbers:  # some adapters echo the question
        found = port.read(layout(None), meter.ANSWER_S)
    return "" if found is None else register_map.measures.get(int(found.record.numbers[0]), "")


def _line(settings: DeviceSettings, register_map: RegisterMap) -> Line:
    line = register_map.line
    parity = options.text(settings, "parity", line.parity, ("N", "E", "O"))
    return Line(int(options.number(settings, "baud", line.baud)), line.bits, parity, line.stop)
