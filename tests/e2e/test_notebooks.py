"""The tutorial's notebooks run as they stand, each in an empty folder, and give what is true of their scene.

True slopes are those of the simulated beds: `fieldkit.config.template.SIMULATED`, or what the notebook gives.
The longer notebooks run in `make test-slow`: their cells are type-checked by `make lint`, what they call
is tried by the tests of each command.
"""

import os
import re
import sys
from pathlib import Path

import nbclient
import nbformat
import pytest

from fieldkit.config.template import SIMULATED

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "tutorial" / "notebooks"
TRUE_TILT_DEG = {one["name"]: one["tilt_deg"] for one in SIMULATED["region"] if "tilt_deg" in one}


@pytest.fixture
def folder(tmp_path):
    """Where the notebook runs."""
    made = tmp_path / "work"
    made.mkdir()
    return made


@pytest.fixture
def printed_by(folder, tmp_path, monkeypatch):
    """What a notebook prints, all cells together."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))

    def run(name: str) -> str:
        notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
        place = {"metadata": {"path": str(folder)}}
        nbclient.NotebookClient(notebook, timeout=500, resources=place).execute()
        outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
        return "\n".join(output.get("text", "") for output in outputs)

    return run


def numbers(pattern: str, printed: str) -> list[float]:
    """The numbers of the first line that matches."""
    found = re.search(pattern, printed)
    assert found is not None, f"{pattern!r} in:\n{printed}"
    return [float(number) for number in found.groups()]


@pytest.mark.slow
def test_whole_experiment(printed_by, folder):
    printed = printed_by("whole-experiment.ipynb")
    for name, true_deg in {**TRUE_TILT_DEG, "b10": 10.0}.items():
        pattern = rf"{name}: paper (\S+), learned (\S+) degrees, 90 % region (\S+) to (\S+)"
        paper, learned, low, high = numbers(pattern, printed)
        assert low <= true_deg <= high
        assert abs(learned - true_deg) < abs(paper - true_deg)  # the scene has diffuse light
    assert printed.count(" lx ") >= 20  # a line for each of twenty minutes
    files = {path.name for path in (folder / "sandslope").rglob("*lesson*") if path.is_file()}
    assert {"20160101T190001Z-lesson.h5", "20160101T190001Z-lesson.html"} <= files
    assert "20160101T190001Z-lesson-slopes.csv" in files
    assert (folder / "sandslope/results/20160101T190001Z-lesson/slope-map-all.nc").is_file()


def test_instruments(printed_by, folder):
    printed = printed_by("instruments.ipynb")
    assert "read 638 lx" in printed  # the digits that the notebook sends
    assert re.search(r"lux +illuminance +600 samples", printed)  # ten minutes, one a second
    assert "/dev/ttyUSB9: " in printed
    assert "fix:" in printed
    assert len(list((folder / "field/recordings").glob("*-trial.h5"))) == 1


@pytest.mark.slow
def test_open_a_session(printed_by):
    printed = printed_by("open-a-session.ipynb")
    (largest,) = numbers(r"estimated again: (\S+) degrees", printed)
    assert largest <= 1e-9


@pytest.mark.slow
def test_estimate_and_sweep(printed_by):
    """The sand's albedo is 0.27, as the notebook sets: between two of the values tried."""
    printed = printed_by("estimate-and-sweep.ipynb")
    (best,) = numbers(r"full model: smallest error at an albedo of (\S+)", printed)
    assert best in {0.25, 0.30}
    known, runs = numbers(r"repeated: (\d+) of (\d+) runs known before", printed)
    assert known == runs == 2 * 4 * 2  # sessions, albedos, models


@pytest.mark.slow
def test_slope_maps(printed_by, folder):
    """The beds that the notebook gives: 5 and 15 degrees, beside a flat reference."""
    printed = printed_by("slope-maps.ipynb")
    for name, true_deg in {"low": 5.0, "steep": 15.0, "flat": 0.0}.items():
        median, low, high = numbers(rf"{name}: median (\S+) degrees, 90 % region (\S+) to (\S+)", printed)
        assert low <= true_deg <= high
        # a tilt has no sign: of level ground the median is the length of what scatters to all sides
        assert median == pytest.approx(true_deg, abs=1.0 if true_deg else 2.0)
    (change,) = numbers(r"with an albedo of 0\.30: (\S+) degrees", printed)
    assert change > 0.0  # less light absorbed, so the same warmth needs a steeper slope
    assert len(list(folder.glob("field/results/*/slope-map-all.png"))) == 1


@pytest.mark.slow
def test_calibrate_emissivity(printed_by, folder):
    """The sand's emissivity is 0.85, as the notebook sets."""
    printed = printed_by("calibrate-emissivity.ipynb")
    value, expanded = numbers(r"emissivity (\S+) ± (\S+) \(k=2\)", printed)
    assert abs(value - 0.85) <= expanded < 0.05
    assert "be separated" in printed
    assert len(list(folder.glob("sandslope/calibration/*-dry-silica-sand.toml"))) == 1


@pytest.mark.slow
def test_calibrate_and_re_estimate(printed_by):
    printed = printed_by("calibrate-and-re-estimate.ipynb")
    before, after = numbers(r"independent beds: (\S+) -> (\S+) degrees", printed)
    assert after < 0.6 * before


@pytest.mark.slow
def test_import_and_export(printed_by, folder):
    """The logger's clock is 83 s slow and its light 3 % too high, as the notebook makes it."""
    printed = printed_by("import-and-export.ipynb")
    (difference_k,) = numbers(r"after the round trip: (\S+) K", printed)
    assert difference_k <= 0.0051  # half a count of 0.01 K
    offset_s, expanded_s = numbers(r"clock offset (\S+) s ± (\S+) s", printed)
    assert abs(offset_s - 83.0) <= expanded_s
    (ratio,) = numbers(r"logger / lux (\S+)", printed)
    assert ratio == pytest.approx(1.03, abs=0.005)
    (direct,) = numbers(r"direct irradiance (\S+) W/m²", printed)
    assert direct == 900.0  # as written into the station's file
    assert {"frames.h5", "both.h5", "station.h5"} <= {path.name for path in folder.glob("*.h5")}


def test_write_a_driver(printed_by):
    assert "LUX 980" in printed_by("write-a-driver.ipynb")


def test_every_notebook_is_tested():
    tested = Path(__file__).read_text(encoding="utf-8")
    assert [path.name for path in NOTEBOOKS.glob("*.ipynb") if f'"{path.name}"' not in tested] == []


RECORDS = """
import fieldkit
fieldkit.init_campaign("field", simulated=True)
fast = ["simulation.speed=max", "lux.every_s=4", "thermometer.every_s=4"]
campaign = fieldkit.open_campaign("field", settings=fast)
session = fieldkit.record(campaign, duration="7m")
"""


def test_a_cell_that_records_shows_how_far_it_is_and_its_slopes(folder):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(RECORDS)])
    place = {"metadata": {"path": str(folder)}}
    nbclient.NotebookClient(notebook, timeout=500, resources=place).execute()
    (shown,) = [one for one in notebook.cells[0].outputs if one.output_type == "display_data"]
    assert re.search(r"7 of 7 min   b05 \d+\.\d [^ ]+° \w+   b15 ", shown.data["text/plain"]), shown
