"""A USB port of the guest: serves one camera model over usbredir, at the camera's own pace.

Connecting the socket plugs the camera in, closing it pulls the plug. `Faults` may be
changed while pictures flow.
"""

from __future__ import annotations

import select
import socket
import threading
import time
import zlib
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

from usblab import redir
from usblab.redir import Kind, Message, Status
from usblab.uvc.camera import Setup, StallError, UvcCamera

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
    stalled_controls: list[str] = field(default_factory=list)


class UsbPort:
    """One camera on one socket; a context manager: plugged inside, unplugged after."""

    def __init__(self, camera: UvcCamera, path: Path) -> None:
        self.camera = camera
        self.faults = Faults()
        self.count = Count()
        self._path = path
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def __enter__(self) -> UsbPort:
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Plug the camera in."""
        self.count = Count()
        self.camera.power_on(time.monotonic())
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(self._path))
        self._ending, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name=self.camera.shape.title, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Pull the plug; raises what went wrong in the port's thread, if anything did."""
        if self._thread is None:
            return
        self._end.close()
        self._thread.join()
        self._thread = None
        self._ending.close()
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            _Connection(self, self._socket).serve(self._ending)
        except (ConnectionError, BrokenPipeError):
            pass  # the guest was switched off
        except BaseException as failure:
            self._failure = failure
        finally:
            self._socket.close()


