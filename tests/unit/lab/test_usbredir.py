"""The usbredir messages, and a port serving a camera to a counterpart written from the protocol text."""

import socket
import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from usblab.models.p2pro import P2Pro
from usblab.models.purethermal import PureThermal
from usblab.port import UsbPort
from usblab.redir import Kind, Wire, endpoint_info

WIDE_ID_HELLO = bytes(64) + struct.pack("<I", 1 << 5)


def test_ids_grow_to_eight_bytes_once_both_said_hello():
    wire = Wire()
    assert len(wire.hello()) == 12 + 68
    assert [m.kind for m in wire.feed(struct.pack("<III", 0, 68, 0) + WIDE_ID_HELLO)] == [Kind.HELLO]
    assert wire.pack(Kind.RESET, b"", 7) == struct.pack("<IIQ", 3, 0, 7)


def test_messages_may_arrive_in_any_pieces():
    wire = Wire()
    stream = struct.pack("<III", 3, 0, 1) + struct.pack("<III", 6, 1, 2) + b"\x01"
    found = [message for byte in stream for message in wire.feed(bytes((byte,)))]
    assert [(m.kind, m.id, m.body) for m in found] == [(3, 1, b""), (6, 2, b"\x01")]


def test_isochronous_endpoint_exists_only_while_streaming():
    shape = PureThermal(lambda _: np.zeros((120, 160))).shape
    assert endpoint_info(shape, 0)[16 + 3] == 255
    assert endpoint_info(shape, 1)[16 + 3] == 1
    assert struct.unpack_from("<H", endpoint_info(shape, 1), 96 + 2 * (16 + 3))[0] == 1023


class Counterpart:
    """QEMU's side of the cable, as far as these tests need it."""

    def __init__(self, wire: socket.socket) -> None:
        self._socket, self._wire, self._seen = wire, Wire(), []
        wire.settimeout(10)
        wire.sendall(struct.pack("<III", 0, 68, 0) + WIDE_ID_HELLO)
        self.next(Kind.HELLO)  # only then are ids wide

    def send(self, kind, body, id=0):
        self._socket.sendall(self._wire.pack(kind, body, id))

    def next(self, kind):
        while True:
            for number, message in enumerate(self._seen):
                if message.kind == kind:
                    return self._seen.pop(number)
            received = self._socket.recv(65536)
            assert received
            self._seen += list(self._wire.feed(received))

    def control(self, kind, request, value, index, data=b"", length=None):
        size = len(data) if length is None else length
        self.send(
            Kind.CONTROL,
            struct.pack("<BBBBHHH", kind & 0x80, request, kind, 0, value, index, size) + data,
            99,
        )
        body = self.next(Kind.CONTROL).body
        return body[3], body[10:]


@pytest.fixture
def cable():
    with (
        tempfile.TemporaryDirectory(dir="/tmp", prefix="fk-") as folder,
        socket.socket(socket.AF_UNIX) as listener,
    ):
        path = Path(folder, "port")
        listener.bind(str(path))
        listener.listen()
        port = UsbPort(P2Pro(lambda time_s: np.full((192, 256), 300.0)), path)
        port.plug()
        other, _ = listener.accept()
        yield port, Counterpart(other)
        other.close()
        port.unplug()


def start_stream(cable):
    port, qemu = cable
    block = struct.pack("<HBBI", 1, 1, 2, 400_000) + bytes(18)
    assert qemu.control(0x21, 0x01, 0x0200, 1, block)[0] == 0
    return port, qemu


def read_picture(qemu, first_id):
    picture, id = b"", first_id
    while True:
        qemu.send(Kind.BULK, struct.pack("<BBHIH", 0x81, 0, 16384, 0, 0), id)
        answer = qemu.next(Kind.BULK)
        assert answer.id == id
        picture += answer.body[10:]
        if len(answer.body) - 10 < 16384:
            return picture
        id += 1


def test_plugging_introduces_the_camera(cable):
    _, qemu = cable
    body = qemu.next(Kind.DEVICE_CONNECT).body
    assert struct.unpack("<BBBBHHH", body) == (2, 0xEF, 2, 1, 0x0BDA, 0x5830, 0x0100)


def test_stalled_request_is_answered_with_a_stall(cable):
    assert cable[1].control(0x80, 6, 9 << 8, 0, length=18)[0] == 4


def test_a_bulk_picture_arrives_whole_in_pieces_of_the_size_asked_for(cable):
    port, qemu = start_stream(cable)
    payload = read_picture(qemu, 1)
    assert payload[:2] == b"\x02\x83"
    counts = np.frombuffer(payload[2:], "<u2").reshape(384, 256)
    assert (counts[192:] == 300 * 64).all()
    assert port.count.pictures >= 1


def test_a_cancelled_request_is_returned_empty(cable):
    port, qemu = start_stream(cable)
    port.faults.silent = True
    qemu.send(Kind.BULK, struct.pack("<BBHIH", 0x81, 0, 16384, 0, 0), 5)
    qemu.send(Kind.CANCEL, b"", 5)
    answer = qemu.next(Kind.BULK)
    assert (answer.id, answer.body[1], answer.body[10:]) == (5, 1, b"")


def test_short_pictures_and_stalls_can_be_had(cable):
    port, qemu = start_stream(cable)
    port.faults.short_every = 1
    assert len(read_picture(qemu, 1)) < 256 * 384 * 2
    port.faults.stall = True
    qemu.send(Kind.BULK, struct.pack("<BBHIH", 0x81, 0, 16384, 0, 0), 50)
    while (answer := qemu.next(Kind.BULK)).id != 50:
        pass
    assert answer.body[1] == 4


def test_the_frame_id_toggles_from_picture_to_picture_also_where_one_was_replaced(cable):
    """By UVC 1.1, 2.4.3.2.2, it does with each frame; Linux drops a frame with the id of the one before."""
    port, qemu = start_stream(cable)
    ids = []
    for number in range(4):
        overwritten = port.count.overwritten
        while port.count.overwritten == overwritten:
            qemu.control(0x80, 0, 0, 0, length=2)
        ids.append(read_picture(qemu, 1 + 100 * number)[1] & 1)
        assert len(port.count.sums) == number + 1
    assert ids in ([0, 1, 0, 1], [1, 0, 1, 0])


def test_a_host_that_does_not_read_loses_pictures_not_memory(cable):
    port, qemu = start_stream(cable)
    while port.count.overwritten < 2:
        qemu.control(0x80, 0, 0, 0, length=2)
    assert len(read_picture(qemu, 1)) == 256 * 384 * 2 + 2
