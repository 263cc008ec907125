import math
import struct
from types import MappingProxyType

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.modbus import (
    FOLDER,
    Channel,
    Modbus,
    RegisterMap,
    crc16,
    load_map,
    pack_request,
    parse,
)
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Quality

SMP = bytes.fromhex("01 04 10 00 01 00 00 00 00 03 E5 03 E5 00 00 00 F8 00 EA 66 12")
RTD = bytes.fromhex("01 03 10 00 FA 00 FD FF CC 03 ED 00 00 00 01 00 F9 7F FF B5 3A")


def settings(wire, **options):
    return DeviceSettings("sun", "modbus", port=wire.path, every_s=0.02, options=options)


def block_of(channel, count, **more):
    words = {"title": "x", "quantity": "any", "unit": channel.unit}
    return RegisterMap(**words, function=3, first=0, count=count, channels=(channel,), **more)


def pyranometer(wire, reply, more=MappingProxyType({})):
    wire.reply({pack_request(1, 4, 2, 8): reply, **more})
    return wire.open(Modbus(), settings(wire, map="kipp-smp"))


def sealed(hexadecimal):
    body = bytes.fromhex(hexadecimal)
    return body + crc16(body).to_bytes(2, "little")


def test_requests_are_those_of_the_manuals():
    assert pack_request(1, 4, 2, 8) == bytes.fromhex("01 04 00 02 00 08 50 0C")
    assert pack_request(1, 3, 0, 1) == bytes.fromhex("01 03 00 00 00 01 84 0A")


def test_printed_reply_with_a_wrong_crc_is_rejected():
    # 01 03 02 00 FA B8 44 stands in a module's paper; B8 44 belongs to the value 0.
    assert isinstance(parse(bytes.fromhex("01 03 02 00 FA B8 44") + bytes(8)), Rejected)
    assert not isinstance(parse(bytes.fromhex("01 03 02 00 FA 38 07")), Rejected)
    assert crc16(bytes.fromhex("01 03 02 00 00")) == 0x44B8


def test_refusal_of_the_instrument_is_said_in_words():
    assert "illegal address" in parse(sealed("01 84 02")).reason


def test_pyranometer_is_polled_by_its_map(wire):
    device = pyranometer(wire, SMP)
    assert (device.info.quantity, device.info.unit) == ("irradiance", "W m-2")
    assert device.info.settings["line"] == "19200 8E1"
    assert device.info.channels == ("irradiance", "irradiance uncompensated")
    assert device.info.measures == ()  # it gives no reply for its type, which is not guessed
    assert device.read(1.0).values == (997.0, 997.0)


@pytest.mark.parametrize(
    ("type_number", "component"), [(601, "ghi"), (604, "ghi"), (613, "dni"), (614, "dni"), (999, "")]
)
@pytest.mark.parametrize("echo", [b"", pack_request(1, 4, 0, 1)])
def test_type_register_tells_a_pyrheliometer_from_a_pyranometer(wire, type_number, component, echo):
    """Types by the manuals of the SMP and the SHP1; what no manual names is not guessed."""
    typed = echo + sealed(f"01 04 02 {type_number:04x}")
    device = pyranometer(wire, SMP, {pack_request(1, 4, 0, 1): typed})
    assert device.info.measures == ((component, component) if component else ())


@pytest.mark.parametrize(("name", "component"), [("apogee", "ghi"), ("renke", "ghi")])
def test_maps_of_pyranometers_say_so(name, component):
    assert load_map(name).measures == {"": component}


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ('measures = "sun"', "measures 'sun' is none of dni"),
        ("measures = { ghi = [601] }", "by type: type_register"),
        ("measures = { type_register = 0 }", "by type: type_register"),
    ],
)
def test_map_that_says_badly_what_it_measures_is_refused(tmp_path, given, complaint):
    mine = tmp_path / "mine.toml"
    mine.write_text(f"{given}\n{(FOLDER / 'renke.toml').read_text().replace('measures =', '# measures =')}")
    with pytest.raises(ConfigError, match=complaint):
        load_map(str(mine))


@pytest.mark.parametrize("head", ["02 04", "01 03"], ids=["unit 2", "function 3"])
def test_reply_of_another_instrument_or_function_on_the_line_is_not_ours(wire, head):
    """Modbus over Serial Line 1.02, 2.4.1: a reply of an unexpected slave does not end the waiting."""
    other = sealed(f"{head} 10 00 01 00 00 00 00 00 64 00 64 00 00 00 F8 00 EA")
    device = pyranometer(wire, other + SMP)
    assert device.read(1.0).values == (997.0, 997.0)
    assert device.rejected == 2
    assert "unit 1, function 4" in device.rejected_because


@pytest.mark.parametrize(
    ("kind", "no_value", "registers", "is_open"),
    [
        # -9999, as the instrument's paper may write it, or as a program shows it
        ("s16", 0xD8F1, [0xD8F1], True),
        ("s16", -9999, [0xD8F1], True),
        ("f32", -9999, [0xC61C, 0x3C00], True),  # IEEE 754: C61C3C00
        ("s32", 0x7FFFFFFF, [0x7FFF, 0xFFFF], True),
        ("u32", 0, [0x0000, 0xEA60], False),  # 60000: its high word is zero, it is not
        ("u32", 0, [0x0000, 0x0000], True),
    ],
)
def test_counts_that_mean_no_value_are_those_of_the_whole_channel(kind, no_value, registers, is_open):
    (found,) = block_of(Channel("T1", 0, kind), len(registers), no_value=(no_value,)).values(registers)
    assert (math.isnan(found.value), "open" in found.states) == (is_open, is_open)
    assert found.quality == (Quality.NO_VALUE if is_open else Quality.GOOD)


