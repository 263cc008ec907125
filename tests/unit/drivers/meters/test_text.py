import math
import time

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.framing import Framer
from fieldkit.drivers.meters.text import Grammar, Text, _first_values, sensor_of
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DecodeError, DeviceTimeoutError
from fieldkit.model.samples import Quality
from tests.harness.next_steps import at


def settings(wire, **options):
    return DeviceSettings("board", "text", port=wire.path, options=options)


def values(data, **options):
    return [(value.channel, value.value, value.unit) for value in Text().decode(data, options).values]


def test_pairs_carry_their_unit():
    pairs = values(b"T1=21.56 C, lux = 98760 lx;w=-3e1W/m2\r\n")
    assert pairs == [("T1", 21.56, "°C"), ("lux", 98760.0, "lx"), ("w", -30.0, "W/m²")]


def test_header_names_the_columns_that_follow():
    pairs = values(b"ms,temp_c,light_lx\n12345,21.56,98760\n")
    assert pairs == [("temp_c", 21.56, "°C"), ("light_lx", 98760.0, "lx")]


def test_columns_may_be_given():
    assert values(b"21.5\t9\n", columns="temp_c,count") == [("temp_c", 21.5, "°C"), ("count", 9.0, "")]


def test_sentinels_blanks_and_nan_are_no_value():
    record = Grammar(("a", "b", "c"), "°C", (-127.0,)).parse(b"-127.00,,nan\n")
    assert [value.quality for value in record.values] == [Quality.NO_VALUE] * 3
    assert all(math.isnan(value.value) for value in record.values)


@pytest.mark.parametrize("line", [b"hello world=\xff\n", b"T1=abc C\n", b"1,2,3\n", b"=5\n", b"1" * 600])
def test_what_is_no_line_of_ours_is_rejected(line):
    assert isinstance(Grammar(("a", "b")).parse(line[:512]), Rejected)


def test_a_clock_that_64_bits_do_not_hold_is_rejected():
    grammar = Grammar(("ms", "T1_c"))
    assert grammar.parse(b"999999999999999999,21.5\n").device_time == 10**18 - 1
    assert isinstance(grammar.parse(b"9999999999999999999,21.5\n"), Rejected)


def test_a_board_that_prints_nothing_in_time_may_be_a_slow_one(wire, impatient):
    with pytest.raises(DeviceTimeoutError, match=r"nothing received") as caught:
        Text().open(settings(wire), HostClock())
    assert "every_s" in str(caught.value.fix)


def test_board_with_header_and_clock_is_recorded(wire):
    wire.talk(b"# ready\r\nms,T1_c,T2_c,light_lx\r\n12345,21.50,-127,98760\r\n")
    device = wire.open(Text(), settings(wire, no_value=[-127, 85], labels=["reference", "bed"]))
    assert (device.info.unit, device.info.device_time_unit) == ("K", "ms")
    assert device.info.channels == ("reference", "bed")
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


def test_bytes_are_read_with_the_drivers_options():
    decoded = Text().decode(b"85,21.5\n", {"columns": "T1,T2", "no_value": [85], "unit": "c"})
    assert [(value.channel, value.unit) for value in decoded.values] == [("T1", "°C"), ("T2", "°C")]
    assert [value.flags for value in decoded.values] == [["no_value"], []]


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
    device = wire.open(Text(), settings(wire, **options))
    assert device.info.measures == measures


