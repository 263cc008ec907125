"""Records out of a stream of bytes that arrives in chunks: found, stamped, resynchronised.

A record's stamp is when its first byte was on the wire: the moment the chunk that brought it was
read, less the wire time of that byte and what came after it in the same chunk. Bytes that are no
record are dropped up to the next possible start; a run of them counts as one rejection.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple, Protocol

from fieldkit.drivers.records import Layout, Record
from fieldkit.samples import new_tuple

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
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=_CHUNKS_KEPT)  # (bytes so far, mono_ns)
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
            if isinstance(taken, Record) and taken.length == length:
                self._refused = b""
                return new_tuple(Stamped, (taken, chunk, mono_ns - length * self._byte_ns))
        self.left += chunk
        self._arrivals.append((self.received, mono_ns))
        return self.take(layout)

    def discard(self) -> None:
        """Forget everything received so far."""
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
                return Stamped(taken, buffer[:length], self._stamp(self.received - len(buffer)))
            self.rejected += not self._refused
            self._refused = (self._refused + buffer[:length])[-_REFUSED_KEPT:]
        return None

    def _stamp(self, start: int) -> int:
        """When the byte with `start` others before it was on the wire."""
        received, mono_ns = self._arrivals[0]
        while received <= start:
            self._arrivals.popleft()
            received, mono_ns = self._arrivals[0]
        return mono_ns - (received - start) * self._byte_ns
