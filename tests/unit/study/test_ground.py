"""The surface model on ground whose truth is known, and on recorded ground.

The synthetic ground is an explicit scheme on an even grid of 2 mm, ten seconds a step, as fieldkit uses
nowhere. Recorded ground: a scratch fit of the same kind, with a fitted starting temperature and without a
response time, left 1.56 K (cinder) and 1.33 K (clay) on the second half; exchange about 3 + 1.8 U and
4 + 1.7 U W m-2 K-1.
"""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

from fieldkit.cli.study import command
from fieldkit.model.errors import ConfigError
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.study.ground import EMISSIVITY, fit, ground_fits, read_measured_ground, steps
from tests.shared_data import shared

TRUTH = {
    "exchange_still": 4.0,
    "exchange_per_wind": 1.8,
    "thermal_inertia": 400.0,
    "albedo_error": 0.03,
    "response_time": 3.0,
}
COLUMNS = (
    "minute",
    "ground_radiometer_c",
    "air_c",
    "wind_m_s",
    "shortwave_down_w_m2",
    "shortwave_up_w_m2",
    "longwave_down_w_m2",
    "sun_zenith_apparent_deg",
)


def weather(minutes, random):
    """Two cloudy days from noon: columns by name."""
    zenith = 90.0 - 55.0 * np.cos(2.0 * np.pi * minutes / 1440.0)
    cloud = np.repeat(random.uniform(0.3, 1.0, minutes.size // 12 + 1), 12)[: minutes.size]
    light = 1000.0 * np.maximum(np.cos(np.radians(zenith)), 0.0) * cloud
    gusts = np.repeat(random.gamma(2.0, 1.2, minutes.size // 5 + 1), 5)[: minutes.size]
    return {
        "minute": minutes,
        "air_c": 15.0 + 6.0 * np.cos(2.0 * np.pi * (minutes - 120.0) / 1440.0),
        "wind_m_s": gusts,
        "shortwave_down_w_m2": light,
        "shortwave_up_w_m2": 0.15 * light,
        "longwave_down_w_m2": np.full(minutes.size, 310.0) + 30.0 * (1.0 - cloud),
        "sun_zenith_apparent_deg": zenith,
    }


def simulated_c(columns, capacity=1.2e6, cell_m=2e-3, step_s=10.0):
    """What the radiometer shows, °C: the first day three times, then the record."""
    conductivity = TRUTH["thermal_inertia"] ** 2 / capacity
    exchange = TRUTH["exchange_still"] + TRUTH["exchange_per_wind"] * columns["wind_m_s"]
    absorbed = (
        columns["shortwave_down_w_m2"] * (1.0 - TRUTH["albedo_error"])
        - columns["shortwave_up_w_m2"]
        + EMISSIVITY * columns["longwave_down_w_m2"]
    )
    rows = np.concatenate([np.tile(np.arange(1440), 3), np.arange(absorbed.size)])
    layers, shown, seen = np.full(250, 291.0), 291.0, []
    for row in rows:
        for _ in range(round(60.0 / step_s)):
            between = conductivity * np.diff(layers) / cell_m
            top = layers[0]
            into = absorbed[row] - EMISSIVITY * STEFAN_BOLTZMANN * top**4
            into += exchange[row] * (columns["air_c"][row] + 273.15 - top)
            flux = np.concatenate([[-into], between, [0.0]])
            gained = np.diff(flux) * step_s / (capacity * cell_m)
            gained[0] *= 2.0  # the node on the surface stands for half a cell
            layers = layers + gained
            shown += (layers[0] - shown) * step_s / (60.0 * TRUTH["response_time"])
        seen.append(shown)
    return np.array(seen[-absorbed.size :]) - 273.15


def write_record(path, columns):
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows(zip(*(columns[name].tolist() for name in COLUMNS), strict=True))
    return path


@pytest.fixture(scope="module")
def columns():
    random = np.random.default_rng(7)
    found = weather(np.arange(2160.0), random)
    error = np.zeros(2160)
    for row in range(1, error.size):  # a model error of 0.3 K that lasts for half an hour
        error[row] = error[row - 1] * np.exp(-1 / 30) + 0.3 * np.sqrt(1 - np.exp(-2 / 30)) * random.normal()
    return found | {"ground_radiometer_c": simulated_c(found) + error}


@pytest.fixture(scope="module")
def record(columns, tmp_path_factory):
    return write_record(tmp_path_factory.mktemp("ground") / "synthetic.csv", columns)


@pytest.fixture(scope="module")
def found(record):
    ground = read_measured_ground(record)
    return fit(ground, np.arange(2160) < 1080, "first half")


def test_the_truth_lies_in_the_intervals(found):
    for one in found.parameters:
        assert one.low <= TRUTH[one.name] <= one.high, one.name
        assert one.share_of_prior < 0.8


def test_intervals_hold_the_held_out_minutes(found):
    held_out = {score.span: score for score in found.scores if score.minutes == "held out"}
    assert held_out["all"].rmse_k < 0.5
    assert 0.80 <= held_out["all"].coverage <= 1.0
    assert sum(score.count for score in found.scores if score.span == "all") == 2160


def test_held_out_temperatures_do_not_matter(record, found):
    ground = read_measured_ground(record)
    ground.surface_k[1080:] = np.nan
    again = fit(ground, np.arange(2160) < 1080)
    np.testing.assert_array_equal(again.values, found.values)
    np.testing.assert_array_equal(again.half_width_k, found.half_width_k)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"minute": np.where(np.arange(2160) > 99, np.arange(2160) + 1.0, np.arange(2160.0))}, "gap after"),
        ({"wind_m_s": np.full(2160, np.nan)}, "no wind_m_s in minute 0"),
        ({name: np.arange(60.0) for name in COLUMNS}, "has 60 minutes"),
    ],
)
def test_records_that_cannot_be_run_are_refused(columns, tmp_path, change, words):
    with pytest.raises(ConfigError, match=words):
        read_measured_ground(write_record(tmp_path / "bad.csv", columns | change))


def test_another_file_is_refused(tmp_path):
    (tmp_path / "notes.csv").write_text("hello\nworld\n")
    with pytest.raises(ConfigError, match="has no column 'minute'"):
        read_measured_ground(tmp_path / "notes.csv")


def test_the_command_prints_and_writes_both_halves(record, tmp_path):
    words = ["--measured-ground", str(record), "--out", str(tmp_path), "--json"]
    printed = CliRunner().invoke(command, words, catch_exceptions=False)
    first, second = json.loads(printed.stdout)["ground"]
    assert (first["fitted"], second["fitted"]) == ("first half", "second half")
    assert {path.suffix for path in tmp_path.iterdir()} == {".json", ".html", ".svg", ".csv"}
    with (tmp_path / "ground-synthetic-first-half.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 2160
    assert "held out" in (tmp_path / "ground.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most_k"), [("cinder-2022", 1.5), ("clay-2024", 1.3)])
def test_recorded_ground(name, most_k):
    done = []
    fits = ground_fits(shared(f"data/ground/{name}.csv"), done.append)
    assert len(done) == steps(1)
    for one in fits:
        held_out = next(s for s in one.scores if (s.minutes, s.span) == ("held out", "all"))
        assert held_out.rmse_k <= most_k
        assert held_out.coverage >= 0.85
    still, wind, inertia = fits[0].parameters[:3]
    assert still.low <= 4.0
    assert still.high >= 3.0
    assert wind.low <= 1.8
    assert wind.high >= 1.7
    assert 200.0 < inertia.value < 700.0
