"""Register maps: what the registers of a Modbus instrument mean, read from TOML and checked at once.

A map names one block of registers that is read in one request, and the channels in it.
"""

from __future__ import annotations

import math
import struct
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fieldkit.drivers.ports import Line
from fieldkit.drivers.records import Value
from fieldkit.model.errors import ConfigError
from fieldkit.model.radiation import COMPONENTS
from fieldkit.model.samples import Quality

FOLDER = Path(__file__).with_name("modbus_maps")
TYPES = {"u16": "H", "s16": "h", "u32": "I", "s32": "i", "f32": "f"}
_QUALITIES = {"": Quality.GOOD, "stale": Quality.STALE, "overrange": Quality.OVERRANGE}
_KEYS = (
    "title",
    "quantity",
    "unit",
    "line",
    "function",
    "first",
    "count",
    "no_value",
    "measures",
    "range",
    "channel",
    "status",
)


@dataclass(frozen=True, slots=True)
class Channel:
    """One value in the block.

    `words_low_first` swaps the two registers of a 32-bit type; `decimals_register` holds a signed power
    of ten by which the value is divided.
    """

    name: str
    register: int
    type: str = "u16"
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    decimals_register: int | None = None
    words_low_first: bool = False
    repeat: int = 1

    @property
    def width(self) -> int:
        """Registers it takes."""
        return struct.calcsize(TYPES[self.type]) // 2


@dataclass(frozen=True, slots=True)
class StatusBit:
    """One bit of the status register, as a word and, where it spoils the values, a quality."""

    bit: int
    word: str
    quality: str = ""


@dataclass(frozen=True, slots=True)
class RegisterMap:
    """One block of registers and its meaning; `no_value` are raw counts, `limits` the values that can be.

    `measures` is the component of radiation (`fieldkit.model.radiation`), by type where one map serves
    instruments of several: `type_register` then holds the instrument's type. "" stands for any type, or none.
    """

    title: str
    quantity: str
    unit: str
    line: Line
    function: int
    first: int
    count: int
    channels: tuple[Channel, ...]
    no_value: tuple[int, ...] = ()
    measures: Mapping[int | str, str] = field(default_factory=dict)
    type_register: int | None = None
    limits: tuple[float, float] = (-math.inf, math.inf)
    status_register: int | None = None
    status_bits: tuple[StatusBit, ...] = ()

    def values(self, registers: Sequence[int]) -> tuple[Value, ...]:
        """What a block of `count` registers (unsigned) says."""
        quality, words = self._status(registers)
        return tuple(self._value(channel, registers, quality, words) for channel in self.channels)

    def _status(self, registers: Sequence[int]) -> tuple[Quality, tuple[str, ...]]:
        if self.status_register is None:
            return Quality.GOOD, ()
        state = registers[self.status_register - self.first]
        present = [entry for entry in self.status_bits if state >> entry.bit & 1]
        quality = Quality.GOOD
        for entry in present:
            quality |= _QUALITIES[entry.quality]
        return quality, tuple(entry.word for entry in present)

    def _value(
        self, channel: Channel, registers: Sequence[int], quality: Quality, words: tuple[str, ...]
    ) -> Value:
        place = channel.register - self.first
        taken = list(registers[place : place + channel.width])
        if channel.words_low_first:
            taken.reverse()
        (number,) = struct.unpack(f">{TYPES[channel.type]}", struct.pack(f">{channel.width}H", *taken))
        decimals = (
            0
            if channel.decimals_register is None
            else _signed(registers[channel.decimals_register - self.first])
        )
        # 234 tenths are 23.4 by division; by multiplication they would be 23.400000000000002
        value = number / (1 / channel.scale) / 10.0 ** max(-9, min(decimals, 9)) + channel.offset
        low, high = self.limits
        if not math.isfinite(value):
            words = ("not_a_number", *words)
        elif taken[0] in self.no_value or not low <= value <= high:
            words = ("open", *words)
        else:
            return Value(value, channel.unit, channel.name, quality, words)
        return Value(math.nan, channel.unit, channel.name, quality | Quality.NO_VALUE, words)