C, LX = "°C", "lx"
NO_VALUES = ("OL", "ovf", "---", "nan", "NaN", "n/a", "null", "ERR!")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"Light: 54612.5 lx", [("Light", 54612.5, LX)]),
        (b"Light:54612.5lux", [("Light", 54612.5, LX)]),
        (b"Light level: 54612 lx Temp: 23.1 C", [("Light level", 54612.0, LX), ("Temp", 23.1, C)]),
        (b"Temp(C): 23.1", [("Temp", 23.1, C)]),
        (b"Temp (C): -23.1", [("Temp", -23.1, C)]),
        (b"Sensor 1: 21.5 C, Sensor 2: -0.5 C", [("Sensor 1", 21.5, C), ("Sensor 2", -0.5, C)]),
        # the line of the DHT examples, its degree sign in Latin-1
        (
            b"Humidity: 55.00%  Temperature: 23.40\xb0C 74.12\xb0F  Heat index: 23.24\xb0C 73.83\xb0F",
            [("Humidity", 55.0, "%"), ("Temperature", 23.4, C), ("Heat index", 23.24, C)],
        ),
        (b"T=21.5 L=300", [("T", 21.5, ""), ("L", 300.0, "")]),
        (b"T=21.5 C L=300 lx", [("T", 21.5, C), ("L", 300.0, LX)]),
        (b"P: 1013 hPa T: 3 C", [("P", 1013.0, "hPa"), ("T", 3.0, C)]),
        (b"tempC=23.4, light_lux=300", [("tempC", 23.4, C), ("light_lux", 300.0, LX)]),
        (b"23.4C;54612 lux", [("column 1", 23.4, C), ("column 2", 54612.0, LX)]),
        (b"21.5 C 98760 lx", [("column 1", 21.5, C), ("column 2", 98760.0, LX)]),
        (b"21.5 98760", [("column 1", 21.5, ""), ("column 2", 98760.0, "")]),
        ("E=120 µW/cm2".encode(), [("E", 120.0, "µW/cm²")]),
        ("T: \N{MINUS SIGN}3.2 \N{DEGREE CELSIUS}".encode(), [("T", -3.2, C)]),
        (b"12:34:56.789 -> Light: 5 lx", [("Light", 5.0, LX)]),
        (b"[00:01:02] T=21.5 C", [("T", 21.5, C)]),
        (b"25.11.2026 12:00:00;-21.5;3", [("column 1", -21.5, ""), ("column 2", 3.0, "")]),
        (b"I (310) main: T=21.5 C", [("T", 21.5, C)]),
        (
            b'{"temp_c": 21.5, "id": "bed", "sky": {"lux": 98760}, "ok": true}',
            [("temp_c", 21.5, C), ("sky.lux", 98760.0, LX)],
        ),
        (b'{"temp": {"value": 23.4, "unit": "C"}}', [("temp.value", 23.4, C)]),
        (b"[21.5, 3]", [("column 1", 21.5, ""), ("column 2", 3.0, "")]),
        (b"(21.5, 3)", [("column 1", 21.5, ""), ("column 2", 3.0, "")]),
        (
            b'MQT: tele/bed/SENSOR = {"DS18B20":{"Id":"0316A27E1AFF","temp_c":23.4}}',
            [("DS18B20.temp_c", 23.4, C)],
        ),
        # an MLX90614 whose object is out of its range
        (b"Ambient 24.1 C, Object -7999 C", [("Ambient", 24.1, C), ("Object", -7999.0, C)]),
        (b"Sensor 1 24.1 C; Sensor 2 25 C", [("Sensor 1", 24.1, C), ("Sensor 2", 25.0, C)]),
        # ClosedCube_SHT31D's and SparkFun's words
        (b"Temp *C = 23.40\t\tHum. % = 45.60", [("Temp *C", 23.4, C), ("Hum. %", 45.6, "")]),
        (b"Temperature in Celsius: 23.4", [("Temperature in Celsius", 23.4, C)]),
        (b"21,5;98760,0", [("column 1", 21.5, ""), ("column 2", 98760.0, "")]),
        (b"21,5 -0,25", [("column 1", 21.5, ""), ("column 2", -0.25, "")]),
        (b"T=21,5 C", [("T", 21.5, C)]),
        (b"T1=21,562 C;T2=22,25 C", [("T1", 21.562, C), ("T2", 22.25, C)]),
        ("Temperatur: 21,5 °C Feuchte: 45,3 %".encode(), [("Temperatur", 21.5, C), ("Feuchte", 45.3, "%")]),
        (b"temp_c\n21,5", [("temp_c", 21.5, C)]),
        (
            b"n,temp_c\n21,5\nn,temp_c\n22,5",
            [("n", 21.0, ""), ("temp_c", 5.0, C), ("n", 22.0, ""), ("temp_c", 5.0, C)],
        ),
        # logs of ESPHome, of 2022 in colour, and from 2025.12 on
        (
            b"\x1b[0;36m[D][sensor:093]: 'T': Sending state 23.4 \xb0C with 1 decimals of accuracy\x1b[0m",
            [("T", 23.4, C)],
        ),
        (b"[10:18:17.439][S][sensor]: 'Sky: 1' >> 98760 lx", [("Sky: 1", 98760.0, LX)]),
        (
            b"[10:05:20][D][sensor:126]: 'n': Sending state 7.00000 with 0 decimals of accuracy",
            [("n", 7.0, "")],
        ),
        ("[13:13:26][D][dht:048]: Got Temperature=15.5°C Humidity=80.3%".encode(), []),
        (b"[19:59:55.692][S][binary_sensor]: 'Lounge Presence' >> ON", []),
        # Teleplot: name, time, value, unit, flags
        (b">T1:21.5\n>lux:3", [("T1", 21.5, ""), ("lux", 3.0, LX)]),
        (">T1:1627551892437:21.5§°C|np".encode(), [("T1", 21.5, C)]),
        (b">log:boot done|t\n>way:12:10|xy\n>T1:1;2;3", []),
    ],
)
def test_lines_of_other_boards_are_read(line, expected):
    assert values(line + b"\n") == expected


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


def test_a_board_whose_light_is_over_range_keeps_its_temperatures(wire):
    wire.talk(b"ms,temp_c,lux\n1,21.5,OL\n")
    device = wire.open(Text(), settings(wire))
    reading = device.read(1.0)
    assert (reading.values, reading.quality) == ((pytest.approx(294.65),), Quality.GOOD)


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


def test_an_error_names_the_sensor_whose_example_the_board_runs(wire):
    wire.talk(EXAMPLES["ds18b20"][32:])
    with pytest.raises(DecodeError, check=at("board")) as caught:
        Text().open(settings(wire, sensor="bh1750"), HostClock())
    assert "ds18b20" in caught.value.fix
    wire.talk(EXAMPLES["max31856"])
    with pytest.raises(ConfigError, check=at("board")) as caught:
        Text().open(settings(wire), HostClock())
    assert "max31856" in caught.value.fix


@pytest.mark.parametrize("said", [b"LUX 980.2\n", b"LUX 980.2 "])
def test_a_board_that_cannot_be_read_shows_its_line_and_the_accepted_forms(wire, said):
    wire.talk(said)
    with pytest.raises(DecodeError) as caught:
        Text().open(settings(wire), HostClock())
    assert "LUX 980.2" in caught.value.message
    assert "T1=21.56 C" in str(caught.value.fix)


def test_a_meter_states_why_it_dropped_a_line(wire):
    wire.talk(b"T=21.5 C\nLUX 980.2\n")
    device = wire.open(Text(), settings(wire))
    for _ in range(3):
        device.read(1.0)
    assert "'LUX 980.2'" in device.rejected_because


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
