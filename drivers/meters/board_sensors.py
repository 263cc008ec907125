"""Lines that the example sketches of sensors' libraries print: the option `sensor` of the driver `text`.

Most examples print a value per line, some without a unit: of each, one line has the value that is recorded,
the others are known and skipped. Each sensor names the sketch it was read from, on GitHub. Where a sketch can
be changed, those of `examples/firmware` print all values in one line, with units and the board's clock.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

_NUMBER = r"(-?\d+(?:\.\d+)?|nan|inf|ovf)"  # as Arduino's Print writes a float
_NEVER = r"(?!)"


class Sensor(NamedTuple):
    """Output of one example: patterns of whole lines; the group of `value` is the value, in `unit`.

    `failure` is a line in place of a value, `others` are lines without it; `options` are the driver's, unless
    the configuration gives them. Where several lines make one record, `last` is the line behind them, and the
    groups of `value` are channel and value.
    """

    value: str
    channel: str = "T1"
    unit: str = "°C"
    options: Mapping[str, Any] = MappingProxyType({"baud": 115_200})
    failure: str = _NEVER
    others: str = _NEVER
    last: str = ""

    def reading(self, line: str) -> str | None:
        """The value of a line, ``nan`` for a failure, empty for one without; None for any other line."""
        if match := re.fullmatch(self.value, line):
            return match[1]
        if re.fullmatch(self.failure, line):
            return "nan"
        return "" if re.fullmatch(f"{self.others}|{self.last}", line) else None

    def channels(self, lines: Sequence[str]) -> list[tuple[str, str]] | None:
        """Channel and value of each line of a record of several lines; None if one is another line."""
        matches = [re.fullmatch(self.value, line) for line in lines if line]
        return [(match[1], match[2] or "nan") for match in matches if match] if all(matches) else None


SENSORS: Mapping[str, Sensor] = {
    # claws/BH1750 examples/BH1750test; src/BH1750.cpp: -1 no answer, -2 not configured, end 65535/1.2
    "bh1750": Sensor(
        channel="lux",
        unit="lx",
        value=f"Light: {_NUMBER} lx",
        options={"baud": 9600, "no_value": (-1, -2), "range_max_lx": 54_612.0},
    ),
    # adafruit/Adafruit_TSL2591_Library examples/tsl2591; Adafruit_TSL2591.cpp: 0 overflow, end 88 klx
    "tsl2591": Sensor(
        channel="lux",
        unit="lx",
        value=r"\[ \d+ ms(?: -> \d+ ms)? \] (?:IR: \d+  Full: \d+  Visible: -?\d+  Lux: )?"
        + _NUMBER
        + "(?: lux)?",
        failure=r"\[ \d+ ms \] Invalid data \(adjust gain or timing\)",
        options={"baud": 9600, "no_value": (0,), "range_max_lx": 88_000.0},
    ),
    # adafruit/Adafruit_VEML7700 examples/veml7700_test, two versions
    "veml7700": Sensor(
        channel="lux",
        unit="lx",
        value=f"[Ll]ux: {_NUMBER}",
        others=rf"(?:White|Raw ALS|raw white|raw ALS): {_NUMBER}|\*\* (?:Low|High) threshold",
    ),
    # adafruit/Adafruit-MAX31855-library examples/serialthermocouple
    "max31855": Sensor(
        value=f"C = {_NUMBER}",
        failure=r"Thermocouple fault\(s\) detected!",
        others=rf"Internal Temp = {_NUMBER}|F = {_NUMBER}|FAULT: Thermocouple is .*|MAX\d+ test"
        r"|Initializing sensor\.\.\.DONE\.",
        options={"baud": 9600},
    ),
    # adafruit/Adafruit_MCP9600 examples/mcp9600_test
    "mcp9600": Sensor(
        value=f"Hot Junction: {_NUMBER}",
        others=rf"Cold Junction: {_NUMBER}|ADC: -?\d+ uV",
    ),
    # adafruit/Adafruit_MAX31856 examples/max31856_oneshot and others
    "max31856": Sensor(
        value=f"(?:Thermocouple|Continuous) Temp: {_NUMBER}",
        failure=".* Fault",
        others=rf"Cold Junction Temp: {_NUMBER}|MAX31856 thermocouple test|Thermocouple type: .*",
    ),
    # adafruit/Adafruit_MAX31865 examples/max31865
    "max31865": Sensor(
        value=f"Temperature = {_NUMBER}",
        failure="Fault 0x.*",
        others=rf"RTD value: \d+|Ratio = {_NUMBER}|Resistance = {_NUMBER}|RTD.*|REFIN.*"
        "|Under/Over voltage|Adafruit MAX31865 .*",
    ),
    # milesburton/Arduino-Temperature-Control-Library examples/Simple and /Single; -127 is
    # DEVICE_DISCONNECTED_C, 85 the power-on value of the data sheet
    "ds18b20": Sensor(
        value=rf"(?:Temperature for the device 1 \(index 0\) is|Temp C): {_NUMBER}(?: Temp F: .*)?",
        failure="Error: Could not read temperature data",
        others=r"Requesting temperatures\.\.\.DONE",
        options={"baud": 9600, "no_value": (-127, 85)},
    ),
    # the same library's examples/Multiple, with any number of probes: a channel for each address
    "ds18b20-multiple": Sensor(
        channel="",
        value=rf"Device Address: ([0-9A-F]{{16}}) (?:Temp C: {_NUMBER} Temp F: .*|Error: Could not .*)",
        others="Dallas Temperature IC Control Library Demo|Locating devices.*|Parasite power is: .*"
        r"|Unable to find address for .*|Device \d+ (?:Address|Resolution): .*",
        last=r"Requesting temperatures\.\.\.DONE",
        options={"baud": 9600, "no_value": (-127, 85)},
    ),
    # adafruit/Adafruit_SHT4X examples/SHT4x_non-blocking and SHT4test
    "sht4x": Sensor(
        channel="air",
        value=f"Temperature: {_NUMBER} degrees C",
        others=rf"Humidity: {_NUMBER}% rH|Read duration \(ms\): \d+",
    ),
    # adafruit/Adafruit_SCD30 examples/adafruit_scd30_test
    "scd30": Sensor(
        channel="air",
        value=f"Temperature: {_NUMBER} degrees C",
        failure="Error reading sensor data",
        others=rf"Relative Humidity: {_NUMBER} %|e?CO2: {_NUMBER} ppm|Data available!|.*SCD30 .*"
        r"|Measurement Interval: \d+ seconds",
    ),
    # adafruit/Adafruit_BME280_Library examples/bme280test
    "bme280": Sensor(
        channel="air",
        value=f"Temperature = {_NUMBER} (?:[*]|°)C",
        others=rf"Pressure = {_NUMBER} hPa|Approx\. Altitude = {_NUMBER} m|Humidity = {_NUMBER} %"
        r"|BME280 test|-- Default Test --",
        options={"baud": 9600},
    ),
}
"""The sensors, by the value of the option."""
