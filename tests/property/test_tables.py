"""Tables of loggers in many shapes, their truth known: read rightly or refused, never silently different."""

import math
import random
from collections import Counter
from dataclasses import dataclass, field

import pytest

from fieldkit.model.errors import ConfigError
from tests.harness.logs import read, readings

START_MINUTES = 600  # 10:00
UNITS = {
    # stored unit: spellings, and the written number of a stored one
    "K": [
        (
            ["C", "°C", "ºC", "° C", "degC", "deg C", "degrees C", "Celsius", "℃", "oC", "(*C)"],
            lambda k: k - 273.15,
        ),
        (["F", "°F", "*F", "deg F", "Fahrenheit"], lambda k: (k - 273.15) * 1.8 + 32.0),
        (["K", "Kelvin"], lambda k: k),
    ],
    "lx": [
        (["lx", "lux", "Lux", "lm/m2", "lm m⁻²"], lambda lx: lx),
        (["klx", "kLux"], lambda lx: lx / 1000.0),
    ],
    "W m-2": [
        (["W/m2", "W/m²", "W m-2", "W m⁻²", "W/m^2", "W/m**2", "Wm-2"], lambda w: w),
        (["mW/cm2", "mW/cm²"], lambda w: w / 10.0),
    ],
}
NAMES = {
    "K": ["bed", "Sand", "T1", "surface temp", "b05", "probe_2", "Bodentemperatur", "air"],
    "lx": ["light", "sky", "E2", "Beleuchtung", "lamp 3"],
    "W m-2": ["GHI", "dni", "Diffuse Horizontal", "sun", "pyranometer"],
}
WRONG = {"K": "lx", "lx": "C", "W m-2": "K"}


@dataclass
class Sensor:
    """A channel of the truth: its name, stored unit, spelling, values as written and in the stream's unit."""

    name: str
    stored: str
    spelling: str
    texts: list[str]
    values: list[float] = field(default_factory=list)


def a_sensor(chance: random.Random, name: str, stored: str, count: int, mark: str) -> Sensor:
    spellings, written = chance.choice(UNITS[stored])
    low, high = {"K": (270.0, 330.0), "lx": (800.0, 99_000.0), "W m-2": (2.0, 900.0)}[stored]
    start, step = chance.uniform(low, high), chance.uniform(-1.0, 1.0) * (high - low) / 500.0
    numbers = [round(written(min(max(start + step * n, low), high)), 2) for n in range(count)]
    thousands = chance.choice(["", "", "'", "\u00a0", "\u202f", "’"])
    texts = [
        f"{number:,.2f}".replace(",", "T").replace(".", "," if mark == ";" else ".").replace("T", thousands)
        for number in numbers
    ]
    return Sensor(
        name, stored, chance.choice(spellings), texts, [_stored(written, number) for number in numbers]
    )


def _stored(written, number: float) -> float:
    """The stored number by the written one: all laws are straight lines."""
    slope = written(1.0) - written(0.0)
    return (number - written(0.0)) / slope


FORMS = ["{} [{}]", "{} ({})", "{}, ({})", "{} - {}", "{}, {}", "{} / {}", "{}[{}]"]
GLUED = ["{}{}", "{}_{}"]


def with_unit(chance: random.Random, sensor: Sensor) -> str:
    """A header that states the unit in one of the ways of loggers."""
    forms = FORMS + (GLUED if sensor.spelling[0] in "°℃º" else [])
    return chance.choice(forms).format(sensor.name, sensor.spelling)


def quoted(text: str, mark: str) -> str:
    return f'"{text}"' if mark in text or '"' in text else text


def times(offset_s: int, count: int) -> list[str]:
    return [
        f"2026-06-11T{(START_MINUTES + n) // 60:02}:{(START_MINUTES + n) % 60:02}:{offset_s:02}Z"
        for n in range(count)
    ]


def a_table(chance: random.Random) -> tuple[str, list[Sensor], dict[str, object]]:
    """A table's text, its truth and the options it is read with."""
    mark, count = chance.choice([",", ";", "\t"]), chance.randrange(6, 14)
    how_many = chance.randrange(1, 4)
    kinds = [chance.choice(list(UNITS)) for _ in range(how_many)]
    names = [name for kind in UNITS for name in chance.sample(NAMES[kind], kinds.count(kind))]
    kinds.sort(key=list(UNITS).index)
    sensors = [a_sensor(chance, name, kind, count, mark) for name, kind in zip(names, kinds, strict=True)]
    shape = chance.choice([wide, long])
    options = {"unit": WRONG[sensors[0].stored]} if chance.random() < 0.3 else {}
    return shape(chance, sensors, mark, count), sensors, options


