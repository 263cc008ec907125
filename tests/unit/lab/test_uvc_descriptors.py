"""The descriptors against the layouts of the USB and UVC specifications."""

import struct
from itertools import pairwise

import pytest
from usblab.models.ht301 import SHAPE as HT301_SHAPE
from usblab.models.p2pro import SHAPE as P2PRO_SHAPE
from usblab.models.purethermal import shape as purethermal_shape
from usblab.uvc import descriptors

SHAPES = {"purethermal": purethermal_shape("1"), "p2pro": P2PRO_SHAPE, "ht301": HT301_SHAPE}


def walk(block: bytes) -> list[bytes]:
    """The descriptors of a block, each by its own length byte."""
    found = []
    while block:
        found.append(block[: block[0]])
        assert len(found[-1]) == block[0] >= 2
        block = block[block[0] :]
    return found


@pytest.fixture(params=SHAPES.values(), ids=SHAPES.keys())
def shape(request):
    return request.param


def test_the_configuration_is_a_chain_of_whole_descriptors(shape):
    block = descriptors.configuration(shape)
    assert struct.unpack_from("<H", block, 2)[0] == len(block)
    assert sum(map(len, walk(block))) == len(block)


def test_class_specific_totals_cover_exactly_their_descriptors(shape):
    parts = walk(descriptors.configuration(shape))
    interfaces = [number for number, part in enumerate(parts) if part[1] == 4] + [len(parts)]
    for begin, end in list(pairwise(interfaces))[
        :2
    ]:  # the control interface and the first setting of streaming
        mine = [part for part in parts[begin:end] if part[1] == 0x24]
        header = mine[0]
        total = struct.unpack_from("<H", header, 5 if header[0] == 13 and header[3:5] == b"\0\1" else 4)[0]
        assert total == sum(map(len, mine))


def test_units_form_an_unbroken_chain_from_lens_to_output(shape):
    parts = [part for part in walk(descriptors.configuration(shape)) if part[1] == 0x24]
    entities = {part[3]: part for part in parts if part[2] in (2, 3, 5, 6) and part[0] != 30}
    output = next(part for part in entities.values() if part[2] == 3)
    seen, source = [], output[7]
    while source != descriptors.CAMERA_TERMINAL:
        unit = entities[source]
        seen.append(unit[2])
        source = unit[4] if unit[2] == 5 else unit[22]
    assert seen == [6] * len(shape.extensions) + [5]


def test_y16_format_and_frame_are_the_published_bytes():
    # UVC 1.0 "Uncompressed" payload, tables 3-1 and 3-2; GUID as in the kernel's UVC_GUID_FORMAT_Y16.
    y16 = descriptors.PictureFormat(descriptors.fourcc_guid("Y16 "), 16, ((160, 120),))
    camera = descriptors.CameraShape(
        1, 2, "a", "b", (y16,), 1_111_111, descriptors.Endpoint(0x81, False, 512)
    )
    parts = walk(descriptors.configuration(camera))
    assert bytes.fromhex("1b2404 01 01 5931362000001000800000aa00389b71 10 01 00000000") in parts
    frame = next(part for part in parts if part[:3] == b"\x1e\x24\x05")
    assert frame[3:9] == bytes.fromhex("0100a0007800")
    assert frame[17:] == bytes.fromhex("00960000 47f41000 01 47f41000")


def test_frame_interval_gives_the_products_rates():
    assert SHAPES["purethermal"].rate_hz == pytest.approx(9.0, abs=1e-5)
    assert SHAPES["p2pro"].rate_hz == SHAPES["ht301"].rate_hz == 25.0


def test_purethermal_offers_telemetry_only_in_y16():
    # PureThermal firmware: formats UYVY, Y16, GREY, RGB565, BGR24; only Y16 has the 122-row size.
    tall = [number for number, f in enumerate(SHAPES["purethermal"].formats, 1) if (160, 122) in f.sizes]
    assert tall == [2]


def test_high_bandwidth_endpoint_carries_three_transactions():
    assert descriptors.Endpoint(0x81, True, 0x1400).packet_bytes == 3072


def test_camera_without_serial_number_points_at_no_string():
    assert descriptors.device(P2PRO_SHAPE)[16] == 0
    assert descriptors.device(HT301_SHAPE)[16] == 3