class _Connection:
    """The state of one plugging: what was asked for and not yet answered, what waits to be sent."""

    def __init__(self, port: UsbPort, wire: socket.socket) -> None:
        self._port, self._camera, self._socket = port, port.camera, wire
        self._wire = redir.Wire()
        self._alternate = 0
        self._configuration = 0
        self._requests: deque[tuple[int, int]] = deque()  # bulk requests: id, length
        self._waiting: deque[deque[bytes]] = deque()  # pictures not yet sent, in pieces
        self._clock = _PictureClock(self._camera.shape.rate_hz)
        self._last = b""
        self._iso: _IsoPace | None = None

    def serve(self, ending: socket.socket) -> None:
        self._socket.sendall(self._wire.hello())
        while True:
            ready, _, _ = select.select([self._socket, ending], [], [], self._patience())
            if ending in ready:
                return
            if self._socket in ready:
                received = self._socket.recv(65536)
                if not received:
                    return
                for message in self._wire.feed(received):
                    self._handle(message)
            self._stream()

    def _patience(self) -> float | None:
        if not self._camera.streaming:
            return None
        soonest = self._clock.due_s if self._iso is None else min(self._clock.due_s, self._iso.due_s)
        return max(0.0, soonest - time.monotonic())

    def _send(self, kind: Kind, body: bytes, id: int = 0) -> None:
        self._socket.sendall(self._wire.pack(kind, body, id))

    def _handle(self, message: Message) -> None:
        handlers = {
            Kind.HELLO: self._connect,
            Kind.SET_CONFIGURATION: self._set_configuration,
            Kind.GET_CONFIGURATION: self._get_configuration,
            Kind.SET_ALTERNATE: self._set_alternate,
            Kind.GET_ALTERNATE: self._get_alternate,
            Kind.START_ISO: self._start_iso,
            Kind.STOP_ISO: self._stop_iso,
            Kind.START_INTERRUPT: self._acknowledge_interrupt,
            Kind.STOP_INTERRUPT: self._acknowledge_interrupt,
            Kind.CONTROL: self._control,
            Kind.BULK: self._bulk,
            Kind.CANCEL: self._cancel,
        }
        if message.kind in handlers:
            handlers[message.kind](message)

    def _connect(self, _: Message) -> None:
        self._describe()
        self._send(Kind.DEVICE_CONNECT, redir.device_connect(self._camera.shape))

    def _describe(self) -> None:
        self._send(Kind.INTERFACE_INFO, redir.interface_info())
        self._send(Kind.ENDPOINT_INFO, redir.endpoint_info(self._camera.shape, self._alternate))

    def _set_configuration(self, message: Message) -> None:
        self._configuration = message.body[0]
        self._describe()
        self._get_configuration(message)

    def _get_configuration(self, message: Message) -> None:
        self._send(Kind.CONFIGURATION_STATUS, bytes((Status.OK, self._configuration)), message.id)

    def _set_alternate(self, message: Message) -> None:
        interface, alternate = message.body[:2]
        self._drop()
        self._camera.select_alternate(interface, alternate)
        self._alternate = alternate
        self._describe()
        self._send(Kind.ALTERNATE_STATUS, bytes((Status.OK, interface, alternate)), message.id)

    def _get_alternate(self, message: Message) -> None:
        self._send(Kind.ALTERNATE_STATUS, bytes((Status.OK, message.body[0], self._alternate)), message.id)

    def _start_iso(self, message: Message) -> None:
        endpoint, packets = message.body[:2]
        self._drop()
        self._iso = _IsoPace(self._camera, packets)
        self._send(Kind.ISO_STATUS, bytes((Status.OK, endpoint)), message.id)

    def _stop_iso(self, message: Message) -> None:
        self._iso = None
        self._send(Kind.ISO_STATUS, bytes((Status.OK, message.body[0])), message.id)

    def _acknowledge_interrupt(self, message: Message) -> None:
        self._send(Kind.INTERRUPT_STATUS, bytes((Status.OK, message.body[0])), message.id)

    def _control(self, message: Message) -> None:
        endpoint, request, kind, _, value, index, length = redir.CONTROL_HEADER.unpack_from(message.body)
        setup = Setup(kind, request, value, index, length)
        was_streaming = self._camera.streaming
        try:
            answer, status = self._camera.control(setup, message.body[redir.CONTROL_HEADER.size :]), Status.OK
        except StallError as refusal:
            answer, status = b"", Status.STALL
            self._port.count.stalled_controls.append(str(refusal))
        if self._camera.streaming != was_streaming:
            self._drop()
        size = len(answer) if kind & 0x80 else length
        head = redir.CONTROL_HEADER.pack(endpoint, request, kind, status, value, index, size)
        self._send(Kind.CONTROL, head + answer, message.id)

    def _bulk(self, message: Message) -> None:
        _, _, low, _, high = redir.BULK_HEADER.unpack_from(message.body)
        self._requests.append((message.id, low | high << 16))

    def _cancel(self, message: Message) -> None:
        for request in self._requests:
            if request[0] == message.id:
                self._requests.remove(request)
                self._answer_bulk(message.id, Status.CANCELLED, b"")
                return

    def _answer_bulk(self, id: int, status: Status, data: bytes) -> None:
        size = len(data)
        head = redir.BULK_HEADER.pack(
            self._camera.shape.endpoint.address, status, size & 0xFFFF, 0, size >> 16
        )
        self._send(Kind.BULK, head + data, id)

    def _drop(self) -> None:
        """A stream begins or ends: what was under way is forgotten."""
        self._waiting.clear()
        self._clock.start(time.monotonic())

    def _stream(self) -> None:
        if not self._camera.streaming:
            return
        if self._clock.tick(time.monotonic()) and not self._port.faults.silent:
            self._take_picture()
        if self._iso is not None:
            self._send_packets(self._iso)
        elif self._port.faults.stall:
            while self._requests:
                self._answer_bulk(self._requests.popleft()[0], Status.STALL, b"")
        else:
            self._answer_requests()

    def _take_picture(self) -> None:
        faults, count = self._port.faults, self._port.count
        if not (faults.stuck and self._last):
            self._last = self._camera.picture(time.monotonic())
        count.pictures += 1
        pieces = self._cut(self._last)
        if len(self._waiting) >= PENDING_PICTURES:
            self._waiting.pop()
            count.sums.pop()
            count.overwritten += 1
        self._waiting.append(deque(pieces))
        count.sums.append(zlib.crc32(self._last))

    def _cut(self, picture: bytes) -> list[bytes]:
        """A picture as it goes over the cable, every n-th one short if that is the fault."""
        faults, count = self._port.faults, self._port.count
        short = faults.short_every and count.pictures % faults.short_every == 0
        return self._camera.transfer(picture[: len(picture) // 2] if short else picture)

    def _answer_requests(self) -> None:
        while self._requests and self._waiting:
            id, length = self._requests.popleft()
            payload = self._waiting[0].popleft()
            self._answer_bulk(id, Status.OK, payload[:length])
            if len(payload) > length:
                self._waiting[0].appendleft(payload[length:])
            else:
                self._waiting.popleft()

    def _send_packets(self, pace: _IsoPace) -> None:
        """One packet for every service interval that has passed, empty ones included."""
        for _ in range(pace.owed(time.monotonic())):
            data = self._waiting[0].popleft() if self._waiting else b""
            if self._waiting and not self._waiting[0]:
                self._waiting.popleft()
            status = Status.STALL if self._port.faults.stall else Status.OK
            data = b"" if status else data
            head = redir.ISO_HEADER.pack(self._camera.shape.endpoint.address, status, len(data))
            self._send(Kind.ISO, head + data, pace.next_id())


class _PictureClock:
    """When the next picture is due; a late one is not made up for."""

    def __init__(self, rate_hz: float) -> None:
        self._interval_s = 1.0 / rate_hz
        self.start(0.0)

    def start(self, now_s: float) -> None:
        self.due_s = now_s + self._interval_s

    def tick(self, now_s: float) -> bool:
        if now_s < self.due_s:
            return False
        missed = int((now_s - self.due_s) / self._interval_s)
        self.due_s += (missed + 1) * self._interval_s
        return True


class _IsoPace:
    """How many isochronous packets are owed by now, in bursts of the size QEMU asked for."""

    def __init__(self, camera: UvcCamera, burst: int) -> None:
        pipe = camera.shape.endpoint
        base_s = 125e-6 if camera.shape.high_speed else 1e-3
        self._interval_s = base_s * 2 ** (pipe.interval - 1)
        self._burst = max(1, burst)
        self._begun_s = time.monotonic()
        self._sent = 0

    @property
    def due_s(self) -> float:
        return self._begun_s + (self._sent + self._burst) * self._interval_s

    def owed(self, now_s: float) -> int:
        behind = int((now_s - self._begun_s) / self._interval_s) - self._sent
        return behind // self._burst * self._burst

    def next_id(self) -> int:
        self._sent += 1
        return self._sent
