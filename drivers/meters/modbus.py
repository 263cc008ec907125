"""Modbus RTU instruments: pyranometers, pyrheliometers, RTD modules, by a register map.

The engine reads one block of registers in one request and stamps the answer; a register map
defines what the registers mean (`RegisterMap`), packaged or the user's own TOML file. Frames:
unit, function, byte count, registers big-endian, CRC-16 low byte first (Modbus over Serial Line 1.02). By
Modbus TCP the same frame stands without its CRC behind a transaction number, two zero bytes and its length
(Modbus Messaging on TCP/IP 1.0b).
"""

from __future__ import annotations

import json
import math
import struct
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from fieldkit.drivers import options
from fieldkit.drivers.connections import is_address
from fieldkit.drivers.decoding import Decoded, Layout, Parsed, Record, Rejected, Value, decode_records
from fieldkit.drivers.framing import PARITIES, Line, Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, baud, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.quantities import COMPONENTS, meaning_of
from fieldkit.model.samples import Quality

# --- register maps

FOLDER = Path(__file__).with_name("modbus_maps")
TYPES = {"u16": "H", "s16": "h", "u32": "I", "s32": "i", "f32": "f"}
NOT_IMPLEMENTED = {
    "u16": (0xFFFF,),
    "s16": (-0x8000, 0x7FFF),
    "u32": (0xFFFFFFFF,),
    "s32": (-0x80000000, 0x7FFFFFFF),
    "f32": (),
}
"""Counts of a type that stand for no value, as in SunSpec's information model, and for beyond the range."""
MOST_DECIMALS = 9  # a scale of more was not written by an instrument that measures
LEAST_MEASURED = 1e-12  # of a float; nearer to zero are only those whose words are in the wrong order
_QUALITIES = {"": Quality.GOOD, "stale": Quality.STALE, "overrange": Quality.OVERRANGE}
MOST_REGISTERS = 125  # of one reply
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Channel:
    """One value in the block.

    `words_low_first` swaps the two registers of a 32-bit type; `decimals_register` holds a signed power
    of ten by which the value is divided.
    """

    name: str
    register: int
    type: Literal["u16", "s16", "u32", "s32", "f32"] = "u16"
    unit: str = ""
    scale: Finite = 1.0
    offset: Finite = 0.0
    decimals_register: int | None = None
    words_low_first: bool = False
    repeat: Annotated[int, Field(ge=1, le=MOST_REGISTERS)] = 1

    @property
    def width(self) -> int:
        """Registers it takes."""
        return struct.calcsize(TYPES[self.type]) // 2


@dataclass(frozen=True, slots=True)
class StatusBit:
    """One bit of the status register, as a state and, where it invalidates the values, a quality."""

    bit: Annotated[int, Field(ge=0, le=15)]
    word: str
    quality: Literal["", "stale", "overrange"] = ""


@dataclass(frozen=True, slots=True)
class Status:
    """The register whose bits are states of the instrument."""

    register: int | None = None
    bits: tuple[StatusBit, ...] = ()


