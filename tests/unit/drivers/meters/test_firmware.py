"""The sketches of examples/firmware, compiled for this computer: the driver `text` reads what they print."""

import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from fieldkit.drivers.meters.text import Text

PROJECT = Path(__file__).parents[4]
BOARD = PROJECT / "tests/harness/board/Arduino.h"


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Bytes of one turn of a sketch's loop; its libraries are those of the board in Arduino.h."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    folder = tmp_path_factory.mktemp("sketches")

    def run(name, **sensors):
        sketch = PROJECT / f"examples/firmware/{name}/{name}.ino"
        program = folder / name
        if not program.exists():
            for library in re.findall(r"#include <(.+)>", sketch.read_text()):
                (folder / library).write_text(f'#include "{BOARD}"\n')
            source = folder / f"{name}.cpp"
            source.write_text(f'#include "{sketch}"\nint main() {{ setup(); loop(); }}\n')
            subprocess.run([compiler, "-I", folder, "-o", program, source], check=True)
        environment = os.environ | {key: str(value) for key, value in sensors.items()}
        return subprocess.run([program], env=environment, capture_output=True, check=True).stdout

    return run


FIRST = ("T28FF641D93160300", 21.56, "°C")


@pytest.mark.parametrize(
    ("name", "sensors", "expected"),
    [
        # 65535 counts end at 117758 lx with the measurement time 32: src/BH1750.cpp of claws/BH1750
        ("light", {"COUNTS": 54_961}, [("lux", 98_758.05, "lx")]),
        ("light", {"COUNTS": 65_535}, [("lux", math.nan, "lx")]),
        ("light", {"COUNTS": -1}, [("lux", math.nan, "lx")]),
        ("thermocouple", {"CELSIUS": -5.25}, [("T1", -5.25, "°C"), ("cold_junction", 22.44, "°C")]),
        ("thermocouple", {"CELSIUS": "nan"}, [("T1", math.nan, ""), ("cold_junction", 22.44, "°C")]),
        ("one_wire", {"CELSIUS": 34.06}, [FIRST, ("T28FF641D93160301", 34.06, "°C")]),
        ("one_wire", {"CELSIUS": -127}, [FIRST, ("T28FF641D93160301", math.nan, "")]),
        ("one_wire", {"CELSIUS": 85}, [FIRST, ("T28FF641D93160301", math.nan, "")]),
        ("humidity", {"CELSIUS": 23.45}, [("air", 23.45, "°C"), ("humidity", 45.67, "%")]),
        ("humidity", {"CELSIUS": "nan"}, [("air", math.nan, ""), ("humidity", math.nan, "")]),
    ],
)
def test_a_sketch_prints_lines_that_the_text_driver_reads(printed, name, sensors, expected):
    decoded = Text().decode(printed(name, **sensors), {})
    assert decoded.rejected == ()
    for value, (channel, number, unit) in zip(decoded.values, expected, strict=True):
        assert (value.channel, value.unit) == (channel, unit)
        assert value.value == pytest.approx(number, rel=1e-4, nan_ok=True)
