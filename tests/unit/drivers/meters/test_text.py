import math
import time

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.framing import Framer
from fieldkit.drivers.meters.text import Grammar, Text, _first_values, sensor_of
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DecodeError
from fieldkit.model.samples import Quality
from tests.harness.next_steps import at


def settings(wire, **options):
    return DeviceSettings("board", "text", port=wire.path, options=options)


def values(data, **options):
    return [(value.channel, value.value, value.unit) for value in Text().decode(data, options).values]


@pytest.mark.parametrize("line", [b"hello world=\xff\n", b"T1=abc C\n", b"1,2,3\n", b"=5\n", b"1" * 600])
def test_what_is_no_line_of_ours_is_rejected(line):
    assert isinstance(Grammar(("a", "b")).parse(line[:512]), Rejected)


def test_a_clock_that_64_bits_do_not_hold_is_rejected():
    grammar = Grammar(("ms", "T1_c"))
    assert grammar.parse(b"999999999999999999,21.5\n").device_time == 10**18 - 1
    assert isinstance(grammar.parse(b"9999999999999999999,21.5\n"), Rejected)


def test_board_with_header_and_clock_is_recorded(wire):
    wire.talk(b"# ready\r\nms,T1_c,T2_c,light_lx\r\n12345,21.50,-127,98760\r\n")
    device = wire.open(Text(), settings(wire, no_value=[-127, 85], labels=["reference", "bed"]))
    assert (device.info.unit, device.info.device_time_unit) == ("K", "ms")
    assert device.info.channels == ("reference", "bed")
    assert device.info.settings["not_recorded"] == "light_lx"
    reading = device.read(1.0)
    assert reading.values[0] == pytest.approx(294.65)
    assert math.isnan(reading.values[1])
    assert reading.device_time == 12345


class HurriedClock(HostClock):
    """Time passes a hundred times as fast."""

    def mono_ns(self):
        return 100 * time.monotonic_ns()


def test_a_board_that_prints_only_comments_is_said_to_after_a_while(wire):
    wire.talk(b"# hello\r\nms,T1_c\r\n")
    with pytest.raises(DecodeError, check=at("board")):
        Text().open(settings(wire), HurriedClock())


def test_a_board_that_turns_to_comments_gives_no_reading_within_the_time_it_is_given(wire):
    wire.talk(b"T1=21.5 C\r\n")
    device = wire.open(Text(), settings(wire))
    wire.talk(200 * b"# hello\r\n")
    end_s = time.monotonic() + 30.0
    while device.read(0.1) is not None:  # what was said before
        assert time.monotonic() < end_s
    assert device.read(0.1) is None


def test_unit_of_bare_numbers_is_configured(wire):
    wire.talk(b"98760\n")
    device = wire.open(Text(), settings(wire, unit="lux"))
    assert (device.info.quantity, device.info.unit) == ("illuminance", "lx")
    assert device.read(1.0).values == (98760.0,)


@pytest.mark.parametrize("options", [{"columns": "a,b"}, {"no_value": 85}, {"no_value": ["x"]}])
def test_wrong_options_say_what_is_expected(wire, options):
    with pytest.raises(ConfigError, match=rf"{next(iter(options))} = "):
        Text().open(settings(wire, **options), HostClock())


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
    device = wire.open(Text(), settings(wire, **options))
    assert device.info.measures == measures


NO_VALUES = ("OL", "ovf", "---", "nan", "NaN", "n/a", "null", "ERR!")


@pytest.mark.parametrize("bad", [*NO_VALUES, ">99999", "9x760", "98.7.60", "abc", "1e999", ""])
@pytest.mark.parametrize(
    "line", ["ms,temp_c,lux\n1,21.5,{}\n", "temp_c=21.5, lux={}\n", '{{"temp_c": 21.5, "lux": "{}"}}\n']
)
def test_a_bad_field_costs_its_channel_alone(line, bad):
    decoded = Text().decode(line.format(bad).encode(), {})
    good, *bad_values = decoded.values
    assert (good.channel, good.value, good.flags) == ("temp_c", 21.5, [])
    assert all((value.channel, value.flags) == ("lux", ["no_value"]) for value in bad_values)
    assert decoded.rejected == ()


