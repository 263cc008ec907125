"""Records out of a stream of bytes that arrives in chunks: found, stamped, resynchronised.

A record's stamp is when its first byte was on the wire: the moment the chunk that brought it was
read, less the wire time of that byte and what came after it in the same chunk. On a computer that falls
behind, that moment says little: bytes wait in the port and are read in one bunch. Then the wire's time gives
way, so that stamps keep their order and none lies before the end of the record before it, or after the
reading; such records are marked `bunched`. Bytes that are no record are dropped up to the next possible
start; a run of them counts as one rejection.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple, Protocol

from fieldkit.drivers.records import Channel, Layout, Record
from fieldkit.model.samples import new_tuple

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


class Port(Protocol):
    """What a meter needs of the thing that moves its bytes: a serial line, a HID bridge, a socket."""

    path: str
    framer: Framer

    @property
    def facts(self) -> dict[str, Any]:
        """What a stream should record about its port."""

    @property
    def identity(self) -> str:
        """Identity of the USB adapter, empty for a port that is none."""

    @property
    def byte_ns(self) -> int:
        """Wire time of one byte."""

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceLostError` when the port is gone."""

    def read(self, layout: Layout, timeout_s: float, question: bytes = b"") -> Stamped | None:
        """The next record, or None if none is complete within `timeout_s`.

        With a `question` everything received so far is forgotten, and the record is the answer.
        """

    def close(self) -> None:
        """Release the port; a second call does nothing."""


class Framer:
    """Takes chunks in, gives records out; `byte_ns` is the wire time of one byte.

    Written out flat: at ten readings a second nothing stays in the processor's caches, and each step of a
    reading is felt.
    """

    def __init__(self, byte_ns: int) -> None:
        self.received = 0
        """Bytes received so far."""
        self.left = b""
        """Bytes of earlier chunks that are no record yet, or further ones."""
        self.rejected = 0
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
        if not self.left and 0 < length <= layout.longest:  # most chunks are one whole record
            taken = layout.take(chunk)
            begun_ns = mono_ns - length * self._byte_ns
            if isinstance(taken, Record) and taken.length == length and begun_ns >= self._passed_ns:
                self._refused = b""
                self._passed = self.received
                self._passed_ns = self._read_ns = mono_ns
                return new_tuple(Stamped, (taken, chunk, begun_ns, False))
        self.left += chunk
        self._arrivals.append(Arrival(self.received, mono_ns, mono_ns - self._read_ns))
        self._read_ns = mono_ns
        return self.take(layout)

    def discard(self) -> None:
        """Forget everything received so far: the next record answers a request and did not wait."""
        self._asked = True
        self.left = self._refused = b""

    def take(self, layout: Layout) -> Stamped | None:
        """The next record of what is left of earlier chunks, None if there is none."""
        while buffer := self.left:
            taken = layout.take(buffer[: layout.longest])
            if taken is None and len(buffer) < layout.longest:
                return None
            length = taken.length if taken else 1
            self.left = buffer[length:]
            if isinstance(taken, Record):
                self._refused = b""
                return self._stamped(layout, taken, buffer[:length])
            self.rejected += not self._refused
            self._refused = (self._refused + buffer[:length])[-_REFUSED_KEPT:]
        return None

    def _stamped(self, layout: Layout, record: Record, raw: bytes) -> Stamped:
        """A record that was just taken, with its place in time; the place of its end is kept for the next."""
        end = self.received - len(self.left)
        arrival = self._arrival_of(end - len(raw))
        bunched = not self._asked and self._waited(layout, arrival, record)
        self._before, self._asked = (arrival, record.channels, bunched), False
        begun_ns = self._when(arrival, end - len(raw))
        self._when(self._arrival_of(end - 1), end)
        return Stamped(record, raw, begun_ns, bunched)

    def _waited(self, layout: Layout, arrival: Arrival, record: Record) -> bool:
        """Whether a record waited in the port: the wire had no time for it, or two alike came in one chunk.

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
        behind = layout.take(self.left[: layout.longest]) if self.left else None
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
        """When so many bytes had passed: spread by the wire's time, or over less if there was no more."""
        spread_ns = min(self._wire_ns(arrival), arrival.mono_ns - self._passed_ns)
        behind = arrival.received - place
        self._passed_ns = arrival.mono_ns - behind * spread_ns // (arrival.received - self._passed)
        self._passed = place
        return self._passed_ns
