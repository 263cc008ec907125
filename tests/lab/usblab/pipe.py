"""The streaming endpoint: takes pictures from a camera model at its pace and hands them to QEMU.

A bulk endpoint answers requests, an isochronous one sends at the pace of the cable.
"""

from __future__ import annotations

import time
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from usblab import redir
from usblab.pace import IsoPace, PictureClock
from usblab.redir import Kind, Message, Status
from usblab.uvc.camera import UvcCamera

PENDING_PICTURES = 2  # a camera has no more memory than that: later pictures replace the waiting one


@dataclass
class Faults:
    """What is wrong with a camera just now.

    `silent` sends nothing, `stuck` the same picture for ever, `short_every` cuts each n-th
    picture short (0: none), `stall` makes the streaming endpoint refuse.
    """

    silent: bool = False
    stuck: bool = False
    short_every: int = 0
    stall: bool = False


@dataclass
class Count:
    """What went through the port since it was plugged; `sums` are of the pictures put on the cable."""

    pictures: int = 0
    sums: list[int] = field(default_factory=list)
    overwritten: int = 0


class Pipe:
    """What waits to be sent, and who waits for it; `send` takes kind, body and id of a message."""

    def __init__(
        self, camera: UvcCamera, faults: Faults, count: Count, send: Callable[[Kind, bytes, int], None]
    ) -> None:
        self._camera, self._faults, self._count, self._send = camera, faults, count, send
        self._requests: deque[tuple[int, int]] = deque()  # bulk requests: id, length
        self._waiting: deque[bytes] = deque()  # pictures of which nothing is sent yet
        self._pieces: deque[bytes] = deque()  # what is left of the one that is being sent
        self._clock = PictureClock(camera.shape.rate_hz)
        self._last = b""
        self._iso: IsoPace | None = None

    @property
    def due_s(self) -> float:
        """When there will be something to send, by this computer's monotonic clock."""
        return self._clock.due_s if self._iso is None else min(self._clock.due_s, self._iso.due_s)

    def restart(self) -> None:
        """A stream begins or ends: what was under way is forgotten."""
        self._waiting.clear()
        self._pieces.clear()
        self._clock.start(time.monotonic())

    def start_packets(self, burst: int) -> None:
        """From now on, packets in bursts of the size QEMU asked for."""
        self.restart()
        self._iso = IsoPace(self._camera, burst)

    def stop_packets(self) -> None:
        """No packets any more."""
        self._iso = None

    def ask(self, message: Message) -> None:
        """QEMU asks for bulk data; it is answered when there are some."""
        _, _, low, _, high = redir.BULK_HEADER.unpack_from(message.body)
        self._requests.append((message.id, low | high << 16))

    def cancel(self, message: Message) -> None:
        """QEMU no longer wants an answer to a request."""
        for request in self._requests:
            if request[0] == message.id:
                self._requests.remove(request)
                self._answer(message.id, Status.CANCELLED, b"")
                return

    def stream(self) -> None:
        """Send what is due."""
        if not self._camera.streaming:
            return
        if self._clock.tick(time.monotonic()) and not self._faults.silent:
            self._take_picture()
        if self._iso is not None:
            self._send_packets(self._iso)
        elif self._faults.stall:
            while self._requests:
                self._answer(self._requests.popleft()[0], Status.STALL, b"")
        else:
            self._answer_requests()

    def _take_picture(self) -> None:
        faults, count = self._faults, self._count
        if not (faults.stuck and self._last):
            self._last = self._camera.picture(time.monotonic())
        count.pictures += 1
        if len(self._waiting) + bool(self._pieces) >= PENDING_PICTURES:
            self._waiting.pop()
            count.overwritten += 1
        self._waiting.append(self._last)

    def _has_data(self) -> bool:
        """Whether there is a piece to send; the next picture is cut only now.

        Each that is cut toggles the frame id, and a driver drops a picture with the id of the one before.
        """
        if not self._pieces and self._waiting:
            picture = self._waiting.popleft()
            self._count.sums.append(zlib.crc32(picture))
            self._pieces.extend(self._cut(picture))
        return bool(self._pieces)

    def _cut(self, picture: bytes) -> list[bytes]:
        """A picture as it goes over the cable, every n-th one short if that is the fault."""
        short_every = self._faults.short_every
        short = short_every and len(self._count.sums) % short_every == 0
        return self._camera.transfer(picture[: len(picture) // 2] if short else picture)

    def _answer_requests(self) -> None:
        while self._requests and self._has_data():
            id, length = self._requests.popleft()
            payload = self._pieces.popleft()
            self._answer(id, Status.OK, payload[:length])
            if len(payload) > length:
                self._pieces.appendleft(payload[length:])

    def _send_packets(self, pace: IsoPace) -> None:
        """What the service intervals that have passed carry: data, nothing at all, or empty packets."""
        for _ in range(pace.owed(time.monotonic())):
            has_data = self._has_data()
            if not pace.carries_a_packet(has_data):
                continue
            data = self._pieces.popleft() if has_data else b""
            status = Status.STALL if self._faults.stall else Status.OK
            data = b"" if status else data
            head = redir.ISO_HEADER.pack(self._camera.shape.endpoint.address, status, len(data))
            self._send(Kind.ISO, head + data, pace.next_id())

    def _answer(self, id: int, status: Status, data: bytes) -> None:
        size = len(data)
        head = redir.BULK_HEADER.pack(
            self._camera.shape.endpoint.address, status, size & 0xFFFF, 0, size >> 16
        )
        self._send(Kind.BULK, head + data, id)
