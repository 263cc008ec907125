"""Records out of a stream of bytes that arrives in chunks: found, stamped, resynchronised.

A record's stamp is when its first byte was on the wire: the moment the chunk that brought it was
read, less the wire time of that byte and what came after it in the same chunk. Bytes that are no
record are dropped up to the next possible start; a run of them counts as one rejection.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple, Protocol

from fieldkit.drivers.records import Layout, Record

_CHUNKS_KEPT = 64  # far more than one record is made of
_REFUSED_KEPT = 4096


class Stamped(NamedTuple):
    """A record, its bytes, and when its first byte was on the wire."""

    record: Record
    raw: bytes
    mono_ns: int


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

    def discard(self) -> None:
        """Forget everything received so far, before a fresh question."""

    def read(self, layout: Layout, timeout_s: float) -> Stamped | None:
        """The next record, or None if none is complete within `timeout_s`."""

    def close(self) -> None:
        """Release the port; a second call does nothing."""


class Framer:
    """Takes chunks in, gives records out; `byte_ns` is the wire time of one byte."""

    def __init__(self, byte_ns: int) -> None:
        self.rejected = 0
        self._byte_ns = byte_ns
        self._buffer = b""
        self._start = 0  # bytes of the stream before the buffer
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=_CHUNKS_KEPT)  # (bytes so far, mono_ns)
        self._in_step = True
        self._refused = b""

    @property
    def received(self) -> int:
        """Bytes received so far."""
        return self._start + len(self._buffer)

    @property
    def unread(self) -> bytes:
        """The last bytes received, as far as they were no record."""
        return self._refused + self._buffer

    def feed(self, chunk: bytes, mono_ns: int) -> None:
        """A chunk that was read at `mono_ns`."""
        self._buffer += chunk
        self._arrivals.append((self.received, mono_ns))

    def discard(self) -> None:
        """Forget everything received so far."""
        self._drop(len(self._buffer))
        self._in_step = True

    def take(self, layout: Layout) -> Stamped | None:
        """The next record, None if the bytes do not make one yet."""
        while self._buffer:
            taken = layout.take(self._buffer[: layout.longest])
            if isinstance(taken, Record):
                self._in_step, self._refused = True, b""
                mono_ns = self._stamp()
                return Stamped(taken, self._drop(taken.length), mono_ns)
            if taken is None and len(self._buffer) < layout.longest:
                return None
            self.rejected += self._in_step
            self._in_step = False
            self._refused = (self._refused + self._drop(taken.length if taken else 1))[-_REFUSED_KEPT:]
        return None

    def _stamp(self) -> int:
        """When the first byte of the buffer was on the wire."""
        while len(self._arrivals) > 1 and self._arrivals[0][0] <= self._start:
            self._arrivals.popleft()
        received, mono_ns = self._arrivals[0]
        return mono_ns - (received - self._start) * self._byte_ns

    def _drop(self, length: int) -> bytes:
        dropped, self._buffer = self._buffer[:length], self._buffer[length:]
        self._start += len(dropped)
        return dropped