@pytest.mark.parametrize("registers", [(0x43FA, 0x0000), (0x43FA, 0x2000), (0x4452, 0xECCD)])
def test_a_float_read_with_its_words_in_the_wrong_order_is_not_zero(registers):
    """500, 500.25 and 843.7 W/m2 by IEEE 754; exchanged they are 2.4e-41, 1.1e-19 and -2e27."""
    expected = struct.unpack(">f", struct.pack(">HH", *registers))[0]
    for low_first in (False, True):
        channel = Channel("sun", 0, "f32", "W/m²", words_low_first=low_first)
        own = block_of(channel, 2, limits=(-100.0, 2000.0))
        right, wrong = (registers[::-1], registers) if low_first else (registers, registers[::-1])
        assert own.values(right)[0].value == pytest.approx(expected)
        assert math.isnan(own.values(wrong)[0].value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("first = 0", "first = -1", "first: "),
        ("first = 0", "first = 65530", "not within 65536 registers"),
        ("count = 8", "count = inf", "count: "),
        ("register = 0", "register = 1.5", r"channel.0.register: "),
        ("scale = 0.1", "scale = inf", r"channel.0.scale: "),
        ("repeat = 8", "repeat = 1000000000000", r"channel.0.repeat: "),
        ("[[channel]]", "[status]\nbits = [{bit = -1, word = 'x'}]\n[[channel]]", r"status.bits.0.bit: "),
        ("register = 0", "register = 8", "register 8 is not among 0 to 7"),
        ('type = "s16"', 'type = "s17"', r"channel.0.type: "),
        ("function = 3", "function = 6", "function: "),
        ("count = 8", "", "count: "),
        ("count = 8", "cuont = 8", "cuont: |count: "),
        ('unit = "°C"\nline', 'unit = "W/m²"\nline', "no channel has the unit"),
        ("scale = 0.1", "sclae = 0.1", "sclae"),
        ("scale = 0.1", "scale = 0", "scale 0 leaves nothing"),
        ("scale = 0.1", "scale =", "Invalid value"),
    ],
)
def test_values_that_no_map_can_have_are_named_when_it_is_read(tmp_path, old, new, said):
    text, mine = (FOLDER / "rtd-8.toml").read_text(), tmp_path / "mine.toml"
    assert old in text
    mine.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=said) as caught:
        load_map(str(mine))
    assert str(mine) in str(caught.value)


def test_adapter_that_echoes_the_question_is_understood(wire):
    request = pack_request(1, 3, 0, 8)
    wire.reply({request: request + RTD})
    device = wire.open(Modbus(), settings(wire, map="rtd-8"))
    reading = device.read(1.0)
    assert reading.values[:4] == pytest.approx((298.15, 298.45, 267.95, 373.65))
    assert math.isnan(reading.values[7])
    assert device.rejected == 0


def test_missing_map_lists_those_there_are(wire):
    with pytest.raises(ConfigError) as caught:
        load_map("smp")
    assert "kipp-smp" in caught.value.fix
    with pytest.raises(ConfigError, match="which instrument"):
        Modbus().open(settings(wire), HostClock())


def test_short_answer_with_a_wrong_check_is_one_part():
    given = Modbus().decode(RTD + bytes.fromhex("01 03 02 00 FA B8 45"), {})
    assert [(part.length, part.offset) for part in given.rejected] == [(7, len(RTD))]
    assert (len(given.values), given.rest) == (8, 0)


@pytest.mark.parametrize("unit", [0, 248, 256, 300, -1])
def test_a_unit_that_no_instrument_can_have_is_refused_in_words(wire, unit):
    """Modbus over Serial Line 1.02, 2.2: 1 to 247; 0 is for all, 248 to 255 are reserved."""
    with pytest.raises(ConfigError, match=rf"unit = {unit} .*\b1 to 247"):
        Modbus().open(settings(wire, map="kipp-smp", unit=unit), HostClock())


def test_bytes_from_a_unit_that_cannot_be_are_no_answer():
    refused = parse(sealed("F8 03 02 00 FA"))
    assert isinstance(refused, Rejected)
    assert refused.length == 1


@pytest.mark.parametrize(("decimals", "value"), [(0, 84.0), (1, 8.4), (0xFFFF, 840.0), (0xFFFE, 8400.0)])
def test_decimals_told_by_the_instrument_may_be_negative(decimals, value):
    (found,) = block_of(Channel("x", 0, "u16", "W/m²", decimals_register=1), 2).values([84, decimals])
    assert found.value == pytest.approx(value)


@pytest.mark.parametrize(
    ("type_", "registers"),
    [
        # SunSpec, "not implemented": the least signed and the greatest unsigned; greatest signed: over range
        ("s16", (0x8000,)),
        ("s16", (0x7FFF,)),
        ("u16", (0xFFFF,)),
        ("s32", (0x8000, 0x0000)),
        ("s32", (0x7FFF, 0xFFFF)),
        ("u32", (0xFFFF, 0xFFFF)),
        ("f32", (0x7FC0, 0x0000)),
        ("f32", (0x7F80, 0x0000)),
    ],
)
def test_counts_that_stand_for_no_value_by_their_type_have_none(type_, registers):
    (value,) = block_of(Channel("sun", 0, type_, "W m-2", scale=1e-6), len(registers)).values(registers)
    assert math.isnan(value.value)
    assert value.quality == Quality.NO_VALUE
