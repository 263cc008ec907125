"""Records out of a stream of bytes: where each begins, and when it was on the wire.

A record's stamp is when its first byte was on the wire: the moment the chunk that brought it was read, less
the wire time of that byte and what came after it in the same chunk. On a computer that falls behind, that
moment means nothing: bytes wait in the port and are read in one bunch. The wire time then gives way, so
that stamps keep their order and none lies before the end of the record before it, or after its arrival; such
records are marked `bunched`. Bytes that belong to no record are dropped up to the next possible start; a run
of them counts as one rejection.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

from fieldkit.drivers.decoding import Channel, Layout, Record
from fieldkit.model.clock import Clock
from fieldkit.model.units import SECOND_NS

_CHUNKS_KEPT = 64  # far more than one record is made of
_REFUSED_KEPT = 4096
_LONG_AGO_NS = -(2**63)
_HELD_BACK_NS = 20_000_000  # by an adapter at most: the latency timer of an FTDI chip is 16 ms


class Stamped(NamedTuple):
    """A record, its bytes, when its first byte was on the wire, and whether it waited among others."""

    record: Record
    raw: bytes
    mono_ns: int
    bunched: bool = False


class Arrival(NamedTuple):
    """A chunk: bytes received up to its end, when it was read, and how long after the one before it."""

    received: int
    mono_ns: int
    after_ns: int


_NOTHING_BEFORE: tuple[Arrival, tuple[Channel, ...], bool] = (Arrival(0, 0, 0), (), False)


class Framer:
    """Takes chunks in, gives records out; `byte_ns` is the wire time of one byte.

    `feed` has a short path for a chunk that is exactly one record: it is the usual case, and the goals of
    ``benchmarks/drivers_serial.py`` are out of reach without it.
    """

    def __init__(self, byte_ns: int) -> None:
        self.received: int = 0
        """Bytes received so far."""
        self.left: bytes = b""
        """Bytes of earlier chunks that are no record yet, or further ones."""
        self.rejected: int = 0
        self.reason: str = ""
        """Reason why the last bytes that are no record were rejected."""
        self._byte_ns = byte_ns
        self._arrivals: deque[Arrival] = deque(maxlen=_CHUNKS_KEPT)
        self._read_ns = self._passed_ns = _LONG_AGO_NS
        self._passed = 0  # bytes up to the end of the last record, which was on the wire at `_passed_ns`
        self._before = _NOTHING_BEFORE
        self._asked = False
        self._refused = b""

    @property
    def unread(self) -> bytes:
        """The last bytes received, as far as they were no record."""
        return self._refused + self.left

    def feed(self, layout: Layout, chunk: bytes, mono_ns: int) -> Stamped | None:
        """The next record after a chunk that was read at `mono_ns`, None if the bytes do not make one yet."""
        length = len(chunk)
        self.received += length
        if not self.left and 0 < length <= layout.longest:  # the short path
            record = layout.parse(chunk)
            begun_ns = mono_ns - length * self._byte_ns
            if isinstance(record, Record) and record.length == length and begun_ns >= self._passed_ns:
                self._refused = b""
                self._passed = self.received
                self._passed_ns = self._read_ns = mono_ns
                return Stamped(record, chunk, begun_ns)
        self.left += chunk
        self._arrivals.append(Arrival(self.received, mono_ns, mono_ns - self._read_ns))
        self._read_ns = mono_ns
        return self.next_record(layout)

    def discard(self) -> None:
        """Discard everything received so far: the next record is a reply and did not wait."""
        self._asked = True
        self.left = self._refused = b""

    def next_record(self, layout: Layout) -> Stamped | None:
        """The next record of what is left of earlier chunks, None if there is none."""
        while buffer := self.left:
            parsed = layout.first(buffer)
            if parsed is None:
                return None
            raw, self.left = buffer[: parsed.length], buffer[parsed.length :]
            if isinstance(parsed, Record):
                self._refused = b""
                return self._stamp(layout, parsed, raw)
            if not self._refused:
                self.rejected += 1
                self.reason = parsed.reason
            self._refused = (self._refused + raw)[-_REFUSED_KEPT:]
        return None

    def _stamp(self, layout: Layout, record: Record, raw: bytes) -> Stamped:
        """A record that was just taken, with its place in time; the place of its end is kept for the next."""
        end = self.received - len(self.left)
        arrival = self._arrival_of(end - len(raw))
        bunched = not self._asked and self._has_waited(layout, arrival, record)
        self._before, self._asked = (arrival, record.channels, bunched), False
        begun_ns = self._when(arrival, end - len(raw))
        self._when(self._arrival_of(end - 1), end)
        return Stamped(record, raw, begun_ns, bunched)

    def _has_waited(self, layout: Layout, arrival: Arrival, record: Record) -> bool:
        """True if a record waited in the port: the wire had no time for it, or two alike came in one chunk.

        Different records that an instrument sends in one burst did not wait, nor what an adapter
        delivers together in its own time.
        """
        before, channels, bunched = self._before
        if before == arrival and bunched:
            return True
        if self._wire_ns(arrival) > arrival.mono_ns - self._passed_ns + _HELD_BACK_NS:
            return True
        if arrival.after_ns <= _HELD_BACK_NS:
            return False
        behind = layout.parse(self.left[: layout.longest]) if self.left else None
        return (before == arrival and channels == record.channels) or (
            isinstance(behind, Record) and behind.channels == record.channels
        )

    def _arrival_of(self, place: int) -> Arrival:
        """The chunk that brought the byte with `place` others before it."""
        while self._arrivals[0].received <= place:
            self._arrivals.popleft()
        return self._arrivals[0]

    def _wire_ns(self, arrival: Arrival) -> int:
        """Wire time of all that came since the end of the last record, up to the end of a chunk."""
        return (arrival.received - self._passed) * self._byte_ns

    def _when(self, arrival: Arrival, place: int) -> int:
        """Time of so many bytes: spread by the wire's time, or over less if there was no more."""
        spread_ns = min(self._wire_ns(arrival), arrival.mono_ns - self._passed_ns)
        behind = arrival.received - place
        self._passed_ns = arrival.mono_ns - behind * spread_ns // (arrival.received - self._passed)
        self._passed = place
        return self._passed_ns