def packaged() -> list[str]:
    """Names of the maps that come with fieldkit."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_map(name: str) -> RegisterMap:
    """A packaged map by name, or one in a file; raises `ConfigError` with what is wrong and where."""
    path = FOLDER / f"{name}.toml" if name in packaged() else Path(name)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"no register map {name!r}", fix=f"there are {', '.join(packaged())}, or give a file"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: {error}", fix="repair the file; see the how-to on register maps"
        ) from error
    try:
        return _parse(table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        reason = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)
        raise ConfigError(
            f"{path}: {reason}", fix="compare with the map rtd-8 that comes with fieldkit"
        ) from error


def _parse(table: Mapping[str, Any]) -> RegisterMap:
    unknown = set(table) - set(_KEYS)
    if unknown:
        raise ValueError(f"unknown keys: {', '.join(sorted(unknown))}; known are {', '.join(_KEYS)}")
    status = table.get("status", {})
    low, high = table.get("range", (-math.inf, math.inf))
    found = RegisterMap(
        title=table["title"],
        quantity=table["quantity"],
        unit=table["unit"],
        line=Line(**table.get("line", {})),
        function=int(table["function"]),
        first=int(table["first"]),
        count=int(table["count"]),
        channels=tuple(one for entry in table["channel"] for one in _repeated(Channel(**entry))),
        no_value=tuple(int(count) for count in table.get("no_value", ())),
        **_measures(table.get("measures", {})),
        limits=(float(low), float(high)),
        status_register=status.get("register"),
        status_bits=tuple(StatusBit(**entry) for entry in status.get("bits", ())),
    )
    _check(found)
    return found


def _measures(said: str | Mapping[str, Any]) -> dict[str, Any]:
    """What the instrument measures: one component, or the types of instruments that measure each."""
    if isinstance(said, str):
        by_type: dict[int | str, str] = {"": said}
        register = None
    else:
        register = said.get("type_register")
        types = {component: given for component, given in said.items() if component != "type_register"}
        by_type = {int(one): component for component, given in types.items() for one in given}
    if wrong := set(by_type.values()) - set(COMPONENTS):
        raise ValueError(f"measures {wrong.pop()!r} is none of {', '.join(COMPONENTS)}")
    if (register is None) != ("" in by_type or not by_type):
        raise ValueError("measures by type: type_register, and the types of each component")
    return {"measures": by_type, "type_register": register}


def _repeated(channel: Channel) -> list[Channel]:
    """T1 ... Tn from one entry: number and register count up."""
    if channel.repeat == 1:
        return [channel]
    stem = channel.name.rstrip("0123456789")
    if channel.type not in TYPES:
        raise ValueError(f"channel {channel.name}: type {channel.type!r} is none of {', '.join(TYPES)}")
    return [
        replace(
            channel, name=f"{stem}{number + 1}", register=channel.register + number * channel.width, repeat=1
        )
        for number in range(channel.repeat)
    ]


def _check(found: RegisterMap) -> None:
    if found.function not in (3, 4):
        raise ValueError(f"function {found.function} does not read registers; use 3 or 4")
    if not 1 <= found.count <= 125:
        raise ValueError(f"count {found.count} is not between 1 and 125")
    for channel in found.channels:
        if channel.type not in TYPES:
            raise ValueError(f"channel {channel.name}: type {channel.type!r} is none of {', '.join(TYPES)}")
        if not channel.scale:
            raise ValueError(f"channel {channel.name}: scale 0 leaves nothing of the value")
        needed = [
            channel.register,
            channel.register + channel.width - 1,
            channel.decimals_register,
            found.status_register,
        ]
        for register in needed:
            if register is not None and not found.first <= register < found.first + found.count:
                raise ValueError(
                    f"channel {channel.name}: register {register} is not among {found.first} to "
                    f"{found.first + found.count - 1} that are read"
                )
    for entry in found.status_bits:
        if entry.quality not in _QUALITIES:
            raise ValueError(
                f"status bit {entry.bit}: quality {entry.quality!r} is neither stale nor overrange"
            )
    if not any(channel.unit == found.unit for channel in found.channels):
        raise ValueError(f"no channel has the unit of the stream, {found.unit}")


def _signed(register: int) -> int:
    return register - 0x10000 if register & 0x8000 else register