def _repeat(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """T1 ... Tn from one entry that is to be repeated: number and register count up."""
    return tuple(
        replace(
            channel,
            name=f"{channel.name.rstrip('0123456789')}{number + 1}" if channel.repeat > 1 else channel.name,
            register=channel.register + number * channel.width,
            repeat=1,
        )
        for channel in channels
        for number in range(channel.repeat)
    )


class RegisterMap(BaseModel):
    """One block of registers and its meaning, as in its file; `no_value` are raw counts.

    `limits` are the values that can be. `measures` is the component of radiation
    (`fieldkit.model.radiation`), by type where one map serves instruments of several: `type_register` then
    holds the instrument's type. "" stands for any type, or none.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        frozen=True, extra="forbid", strict=True, populate_by_name=True
    )

    title: str
    quantity: str
    unit: str
    line: Line = Line()
    function: Literal[3, 4]
    first: Annotated[int, Field(ge=0)]
    count: Annotated[int, Field(ge=1, le=MOST_REGISTERS)]
    channels: Annotated[tuple[Channel, ...], AfterValidator(_repeat)] = Field(alias="channel")
    no_value: tuple[int, ...] = ()
    measures: dict[str, str] = Field(default_factory=dict)
    type_register: int | None = None
    limits: tuple[float, float] = Field(default=(-math.inf, math.inf), alias="range")
    status: Status = Status()

    def values(self, registers: Sequence[int]) -> tuple[Value, ...]:
        """Values of a block of `count` registers (unsigned)."""
        quality, states = self._status(registers)
        return tuple(self._value(channel, registers, quality, states) for channel in self.channels)

    def _status(self, registers: Sequence[int]) -> tuple[Quality, tuple[str, ...]]:
        if self.status.register is None:
            return Quality.GOOD, ()
        state = registers[self.status.register - self.first]
        present = [entry for entry in self.status.bits if state >> entry.bit & 1]
        quality = Quality.GOOD
        for entry in present:
            quality |= _QUALITIES[entry.quality]
        return quality, tuple(entry.word for entry in present)

    def _value(
        self, channel: Channel, registers: Sequence[int], quality: Quality, states: tuple[str, ...]
    ) -> Value:
        place = channel.register - self.first
        raw = list(registers[place : place + channel.width])
        if channel.words_low_first:
            raw.reverse()
        packed = struct.pack(f">{channel.width}H", *raw)
        (number,) = struct.unpack(f">{TYPES[channel.type]}", packed)
        counts = {number, int.from_bytes(packed, "big")}  # a map may write FFFF or -1
        power_at = channel.decimals_register
        decimals = 0 if power_at is None else _as_signed(registers[power_at - self.first])
        # 234 tenths are 23.4 by division; by multiplication they would be 23.400000000000002
        power = 10.0**decimals if abs(decimals) <= MOST_DECIMALS else math.nan
        value = number / (1 / channel.scale) / power + channel.offset
        low, high = self.limits
        if not math.isfinite(value) or 0.0 < abs(number) < LEAST_MEASURED:
            states = ("not_a_number", *states)
        elif counts & {*self.no_value, *NOT_IMPLEMENTED[channel.type]} or not low <= value <= high:
            states = ("open", *states)
        else:
            return Value(value, channel.unit, channel.name, quality, states)
        return Value(math.nan, channel.unit, channel.name, quality | Quality.NO_VALUE, states)


def packaged_maps() -> list[str]:
    """Names of the maps that come with fieldkit."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_map(name: str) -> RegisterMap:
    """A packaged map by name, or one in a file; raises `ConfigError` with what is wrong and where."""
    path = FOLDER / f"{name}.toml" if name in packaged_maps() else Path(name)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            "no such register map",
            place=name,
            fix=f"name one of these: {', '.join(packaged_maps())}, or give a file",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            str(error), place=path, fix="repair the file; see the how-to on register maps"
        ) from error
    try:
        return _read_map(table)
    except (ValueError, TypeError) as error:
        fix = "compare with the map rtd-8 that comes with fieldkit"
        raise ConfigError(message_of(error), place=path, fix=fix) from error


def _read_map(table: Mapping[str, Any]) -> RegisterMap:
    # as JSON, whose strict reading takes tables for dataclasses and lists for tuples
    document = {**table, **_measures(table.get("measures", {}))}
    register_map = RegisterMap.model_validate_json(json.dumps(document, default=str))
    _check(register_map)
    return register_map


def _measures(measures: str | Mapping[str, Any]) -> dict[str, Any]:
    """Quantity that the instrument measures: one component, or the types of instruments that measure each."""
    types = {} if isinstance(measures, str) else dict(measures)
    register = types.pop("type_register", None)
    by_type: dict[int | str, str] = {"": measures} if isinstance(measures, str) else {}
    by_type |= {number: component for component, numbers in types.items() for number in numbers}
    if wrong := set(by_type.values()) - set(COMPONENTS):
        raise ValueError(f"measures {wrong.pop()!r} is none of {', '.join(COMPONENTS)}")
    if (register is None) != ("" in by_type or not by_type):
        raise ValueError("measures by type: type_register, and the types of each component")
    return {"measures": by_type, "type_register": register}


def _check(register_map: RegisterMap) -> None:
    first, end = register_map.first, register_map.first + register_map.count
    if end > 0x10000:
        raise ValueError(f"first {first} and count {register_map.count} are not within 65536 registers")
    for channel in register_map.channels:
        if not channel.scale:
            raise ValueError(f"channel {channel.name}: scale 0 leaves nothing of the value")
        last = channel.register + channel.width - 1
        registers = (channel.register, last, channel.decimals_register, register_map.status.register)
        for register in registers:
            if register is not None and not first <= register < end:
                raise ValueError(
                    f"channel {channel.name}: register {register} is not among {first} to {end - 1} read"
                )
    if not any(channel.unit == register_map.unit for channel in register_map.channels):
        raise ValueError(f"no channel has the unit of the stream, {register_map.unit}")


def _as_signed(register: int) -> int:
    return register - 0x10000 if register & 0x8000 else register


LONGEST = 255
HIGHEST_UNIT = 247
REQUEST_LENGTH = 8
TCP_PORT = 502
"""Where Modbus TCP is at home; at other addresses an adapter passes on the frames of a serial line."""
FRAMINGS = ("rtu", "tcp")
UNITS = (1, 2, 3)  # that are asked for an instrument: 1 is the factory's of all that have a map
_TRANSACTION = 1  # one request at a time needs no more
_HEADER_LENGTH = 6
REFUSALS = {
    1: "illegal function",
    2: "illegal address",
    3: "illegal value",
    4: "device failure",
    5: "accepted, poll again later",
    6: "busy",
    8: "memory parity error",
    10: "no path through the gateway",
    11: "no reply behind the gateway",
}
_HINT = "check A and B of the wiring, the unit number and the line settings of the instrument"