CHUNK_BYTES = 4096


class Port(ABC):
    """Transport of an instrument's bytes, for one program only: a serial line, a HID bridge, a socket.

    `facts` and `path` are its stream's, `identity` is that of the USB adapter, empty for a port that is none,
    `byte_ns` the wire time of one byte.
    """

    path: str
    facts: dict[str, Any]
    byte_ns: int
    identity: str

    def __init__(
        self, path: str, facts: dict[str, Any], clock: Clock, byte_ns: int, identity: str = ""
    ) -> None:
        self.path, self.facts, self.byte_ns, self.identity = path, facts, byte_ns, identity
        self.framer: Framer = Framer(byte_ns)
        self._clock = clock

    def read(self, layout: Layout, timeout_s: float, request: bytes = b"") -> Stamped | None:
        """The next record, or None if none is complete within `timeout_s`.

        With a `request`, everything received so far is discarded and the record is the reply.
        """
        if request:
            self._discard()
            self.write(request)
        deadline_ns = self._clock.mono_ns() + int(timeout_s * 1e9)
        stamped, left_s = self.framer.next_record(layout), timeout_s
        while stamped is None:
            chunk, now_ns = self._receive(left_s), self._clock.mono_ns()
            if chunk:
                stamped = self.framer.feed(layout, chunk, now_ns)
            left_s = (deadline_ns - now_ns) / 1e9
            if left_s <= 0.0:
                break
        return stamped

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError` when the port is gone."""

    @abstractmethod
    def close(self) -> None:
        """Release the port; a second call does nothing."""

    @abstractmethod
    def _receive(self, timeout_s: float) -> bytes:
        """What came, empty if nothing did in that time or a part of it; raises `DeviceLostError`."""

    def _discard(self) -> None:
        """Forget what was received so far."""
        self.framer.discard()


BAUDS = range(50, 4_000_001)
"""From the slowest to the fastest line that Linux names."""
PARITIES = ("N", "E", "O")


@dataclass(frozen=True, slots=True)
class Line:
    """Settings of a serial line; `start + bits + parity + stop` bits make one byte on the wire."""

    baud: int = 9600
    bits: int = 8
    parity: str = "N"
    stop: int = 1

    def __post_init__(self) -> None:
        """Raise `ValueError` for settings that no line has."""
        if self.baud not in BAUDS:
            raise ValueError(f"baud {self.baud!r} is not a whole number from {BAUDS[0]} to {BAUDS[-1]}")
        if self.bits not in (5, 6, 7, 8) or self.parity not in PARITIES or self.stop not in (1, 2):
            raise ValueError(f"no line has bits {self.bits!r}, parity {self.parity!r}, stop {self.stop!r}")

    @property
    def byte_ns(self) -> int:
        """Wire time of one byte in nanoseconds."""
        length = 1 + self.bits + (self.parity != "N") + self.stop
        return length * SECOND_NS // self.baud

    def __str__(self) -> str:
        return f"{self.baud} {self.bits}{self.parity}{self.stop}"
