"""Decoding: bytes to values in the instrument's own units, or the reason for rejecting them.

A meter's protocol is a `Layout`: one pure function that gets the start of a buffer and returns a record, a
rejection (how many bytes to drop, and why) or None (too short to decide). Everything that moves bytes (the
serial port, `fieldkit decode`) works with that alone. A record keeps its numbers apart from their
description, which rarely changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

from fieldkit.model.samples import NO_COUNTER, Quality


class Channel(NamedTuple):
    """Description of a number: its name, its unit, and its quality.

    `states` are the instrument's own states ("hold", "low_battery") that no `Quality` covers.
    """

    name: str
    unit: str
    quality: Quality = Quality.GOOD
    states: tuple[str, ...] = ()


class Value(NamedTuple):
    """One value in the unit the instrument used; NaN where it shows none.

    `states` are the instrument's own states ("hold", "low_battery") that no `Quality` covers.
    """

    value: float
    unit: str
    channel: str
    quality: Quality = Quality.GOOD
    states: tuple[str, ...] = ()

    @property
    def flags(self) -> list[str]:
        """Quality and words as lower-case names."""
        return [flag.name.lower() for flag in self.quality if flag.name] + list(self.states)


class Record(NamedTuple):
    """One record at the start of a buffer, `length` bytes long: numbers, and the channel of each.

    Returning the same `channels` object while only the numbers change lets the meter reuse its conversion.
    `note` describes what is not a value (a request, a mode, a range); `device_time` is the
    instrument's own time.
    """

    length: int
    numbers: tuple[float, ...] = ()
    channels: tuple[Channel, ...] = ()
    note: str = ""
    device_time: int = NO_COUNTER

    @classmethod
    def of(
        cls, length: int, values: Iterable[Value], note: str = "", device_time: int = NO_COUNTER
    ) -> Record:
        """A record of `values`."""
        described = tuple(values)
        channels = tuple(Channel(v.channel, v.unit, v.quality, v.states) for v in described)
        return cls(length, tuple(value.value for value in described), channels, note, device_time)

    @property
    def values(self) -> tuple[Value, ...]:
        """Each number with its description."""
        pairs = zip(self.numbers, self.channels, strict=True)
        return tuple(
            Value(number, value.unit, value.name, value.quality, value.states) for number, value in pairs
        )


class Rejected(NamedTuple):
    """Bytes that are not a record, and why; `offset` counts from the start of the data."""

    length: int
    reason: str
    offset: int = 0


Parsed = Record | Rejected | None


@dataclass(frozen=True, slots=True)
class Layout:
    """Form of records on the wire: `parse` gets at most `longest` bytes and needs no more."""

    parse: Callable[[bytes], Parsed]
    longest: int

    def first(self, buffer: bytes) -> Parsed:
        """What is at the start of `buffer`, None if more bytes may still decide that."""
        parsed = self.parse(buffer[: self.longest])
        is_endless = parsed is None and len(buffer) >= self.longest
        return Rejected(1, "no end of record found") if is_endless else parsed


@dataclass(frozen=True, slots=True)
class Decoded:
    """Everything decoded from a byte string: values, rejected parts, and bytes left over at the end."""

    values: tuple[Value, ...]
    rejected: tuple[Rejected, ...] = ()
    rest: int = 0
    notes: tuple[str, ...] = ()

    @property
    def refused(self) -> int:
        """Number of bytes in rejected parts."""
        return sum(part.length for part in self.rejected)


@runtime_checkable
class Decodes(Protocol):
    """A driver that can decode bytes without an instrument."""

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain `data`; never raises for any bytes."""


class RecordDriver:
    """Base of the drivers of instruments whose records have a `layout`."""

    layout: Layout

    def layout_for(self, options: Mapping[str, Any]) -> Layout:
        """The layout by the driver's options."""
        return self.layout

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; see `Decodes`."""
        return decode_records(data, self.layout_for(options))


def skip_to(start: bytes, data: bytes) -> int:
    """Number of bytes to drop so that the rest begins with (a part of) `start`, at least one."""
    place = data.find(start, 1)
    return place if place > 0 else len(data)


def decode_records(data: bytes, layout: Layout) -> Decoded:
    """Split `data` into records, as the serial port would."""
    values: list[Value] = []
    rejected: list[Rejected] = []
    notes: list[str] = []
    position = 0
    while position < len(data):
        record = layout.first(data[position : position + layout.longest])
        if record is None:
            break
        if isinstance(record, Record):
            values.extend(record.values)
            notes.extend([record.note] if record.note else [])
        else:
            _note_rejected(rejected, record, position)
        position += record.length
    return Decoded(tuple(values), tuple(rejected), len(data) - position, tuple(notes))


def text_of(raw: bytes) -> str:
    """The ASCII text of a field, which a zero may end."""
    return raw.split(b"\0")[0].decode("ascii", "replace").strip()


def _note_rejected(rejected: list[Rejected], part: Rejected, position: int) -> None:
    """Append a rejected part; neighbours become one, with the first reason."""
    if rejected and rejected[-1].offset + rejected[-1].length == position:
        first = rejected[-1]
        rejected[-1] = Rejected(first.length + part.length, first.reason, first.offset)
    else:
        rejected.append(Rejected(part.length, part.reason, position))