def wide(chance: random.Random, sensors: list[Sensor], mark: str, count: int) -> str:
    where = chance.choice(["header", "line", "cells", "columns"])
    columns: list[tuple[str, str, list[str]]] = []
    for sensor in sensors:
        if where == "header":
            columns.append((with_unit(chance, sensor), "", sensor.texts))
        elif where == "line":
            columns.append(
                (sensor.name, chance.choice(["{}", "[{}]", "({})"]).format(sensor.spelling), sensor.texts)
            )
        elif where == "cells":
            columns.append((sensor.name, "", [f"{text} {sensor.spelling}" for text in sensor.texts]))
        else:
            pair = [(sensor.name, "", sensor.texts), (f"{sensor.name} unit", "", [sensor.spelling] * count)]
            columns += pair[:: chance.choice([1, -1]) if sensor is sensors[0] else 1]
    if chance.random() < 0.3:
        columns.append(
            ("Battery [V]", "V" if where == "line" else "", ["3.7" if mark != ";" else "3,7"] * count)
        )
    if chance.random() < 0.3:
        columns.append(("note", "", [chance.choice(["", "dry", "wind"]) for _ in range(count)]))
    columns.insert(0 if chance.random() < 0.8 else len(columns), ("time", "", times(0, count)))
    if chance.random() < 0.3:
        columns.insert(0, ("No", "", [str(n + 1) for n in range(count)]))
    rows = [[head for head, _, _ in columns]]
    if where == "line":
        rows.append([unit for _, unit, _ in columns])
    rows += [[texts[n] for _, _, texts in columns] for n in range(count)]
    return "".join(mark.join(quoted(cell, mark) for cell in row) + "\n" for row in rows)


def long(chance: random.Random, sensors: list[Sensor], mark: str, count: int) -> str:
    where = (
        chance.choice(["cells", "columns"]) if len({sensor.spelling for sensor in sensors}) > 1 else "header"
    )
    telling = chance.choice(["entity_id", "sensor", "topic", "_field", "what"])
    if chance.random() < 0.2 and len({sensor.stored for sensor in sensors}) == len(sensors):
        telling = "id"
        for number, sensor in enumerate(sensors, start=1):
            sensor.name = str(number)
    head = {"time": "time", "thing": telling, "value": "value"}
    if where == "header":
        head["value"] = f"value [{sensors[0].spelling}]"
    elif where == "columns":
        head["unit"] = chance.choice(["unit", "unit_of_measurement", "Einheit"])
    offsets = [chance.choice([0, 7 * place]) for place in range(len(sensors))]
    rows = []
    for place, sensor in enumerate(sensors):
        for n, time in enumerate(times(offsets[place], count)):
            value = sensor.texts[n] + (f" {sensor.spelling}" if where == "cells" else "")
            rows.append(
                (n, place, {"time": time, "thing": sensor.name, "value": value, "unit": sensor.spelling})
            )
    if chance.random() < 0.7 or telling == "what":
        rows.sort(key=lambda row: row[2]["time"])
    order = list(head)
    chance.shuffle(order)
    lines = [[head[key] for key in order], *([row[key] for key in order] for _, _, row in rows)]
    return "".join(mark.join(quoted(cell, mark) for cell in line) + "\n" for line in lines)


def differences(imported, sensors: list[Sensor]) -> list[str]:
    """Channels of the truth that were not read as they are."""
    channels = {}
    for info in imported.streams:
        for place, label in enumerate(info.channels):
            numbers = [reading.values[place] for reading in readings(imported, info.name)]
            channels[label.lower(), info.unit] = [number for number in numbers if not math.isnan(number)]
    wrong = []
    for sensor in sensors:
        names = {sensor.name.lower(), f"{sensor.name}_{sensor.spelling}".lower()} | (
            {"value"} if len(sensors) == 1 else set()
        )
        numbers = [
            channel for (label, unit), channel in channels.items() if label in names and unit == sensor.stored
        ]
        if len(numbers) != 1 or numbers[0] != pytest.approx(sensor.values, rel=1e-6):
            wrong.append(f"{sensor}: {numbers or list(channels)}")
    return wrong


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_tables_of_every_shape_are_read_rightly_or_refused(tmp_path, first):
    outcomes = Counter()
    for seed in range(first, first + 50):
        text, sensors, options = a_table(random.Random(seed))
        try:
            imported = read(tmp_path, text, zone=None, **options)
        except ConfigError:
            continue
        assert differences(imported, sensors) == [], (seed, text)
        outcomes["read"] += 1
    assert outcomes["read"] >= 40
