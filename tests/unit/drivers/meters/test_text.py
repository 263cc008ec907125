import math
import time

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.text import Grammar, Text
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DecodeError
from fieldkit.model.samples import Quality


def settings(wire, **options):
    return DeviceSettings("board", "text", port=wire.path, options=options)


def values(data, **options):
    return [(value.channel, value.value, value.unit) for value in Text().decode(data, options).values]


def test_pairs_carry_their_unit():
    assert values(b"T1=21.56 C, lux = 98760 lx;w=-3e1W/m2\r\n") == [
        ("T1", 21.56, "°C"),
        ("lux", 98760.0, "lx"),
        ("w", -30.0, "W/m²"),
    ]


def test_header_names_the_columns_that_follow():
    assert values(b"ms,temp_c,light_lx\n12345,21.56,98760\n") == [
        ("temp_c", 21.56, "°C"),
        ("light_lx", 98760.0, "lx"),
    ]


def test_columns_may_be_given():
    assert values(b"21.5\t9\n", columns="temp_c,count") == [("temp_c", 21.5, "°C"), ("count", 9.0, "")]


def test_sentinels_blanks_and_nan_are_no_value():
    record = Grammar(("a", "b", "c"), "°C", (-127.0,)).parse(b"-127.00,,nan\n")
    assert [value.quality for value in record.values] == [Quality.NO_VALUE] * 3
    assert all(math.isnan(value.value) for value in record.values)


@pytest.mark.parametrize(
    "line", [b"hello world=\xff\n", b"T1=abc C\n", b"21.5,x1y\n", b"1,2,3\n", b"=5\n", b"1" * 600]
)
def test_what_is_no_line_of_ours_is_rejected(line):
    assert isinstance(Grammar(("a", "b")).parse(line[:512]), Rejected)


def test_a_clock_that_64_bits_do_not_hold_is_rejected():
    grammar = Grammar(("ms", "T1_c"))
    assert grammar.parse(b"999999999999999999,21.5\n").device_time == 10**18 - 1
    assert isinstance(grammar.parse(b"9999999999999999999,21.5\n"), Rejected)


def test_board_with_header_and_clock_is_recorded(wire):
    wire.talk(b"# ready\r\nms,T1_c,T2_c,light_lx\r\n12345,21.50,-127,98760\r\n")
    device = Text().open(settings(wire, no_value=[-127, 85], labels=["reference", "bed"]), HostClock())
    assert (device.info.unit, device.info.channels, device.info.device_time_unit) == (
        "K",
        ("reference", "bed"),
        "ms",
    )
    reading = device.read(1.0)
    assert reading.values[0] == pytest.approx(294.65)
    assert math.isnan(reading.values[1])
    assert reading.device_time == 12345
    device.close()


class HurriedClock(HostClock):
    """Time passes a hundred times as fast."""

    def mono_ns(self):
        return 100 * time.monotonic_ns()


def test_a_board_that_prints_only_comments_is_said_to_after_a_while(wire):
    wire.talk(b"# hello\r\nms,T1_c\r\n")
    with pytest.raises(DecodeError, match="only comments and headers"):
        Text().open(settings(wire), HurriedClock())


def test_a_board_that_turns_to_comments_gives_no_reading_within_the_time_it_is_given(wire):
    wire.talk(b"T1=21.5 C\r\n")
    device = Text().open(settings(wire), HostClock())
    wire.talk(200 * b"# hello\r\n")
    end_s = time.monotonic() + 30.0
    while device.read(0.1) is not None:  # what was said before
        assert time.monotonic() < end_s
    assert device.read(0.1) is None
    device.close()


def test_unit_of_bare_numbers_is_configured(wire):
    wire.talk(b"98760\n")
    device = Text().open(settings(wire, unit="lux"), HostClock())
    assert (device.info.quantity, device.info.unit) == ("illuminance", "lx")
    assert device.read(1.0).values == (98760.0,)
    device.close()


@pytest.mark.parametrize("options", [{"columns": "a,b"}, {"no_value": 85}, {"no_value": ["x"]}])
def test_wrong_options_say_what_is_expected(wire, options):
    with pytest.raises(ConfigError, match="is not a list"):
        Text().open(settings(wire, **options), HostClock())


def test_bytes_are_read_with_the_drivers_options():
    decoded = Text().decode(b"85,21.5\n", {"columns": "T1,T2", "no_value": [85], "unit": "c"})
    assert [(value.channel, value.unit, value.flags) for value in decoded.values] == [
        ("T1", "°C", ["no_value"]),
        ("T2", "°C", []),
    ]


def test_decimal_commas_do_not_become_separators():
    rejected = Grammar().parse(b"21,5;98760\n")
    assert isinstance(rejected, Rejected)
    assert "point" in rejected.reason


def test_units_are_known_as_people_type_them():
    record = Grammar().parse("a=70 degF, b=294 °K, c=21 ºC, d=800 W/m^2\n".encode())
    assert [value.unit for value in record.values] == ["°F", "K", "°C", "W/m²"]


@pytest.mark.parametrize(
    ("line", "options", "measures"),
    [
        (b"GHI=712.5 W/m2\n", {}, ("ghi",)),
        (b"dhi_w_m2,ghi_w_m2\n80,712\n", {}, ("dhi", "ghi")),
        (b"sun=712.5 W/m2\n", {}, ()),
        (b"sun=712.5 W/m2\n", {"labels": ["dni"]}, ("dni",)),
        (b"GHI=98760 lx\n", {}, ()),
    ],
)
def test_only_the_name_of_a_column_says_which_light_a_board_measures(wire, line, options, measures):
    wire.talk(line)
    device = Text().open(settings(wire, **options), HostClock())
    assert device.info.measures == measures
    device.close()
