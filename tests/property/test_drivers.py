"""Any bytes whatsoever give a reading that the layout allows or a reasoned rejection, never an exception."""

import contextlib
import importlib
import io
import math
import random
import tomllib
from itertools import cycle, pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.drivers import registry
from fieldkit.drivers.cameras import (
    boson,
    flir_file,
    ht301,
    htpa,
    mlx90640,
    p2pro,
    purethermal,
    tc002c,
    tcam,
    thermal_master,
    y16,
)
from fieldkit.drivers.cameras.boson import pack, unpack
from fieldkit.drivers.cameras.camera import DecodedFrame
from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.framing import Framer
from fieldkit.drivers.meters import center, lutron, text
from fieldkit.drivers.meters.board_sensors import SENSORS
from fieldkit.drivers.meters.modbus import packaged_maps
from fieldkit.drivers.registry import BUILT_IN
from fieldkit.model.errors import DecodeError

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "data/golden_records.toml").read_text())["record"]

# What a value can be at most, by the layout of its record; None leaves it open.
LARGEST = {
    "lutron": 99_999_999.0,
    "center-309": 3272.0,
    "center-303": 3272.0,
    "konica-minolta": 9999e5,
    "pce-174": 999_900.0,
    "ut325": 999.9,
    "modbus": 65_535.0,
    "nmea": None,
    "gpsd": None,
    "text": None,
}
OPTIONS = [(name, {}) for name in LARGEST] + [("modbus", {"map": name}) for name in packaged_maps()]
OPTIONS += [("text", {"sensor": name}) for name in SENSORS]
FRAMES = {
    "purethermal": (purethermal.decode, tuple(purethermal.SHAPES)),
    "p2pro": (p2pro.decode, (p2pro.LENGTH,)),
    "boson": (boson.decode, (min(boson.SHAPES),)),
    "ht301": (ht301.decode, tuple(ht301.SHAPES)[1:3]),
    "thermal-master": (thermal_master.decode, (2 * 242 * 160, 2 * 242 * 160 + 24)),
    "tc002c": (tc002c.decode, (tc002c.LENGTH,)),
    "tcam": (tcam.decode, (51_980,)),
    "htpa": (htpa.decode, (htpa.LENGTH,)),
    "mlx90640": (mlx90640.decode, (mlx90640.LENGTH,)),
    "genicam": (lambda data: y16.decode(data, 80, 60), (9600,)),
    "y16": (lambda data: y16.decode(data, 80, 60), (9600,)),
}


def test_every_driver_is_tried_below():
    assert LARGEST.keys() | FRAMES.keys() == BUILT_IN.keys()


def golden_of(name):
    return [
        one["text"].encode() if "text" in one else bytes.fromhex(one["hex"])
        for one in GOLDEN
        if one["driver"] == name
    ] or [b'{"class":"TPV","mode":3,"lat":1,"lon":2}\n']


def check(name, options, data):
    decoded = registry.get(name).decode(data, options)
    covered = sum(part.length for part in decoded.rejected) + decoded.rest
    assert 0 <= covered <= len(data)
    assert all(part.reason and part.length > 0 for part in decoded.rejected)
    assert all(later.offset >= part.offset + part.length for part, later in pairwise(decoded.rejected))
    largest = LARGEST[name] if not options else None
    for value in decoded.values:
        assert not math.isinf(value.value)
        assert math.isnan(value.value) <= bool(value.flags)  # no value is always flagged
        if largest is not None and not math.isnan(value.value):
            assert abs(value.value) <= largest
    return decoded


@st.composite
def mutated(draw, records):
    """Golden records strung together, some bytes changed, some cut out."""
    data = bytearray(b"".join(draw(st.lists(st.sampled_from(records), min_size=1, max_size=6))))
    for place in draw(st.lists(st.integers(0, len(data) - 1), max_size=8)):
        data[place] = draw(st.integers(0, 255))
    start, end = sorted(draw(st.tuples(st.integers(0, len(data)), st.integers(0, len(data)))))
    return bytes(data[:start] + data[end:])


