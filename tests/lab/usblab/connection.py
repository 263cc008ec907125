"""The conversation of one plugging: what QEMU asks over usbredir, answered for a camera model."""

from __future__ import annotations

import select
import socket
import time

from usblab import redir
from usblab.pipe import Count, Faults, Pipe
from usblab.redir import Kind, Message, Status
from usblab.uvc.camera import Setup, StallError, UvcCamera


class Connection:
    """A camera on a connected socket, from hello to the plug being pulled."""

    def __init__(self, camera: UvcCamera, faults: Faults, count: Count, wire: socket.socket) -> None:
        self._camera, self._socket = camera, wire
        self._wire = redir.Wire()
        self._alternate = 0
        self._configuration = 0
        self._pipe = Pipe(camera, faults, count, self._send)

    def serve(self, ending: socket.socket) -> None:
        """Answer and stream until the other side goes away or `ending` is closed."""
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
            self._pipe.stream()

    def _patience(self) -> float | None:
        if not self._camera.streaming:
            return None
        return max(0.0, self._pipe.due_s - time.monotonic())

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
            Kind.BULK: self._pipe.ask,
            Kind.CANCEL: self._pipe.cancel,
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
        self._pipe.restart()
        self._camera.select_alternate(interface, alternate)
        self._alternate = alternate
        self._describe()
        self._send(Kind.ALTERNATE_STATUS, bytes((Status.OK, interface, alternate)), message.id)

    def _get_alternate(self, message: Message) -> None:
        self._send(Kind.ALTERNATE_STATUS, bytes((Status.OK, message.body[0], self._alternate)), message.id)

    def _start_iso(self, message: Message) -> None:
        endpoint, packets = message.body[:2]
        self._pipe.start_packets(packets)
        self._send(Kind.ISO_STATUS, bytes((Status.OK, endpoint)), message.id)

    def _stop_iso(self, message: Message) -> None:
        self._pipe.stop_packets()
        self._send(Kind.ISO_STATUS, bytes((Status.OK, message.body[0])), message.id)

    def _acknowledge_interrupt(self, message: Message) -> None:
        self._send(Kind.INTERRUPT_STATUS, bytes((Status.OK, message.body[0])), message.id)

    def _control(self, message: Message) -> None:
        endpoint, request, kind, _, value, index, length = redir.CONTROL_HEADER.unpack_from(message.body)
        setup = Setup(kind, request, value, index, length)
        was_streaming = self._camera.streaming
        try:
            answer, status = self._camera.control(setup, message.body[redir.CONTROL_HEADER.size :]), Status.OK
        except StallError:
            answer, status = b"", Status.STALL
        if self._camera.streaming != was_streaming:
            self._pipe.restart()
        size = len(answer) if kind & 0x80 else length
        head = redir.CONTROL_HEADER.pack(endpoint, request, kind, status, value, index, size)
        self._send(Kind.CONTROL, head + answer, message.id)