def test_an_open_probe_of_a_board_without_other_channels_is_no_value_of_its_stream(wire):
    wire.talk(b"T=OL\nT=21.5 C\n")
    device = wire.open(Text(), settings(wire))
    readings = [device.read(1.0) for _ in range(4)]
    assert device.info.unit == "K"
    kinds = {(one.quality, math.isnan(one.values[0])) for one in readings}
    assert kinds == {(Quality.NO_VALUE, True), (Quality.GOOD, False)}


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_lines_end_with_cr_lf_or_both(wire, end):
    assert values(b"T=1 C" + end + b"T=2 C" + end) == [("T", 1.0, "°C"), ("T", 2.0, "°C")]
    wire.talk(b"T=21.5 C" + end)
    device = wire.open(Text(), settings(wire))
    assert [device.read(1.0).values[0] for _ in range(3)] == [pytest.approx(294.65)] * 3
    assert device.rejected <= 1  # the line that was under way


def test_messages_of_a_board_that_starts_do_not_declare_its_stream(wire):
    boot = b"rst:0x1 (POWERON_RESET),boot:0x13\r\nmode:DIO, clock div:1\r\nWiFi connected: yes\r\nready\r\n"
    wire.talk(boot + b"21.5 C, 98760 lx\r\n")
    device = wire.open(Text(), settings(wire))
    assert (device.info.unit, device.info.channels) == ("K", ("column 1",))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"LUX 980.2\n", "'LUX 980.2': neither a sign"),
        (b"T1 21.5, T2 22.5\n", "'T1 21.5, T2 22.5': neither a sign"),
        (b"T1=21,5 C, T2=22 C, 3\n", "a number without a name"),
        (b"lux=54,612 lx\n", "a decimal comma or thousands"),
        (b"x: 12 345 lx\n", "lines may be"),
        (b"1,2,3\n", "'1,2,3': 3 fields, 2 columns"),
        (b"{oops}\n", "not JSON"),
        (b"T=\xfe\xff\n", "wrong baud rate"),
    ],
)
def test_a_line_that_is_rejected_is_shown_with_the_reason(line, reason):
    assert reason in Grammar(("a", "b")).parse(line).reason


def test_one_number_with_a_comma_and_nothing_else_is_refused():
    for line in (b"21,5\n", b"3,21 C\n"):
        assert "decimal comma or two columns" in Grammar().parse(line).reason


def test_lines_in_turn_are_one_stream(wire):
    """As of ESPHome's log and Teleplot: one channel a line, those of the first quantity make the stream."""
    wire.talk(b"boot: ok\r\n>bed:21.5\xc2\xa7C\r\n>lux:5\r\n>ref:22.5\xc2\xa7C\r\n")
    device = wire.open(Text(), settings(wire))
    assert set(device.info.channels) == {"bed", "ref"}
    readings = [device.read(1.0).values for _ in range(2)]
    assert sorted(value for values in readings for value in values if value > 0) == pytest.approx(
        [294.65, 295.65]
    )


EXAMPLES = {  # what each library's example prints, from its boot on
    "bh1750": b"BH1750 Test begin\r\nLight: 54.17 lx\r\nLight: 55.00 lx\r\n",
    "tsl2591": b"[ 5021 ms ] IR: 2101  Full: 8213  Visible: 6112  Lux: 412.345678\r\n",
    "max31855": b"MAX31855 test\r\nInitializing sensor...DONE.\r\nInternal Temp = 22.44\r\nC = 48.25\r\n",
    "max31856": b"Thermocouple type: K Type\r\nCold Junction Temp: 23.44\r\nThermocouple Temp: 24.12\r\n",
    "max31865": b"RTD value: 8123\r\nRatio = 0.24789\r\nResistance = 106.59\r\nTemperature = 16.94\r\n\r\n",
    "ds18b20": b"Requesting temperatures...DONE\r\nTemperature for the device 1 (index 0) is: 21.56\r\n",
    "sht4x": b"Temperature: 23.45 degrees C\r\nHumidity: 45.60% rH\r\n",
    "scd30": b"SCD30 Found!\r\nTemperature: 24.10 degrees C\r\nRelative Humidity: 45.2 %\r\n",
    "bme280": b"BME280 test\r\nTemperature = 23.45 *C\r\nPressure = 1013.25 hPa\r\nHumidity = 45.67 %\r\n",
    "": b"T1=21.5 C\r\nT1=21.6 C\r\n",
}


