import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.ut325 import characters, parse

RECORD = bytes.fromhex("30 3A 32 35 33 31 30 30 30 30 30 30 30 30 30 30 31 0D 0A")


@pytest.mark.parametrize(
    ("digits", "unit", "value", "name"),
    [
        (b"1005", b"1", 100.5, "°C"),
        (b":;75", b"1", -7.5, "°C"),
        (b"::::", b"1", None, ""),
        (b":773", b"2", 77.3, "°F"),
    ],
)
def test_digits_blanks_and_minus(digits, unit, value, name):
    found = parse(RECORD[:1] + digits + unit + RECORD[6:])
    if value is None:
        assert isinstance(found, Rejected)
    else:
        assert (found.values[0].value, found.values[0].unit) == (pytest.approx(value), name)


def test_kelvin_and_difference():
    (value,) = parse(RECORD[:5] + b"3" + RECORD[6:13] + b"2" + RECORD[14:]).values
    assert (value.unit, value.channel) == ("K", "T1-T2")


@pytest.mark.parametrize("offset", [5, 8, 13, 16, 17, 18])
def test_fixed_characters_must_be_there(offset):
    broken = bytearray(RECORD)
    broken[offset] = 0x39
    assert isinstance(parse(bytes(broken)), Rejected)


def test_reports_of_the_bridge_say_how_much_they_carry():
    assert characters(bytes([0xF3, 1, 2, 3, 0, 0, 0, 0])) == b"\x01\x02\x03"
    assert characters(bytes([0xF0, 1, 2, 3, 0, 0, 0, 0])) == b""
    assert characters(bytes([0x03, 1, 2, 3])) == b""
    assert characters(b"") == b""


def test_nothing_before_the_line_end_is_kept_of_a_record_that_is_none():
    assert parse(RECORD[:5] + b"4" + RECORD[6:]).length == 19
    assert parse(RECORD[15:] + RECORD[:15]).length == 4
    assert parse(RECORD[:17] + b"??").length == 1
