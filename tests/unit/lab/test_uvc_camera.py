"""The camera's answers to control requests, and its payloads, against the UVC 1.0 text."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from usblab.uvc import payload
from usblab.uvc.camera import GET_CUR, GET_INFO, GET_LEN, SET_CUR, Control, Setup, StallError, UvcCamera
from usblab.uvc.descriptors import CameraShape, Endpoint, PictureFormat, fourcc_guid

BULK, ISO = Endpoint(0x81, False, 512), Endpoint(0x81, True, 1023, 1)


def make(endpoint: Endpoint) -> UvcCamera:
    pixels = PictureFormat(fourcc_guid("Y16 "), 16, ((160, 120), (160, 122)))
    camera = UvcCamera(CameraShape(1, 2, "a", "b", (pixels,), 1_111_111, endpoint))
    camera.controls[6, 19] = Control(bytes(4))
    return camera


def ask(camera, request, *, selector, interface, entity=0, data=b"", length=64):
    kind = 0x21 if request == SET_CUR else 0xA1
    return camera.control(Setup(kind, request, selector << 8, entity << 8 | interface, length), data)


def negotiate(camera, frame: int) -> bytes:
    block = struct.pack("<HBBI", 1, 1, frame, 1_111_111) + bytes(18)
    for selector in (1, 2):
        ask(camera, SET_CUR, selector=selector, interface=1, data=block)
    return ask(camera, GET_CUR, selector=1, interface=1)


@pytest.mark.parametrize(("endpoint", "payload_bytes"), [(BULK, 160 * 122 * 2 + 2), (ISO, 1023)])
def test_negotiation_answers_size_of_picture_and_payload(endpoint, payload_bytes):
    answer = negotiate(make(endpoint), frame=2)
    assert len(answer) == 26  # UVC 1.0
    assert struct.unpack_from("<II", answer, 18) == (160 * 122 * 2, payload_bytes)


def test_impossible_choice_falls_back_to_the_first():
    camera = make(BULK)
    negotiate(camera, frame=9)
    assert camera.size == (160, 120)


def test_bulk_stream_starts_with_commit_and_stops_with_clear_halt():
    camera = make(BULK)
    negotiate(camera, frame=1)
    assert camera.streaming
    camera.control(Setup(0x02, 1, 0, 0x81, 0))
    assert not camera.streaming


def test_isochronous_stream_follows_the_alternate_setting():
    camera = make(ISO)
    negotiate(camera, frame=1)
    assert not camera.streaming
    camera.select_alternate(1, 1)
    assert camera.streaming
    camera.select_alternate(1, 0)
    assert not camera.streaming


def test_power_off_ends_the_stream():
    camera = make(BULK)
    negotiate(camera, frame=1)
    camera.power_on(5.0)
    assert not camera.streaming


def test_unit_control_tells_its_length_and_keeps_what_is_written():
    camera = make(BULK)
    where = {"selector": 19, "entity": 6, "interface": 0}
    assert ask(camera, GET_LEN, **where) == b"\x04\x00"
    assert ask(camera, GET_INFO, **where) == b"\x03"
    ask(camera, SET_CUR, **where, data=b"\x01\0\0\0")
    assert ask(camera, GET_CUR, **where) == b"\x01\0\0\0"


@pytest.mark.parametrize(
    "refused",
    [
        {"selector": 19, "entity": 6, "interface": 0, "data": b"\x01"},  # wrong size
        {"selector": 20, "entity": 6, "interface": 0, "data": b"\x01\0\0\0"},  # no such selector
        {"selector": 19, "entity": 7, "interface": 0, "data": b"\x01\0\0\0"},  # no such unit
        {"selector": 1, "entity": 0, "interface": 1, "data": b"\x01"},  # negotiation block too short
    ],
)
def test_wrong_requests_are_stalled(refused):
    with pytest.raises(StallError):
        ask(make(BULK), SET_CUR, **refused)


def test_answers_are_cut_to_the_length_asked_for():
    assert len(make(BULK).control(Setup(0x80, 6, 1 << 8, 0, 8))) == 8


def reassemble(packets: list[bytes]) -> tuple[bytes, set[int], list[int]]:
    pixels = b"".join(packet[packet[0] :] for packet in packets)
    return pixels, {packet[1] & payload.FRAME_ID for packet in packets}, [packet[1] & 2 for packet in packets]


@given(st.binary(min_size=1, max_size=5000), st.integers(3, 1024))
def test_isochronous_packets_carry_the_whole_picture(picture, packet_bytes):
    packets = payload.packets(picture, True, packet_bytes)
    pixels, toggles, ends = reassemble(packets)
    assert pixels == picture
    assert toggles == {1}
    assert ends == [0] * (len(packets) - 1) + [payload.END_OF_FRAME]
    assert max(map(len, packets)) <= packet_bytes


@pytest.mark.parametrize("endpoint", [BULK, ISO])
def test_frame_id_toggles_with_each_picture(endpoint):
    camera = make(endpoint)
    first, second = camera.transfer(b"ab"), camera.transfer(b"ab")
    assert first[0][1] & 1 != second[0][1] & 1