@pytest.mark.parametrize("sensor", EXAMPLES)
def test_an_example_is_known_by_what_it_prints(sensor):
    assert sensor_of(EXAMPLES[sensor]) == sensor


@pytest.mark.usefixtures("soon")
def test_an_error_names_the_sensor_whose_example_the_board_runs(wire):
    wire.talk(EXAMPLES["ds18b20"][32:])
    with pytest.raises(DecodeError, check=at("board")) as caught:
        Text().open(settings(wire, sensor="bh1750"), HostClock())
    assert "ds18b20" in caught.value.fix
    wire.talk(EXAMPLES["max31856"])
    with pytest.raises(ConfigError, check=at("board")) as caught:
        Text().open(settings(wire), HostClock())
    assert "max31856" in caught.value.fix


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("said", [b"LUX 980.2\n", b"LUX 980.2 "])
def test_a_board_that_cannot_be_read_shows_its_line_and_the_accepted_forms(wire, said):
    wire.talk(said)
    with pytest.raises(DecodeError) as caught:
        Text().open(settings(wire), HostClock())
    assert "LUX 980.2" in caught.value.message
    assert "T1=21.56 C" in str(caught.value.fix)


def test_microwatts_and_kilolux_become_the_streams_unit(wire):
    """1 µW/cm² is 1e-6 W on 1e-4 m²."""
    wire.talk(b"ghi=71200 uW/cm2\n")
    device = wire.open(Text(), settings(wire))
    assert device.info.unit == "W m-2"
    assert device.read(1.0).values == (pytest.approx(712.0),)


class Lines:
    """A port that was opened in the middle of the first line."""

    path = "the test"

    def __init__(self, *lines):
        self.lines, self.framer = list(lines), Framer(0)

    def read(self, layout, timeout_s):
        return self.framer.feed(layout, self.lines.pop(0), 0) if self.lines else None


@pytest.mark.parametrize(
    ("part", "line", "unit", "names"),
    [
        (b" C, T2=22.5 C, T3=23 C\n", b"T1=21.5 C, T2=22.5 C, T3=23 C\n", "", ["T1", "T2", "T3"]),
        (b"=22.5 C, T3=23 C\n", b"T1=21.5 C, T2=22.5 C, T3=23 C\n", "", ["T1", "T2", "T3"]),
        (b".5\n", b"21.5,22.5\n", "°C", ["column 1", "column 2"]),
    ],
)
def test_the_line_that_was_being_printed_when_the_port_was_opened_declares_nothing(part, line, unit, names):
    board = DeviceSettings("board", "text")
    _, first = _first_values(Lines(part, line, line), Grammar(unit=unit), board, HostClock())
    assert [channel.name for channel in first.channels] == names


@pytest.mark.parametrize(("before", "every_s"), [(b"# ready\n", 1.0), (b"temp_c\n", 1.0), (b"", 30.0)])
def test_a_line_behind_another_is_whole_and_that_of_a_slow_board_is_not_missed(before, every_s):
    lines = Lines(*filter(None, [before, b"T1=21.5 C\n", b"T1=22.5 C\n"]))
    board = DeviceSettings("board", "text", every_s=every_s)
    assert _first_values(lines, Grammar(), board, HostClock())[1].numbers == (21.5,)