def crc16(data: bytes) -> int:
    """CRC-16 of Modbus: polynomial A001 reflected, start FFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _crc_of_byte((crc ^ byte) & 0xFF)
    return crc


@cache
def _crc_of_byte(crc: int) -> int:
    for _ in range(8):
        crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def pack_request(unit: int, function: int, first: int, count: int) -> bytes:
    """A request for `count` registers from `first`, ready to send."""
    body = struct.pack(">BBHH", unit, function, first, count)
    return body + crc16(body).to_bytes(2, "little")


def parse(buffer: bytes, register_map: RegisterMap | None = None, asked: bytes = b"") -> Parsed:
    """The reply (or a request) at the start of `buffer`; without a map its registers as they are.

    `asked` are unit and function of the only replies that count, where they are known.
    """
    if len(buffer) < 2:
        return None
    unit, function = buffer[0], buffer[1]
    if unit > HIGHEST_UNIT or function & 0x7F not in (3, 4):
        return Rejected(1, "not a reply with registers: unit and function do not fit")
    if function & 0x80:
        return _refusal(buffer)
    if len(buffer) < 3:
        return None
    length = 5 + buffer[2]
    if buffer[2] and buffer[2] % 2 == 0:
        if len(buffer) >= length and _is_whole(buffer[:length]):
            return _reply(buffer[:length], register_map, asked)
    else:
        length = 0
    if len(buffer) >= REQUEST_LENGTH and _is_whole(buffer[:REQUEST_LENGTH]):
        return _request(buffer)
    waits = len(buffer) < max(length, REQUEST_LENGTH)
    return None if waits else Rejected(1, "the CRC does not fit")


def parse_tcp(buffer: bytes, register_map: RegisterMap | None = None, asked: bytes = b"") -> Parsed:
    """The Modbus TCP frame at the start of `buffer`; see `parse`."""
    if len(buffer) < _HEADER_LENGTH:
        return None
    _, protocol, length = struct.unpack_from(">HHH", buffer)
    if protocol or not 3 <= length < LONGEST:
        return Rejected(1, "not a header of Modbus TCP")
    end = _HEADER_LENGTH + length
    if len(buffer) < end:
        return None
    frame = buffer[_HEADER_LENGTH:end]
    parsed = parse(frame + crc16(frame).to_bytes(2, "little"), register_map, asked)
    if parsed is None or parsed.length < length:  # its own length is another
        return Rejected(end, parsed.reason if isinstance(parsed, Rejected) else "not a reply with registers")
    return parsed._replace(length=end)


def _is_whole(frame: bytes) -> bool:
    return crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


def _refusal(buffer: bytes) -> Parsed:
    if len(buffer) < 5:
        return None
    if not _is_whole(buffer[:5]):
        return Rejected(1, "the CRC does not fit")
    return Rejected(5, f"the instrument refuses: {REFUSALS.get(buffer[2], f'code {buffer[2]}')}")


def _request(buffer: bytes) -> Record:
    unit, function, first, count = struct.unpack_from(">BBHH", buffer)
    return Record(
        REQUEST_LENGTH, note=f"request to unit {unit}, function {function}: {count} registers from {first}"
    )


def _reply(frame: bytes, register_map: RegisterMap | None, asked: bytes) -> Parsed:
    registers = struct.unpack(f">{frame[2] // 2}H", frame[3:-2])
    note = f"reply of unit {frame[0]}, function {frame[1]}, {len(registers)} registers"
    if not frame.startswith(asked):
        return Rejected(len(frame), f"{note}; asked were unit {asked[0]}, function {asked[1]}")
    if register_map is None:
        values = (Value(float(count), "", f"register {place}") for place, count in enumerate(registers))
        return Record.of(len(frame), values, note)
    if len(registers) != register_map.count:
        return Rejected(
            len(frame), f"{len(registers)} registers; the map {register_map.title} has {register_map.count}"
        )
    return Record.of(len(frame), register_map.values(registers), note)


def layout(register_map: RegisterMap | None, request: bytes = b"", framing: str = "rtu") -> Layout:
    """The layout of replies, those to `request` alone if it is given; with a map, what they mean."""
    parser, longest = (parse_tcp, LONGEST + _HEADER_LENGTH) if framing == "tcp" else (parse, LONGEST)
    return Layout(partial(parser, register_map=register_map, asked=request[:2]), longest)


class Modbus(SerialDriver):
    """Driver of Modbus instruments.

    Options: `map` (a packaged map or a TOML file), `unit` (the instrument's number, 1), `baud` and `parity`
    where they are not the map's, `framing` (``rtu``, or ``tcp`` for Modbus TCP: usual at port 502), and those
    of every meter.
    """

    name = "modbus"
    title = "Modbus RTU or TCP instrument by register map"
    quantity = "irradiance"
    options: tuple[str, ...] = (*meter.OPTIONS, "map", "unit", "baud", "parity", "framing")
    needs: Mapping[str, Sequence[str]] = {"map": packaged_maps()}

    def __init__(self) -> None:
        self.probes = [_probe(*block) for block in product(packaged_maps(), UNITS, FRAMINGS)]

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; see `fieldkit.drivers.decoding.Decodes`. Option `map`; without it raw registers."""
        name = options.get("map")
        framing = str(options.get("framing", "rtu"))
        decoded = decode_records(data, layout(load_map(str(name)) if name else None, framing=framing))
        rest = data[len(data) - decoded.rest :]
        if framing == "tcp" or len(rest) < 7 or rest[2] % 2 or len(rest) != 5 + rest[2]:
            return decoded
        # as long as a reply declares, and shorter than the request that a port would wait for
        damaged = Rejected(len(rest), "the CRC does not fit", len(data) - len(rest))
        return replace(decoded, rejected=(*decoded.rejected, damaged), rest=0)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and wait for the first reply."""
        name = options.text(settings, "map", "")
        if not name:
            raise ConfigError(
                "which instrument?",
                place=f"{settings.name}.map",
                fix=f"set map to one of {', '.join(packaged_maps())}, or a file",
            )
        register_map = load_map(name)
        function, framing = register_map.function, _framing(settings)
        request = pack_request(_unit(settings), function, register_map.first, register_map.count)
        port = open_port(settings, _line(settings, register_map), clock)
        replies = layout(register_map, request, framing)
        request = _framed(request, framing)
        meter.first_reply(port, request, replies, settings.name, _HINT)
        keys = [channel.name for channel in register_map.channels if channel.unit == register_map.unit]
        meaning = meaning_of(register_map.unit, register_map.quantity)
        unit = meaning.quantity.units.stored if meaning else register_map.unit
        info = meter.describe(settings, port, replies, register_map.quantity, unit, keys, register_map.title)
        if component := _component(settings, port, register_map):
            info = replace(info, measures=(component,) * info.shape[0])
        poll = meter.PollSettings(request, settings.every_s)
        return meter.Meter(info, port, replies, clock, keys, poll=poll)


def _probe(name: str, unit: int, framing: str) -> Probe:
    block = load_map(name)
    request = _framed(pack_request(unit, block.function, block.first, block.count), framing)
    options = {"map": name, "unit": unit, "framing": framing}
    usual = {"unit": 1, "framing": "rtu"}
    return Probe(block.line, request, dict(options.items() - usual.items()), is_tcp=framing == "tcp")


def _unit(settings: DeviceSettings) -> int:
    """The number of the instrument on its line; 0 addresses all of them and is never answered."""
    return options.whole(settings, "unit", 1, (1, HIGHEST_UNIT))


def _framing(settings: DeviceSettings) -> str:
    is_tcp = is_address(settings.port) and settings.port.rstrip("/").endswith(f":{TCP_PORT}")
    return options.text(settings, "framing", "tcp" if is_tcp else "rtu", FRAMINGS)


def _framed(request: bytes, framing: str) -> bytes:
    """A request of `pack_request` as it goes out: without its CRC, and behind a header, by Modbus TCP."""
    head = struct.pack(">HHH", _TRANSACTION, 0, len(request) - 2)
    return head + request[:-2] if framing == "tcp" else request


def _component(settings: DeviceSettings, port: Port, register_map: RegisterMap) -> str:
    """Quantity that the instrument measures, by its map or its type; empty where neither is known."""
    if register_map.type_register is None:
        return register_map.measures.get("", "")
    framing = _framing(settings)
    request = pack_request(_unit(settings), register_map.function, register_map.type_register, 1)
    replies = layout(None, request, framing)
    reply = port.read(replies, meter.REPLY_TIMEOUT_S, _framed(request, framing))
    while reply is not None and not reply.record.numbers:  # some adapters echo the request
        reply = port.read(replies, meter.REPLY_TIMEOUT_S)
    return "" if reply is None else register_map.measures.get(f"{reply.record.numbers[0]:.0f}", "")


def _line(settings: DeviceSettings, register_map: RegisterMap) -> Line:
    line = register_map.line
    parity = options.text(settings, "parity", line.parity, PARITIES)
    return Line(baud(settings, line.baud), line.bits, parity, line.stop)
