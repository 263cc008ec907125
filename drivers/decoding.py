"""What bytes mean: values as the instrument says them, or the reason for rejecting them.

A meter's protocol is a `Layout`: one pure function that looks at the start of a buffer and
says "a record", "not a record, drop so many bytes" or "too short to tell". Everything that
moves bytes (the serial port, `fieldkit decode`) works with that alone. A record keeps its numbers apart from
what is said of them, which hardly ever changes: at ten readings a second the interpreter is cold, and every
step of making a reading is felt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

from fieldkit.model.samples import NO_COUNTER, Quality


class Channel(NamedTuple):
    """What an instrument says beside a number: which one it is, its unit, and how far to trust it.

    `words` are the instrument's own states ("hold", "low_battery") that no `Quality` covers.
    """

    name: str
    unit: str
    quality: Quality = Quality.GOOD
    words: tuple[str, ...] = ()


class Value(NamedTuple):
    """One value in the unit the instrument used; NaN where it shows none.

    `words` are the instrument's own states ("hold", "low_battery") that no `Quality` covers.
    """

    value: float
    unit: str
    channel: str
    quality: Quality = Quality.GOOD
    words: tuple[str, ...] = ()

    @property
    def flags(self) -> list[str]:
        """Quality and words as lower-case names."""
        return [flag.name.lower() for flag in self.quality if flag.name] + list(self.words)


class Record(NamedTuple):
    """One record at the start of a buffer, `length` bytes long: numbers, and the channel of each.

    A decoder that gives the very same `channels` again while nothing but the numbers changes is the quicker.
    `note` says in words what is no value (a request, a mode, a range); `device_time` is the
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
        told = tuple(values)
        channels = tuple(Channel(one.channel, one.unit, one.quality, one.words) for one in told)
        return cls(length, tuple(one.value for one in told), channels, note, device_time)

    @property
    def values(self) -> tuple[Value, ...]:
        """Each number with what is said of it."""
        pairs = zip(self.numbers, self.channels, strict=True)
        return tuple(Value(number, one.unit, one.name, one.quality, one.words) for number, one in pairs)


class Rejected(NamedTuple):
    """Bytes that are no record, and why; `offset` counts from where the reading began."""

    length: int
    reason: str
    offset: int = 0


Parsed = Record | Rejected | None


@dataclass(frozen=True, slots=True)
class Layout:
    """How records look on the wire: `parse` sees at most `longest` bytes and needs no more."""

    parse: Callable[[bytes], Parsed]
    longest: int


@dataclass(frozen=True, slots=True)
class Decoded:
    """All that a stretch of bytes says: values, rejected parts, and bytes left over at the end."""

    values: tuple[Value, ...]
    rejected: tuple[Rejected, ...] = ()
    rest: int = 0
    notes: tuple[str, ...] = ()


@runtime_checkable
class Decodes(Protocol):
    """A driver that can say what bytes mean without an instrument."""

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain `data`; never raises for any bytes."""


def skip_to(start: bytes, data: bytes) -> int:
    """How many bytes to drop so that the rest begins with (a part of) `start`, at least one."""
    found = data.find(start, 1)
    return found if found > 0 else len(data)


def decode_records(data: bytes, layout: Layout) -> Decoded:
    """Take `data` apart into records, as the serial port would."""
    values: list[Value] = []
    rejected: list[Rejected] = []
    notes: list[str] = []
    position = 0
    while position < len(data):
        parsed = layout.parse(data[position : position + layout.longest])
        if parsed is None:
            if len(data) - position < layout.longest:
                break
            parsed = Rejected(1, "no end of record in sight")
        if isinstance(parsed, Record):
            values.extend(parsed.values)
            notes.extend([parsed.note] if parsed.note else [])
        else:
            _note_rejected(rejected, parsed, position)
        position += parsed.length
    return Decoded(tuple(values), tuple(rejected), len(data) - position, tuple(notes))


def _note_rejected(rejected: list[Rejected], part: Rejected, position: int) -> None:
    """Append a rejected part; neighbours become one, with the first reason."""
    if rejected and rejected[-1].offset + rejected[-1].length == position:
        first = rejected[-1]
        rejected[-1] = Rejected(first.length + part.length, first.reason, first.offset)
    else:
        rejected.append(Rejected(part.length, part.reason, position))