@pytest.mark.parametrize(("name", "options"), OPTIONS)
@given(data=st.data())
def test_any_bytes_give_values_or_reasons(name, options, data):
    check(name, options, data.draw(st.binary(max_size=600) | mutated(golden_of(name))))


def layout_of(name):
    """How the records of a serial meter's driver look."""
    if name in ("center-303", "center-309"):
        return center.TWO_PROBE_LAYOUT if name == "center-303" else center.LAYOUT
    if name == "text":
        return text.Grammar().layout
    module = importlib.import_module(f"fieldkit.drivers.meters.{name.replace('-', '_')}")
    return module.layout(None) if name == "modbus" else module.LAYOUT


def records(layout, pieces):
    """Records of bytes that arrive in pieces."""
    framer = Framer(1)
    for piece in pieces:
        parsed = framer.feed(layout, piece, 0)
        while parsed:
            yield parsed.raw
            parsed = framer.next_record(layout)


def ended_alike(found):
    """Text lines may end in CR, LF or both; where both arrive apart, LF is an empty line of its own."""
    return [line for raw in found if (line := raw.removesuffix(b"\n").removesuffix(b"\r"))]


@pytest.mark.parametrize("name", LARGEST)
@given(chunks=st.lists(st.integers(1, 40), min_size=1, max_size=20), data=st.data())
def test_records_do_not_depend_on_how_the_bytes_arrive(name, chunks, data):
    stream, layout = io.BytesIO(data.draw(mutated(golden_of(name)))), layout_of(name)
    sizes = cycle(chunks)
    pieces = iter(lambda: stream.read(next(sizes)), b"")
    assert ended_alike(records(layout, pieces)) == ended_alike(records(layout, [stream.getvalue()]))


@given(
    value=st.integers(-99_999_999, 99_999_999),
    decimals=st.integers(0, 3),
    display=st.sampled_from("123456789ABC"),
    unit=st.sampled_from(list(lutron.UNITS)),
)
def test_lutron_values_survive_their_record(value, decimals, display, unit):
    record = f"\x024{display}{unit}{int(value < 0)}{decimals}{abs(value):08d}\r".encode()
    (found,) = lutron.parse(record).values
    assert found.value == value / 10**decimals
    assert (found.channel, found.unit) == (display, lutron.UNITS[unit])


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.binary(max_size=64))
def test_boson_frames_survive_their_escapes(sequence, function, payload):
    assert unpack(pack(sequence, function, payload)) == (sequence, function, 0xFFFFFFFF, payload)


@pytest.mark.parametrize("name", FRAMES)
@given(seed=st.integers(0, 2**32 - 1), head=st.binary(max_size=64))
def test_any_frame_is_decoded_or_rejected(name, seed, head):
    decode, lengths = FRAMES[name]
    length = lengths[seed % len(lengths)]
    data = head + random.Random(seed).randbytes(length)[len(head) :]
    found = decode(data)
    assert isinstance(found, DecodedFrame | Rejected)
    if isinstance(found, DecodedFrame):
        assert found.counts.size + found.metadata_rows.size <= length // 2
        assert registry.get(name).decode(data, {}).values
    assert isinstance(decode(data[:-1]), Rejected)


@given(st.binary(max_size=2000), st.integers(0, 2**32 - 1))
def test_any_file_is_a_frame_or_no_flir_file(data, seed):
    dice = random.Random(seed)
    header = bytearray(b"FFF\0".ljust(64, b"\0"))
    header[0x14:0x20] = b"\x64\0\0\0\x40\0\0\0" + bytes([dice.randrange(4), 0, 0, 0])
    for attempt in (data, bytes(header) + data, b"\xff\xd8" + data):
        with contextlib.suppress(DecodeError):
            assert all(one.counts.ndim == 2 for one in flir_file.frames(attempt))
