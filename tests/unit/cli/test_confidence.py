"""``estimator.confidence``: one key, honoured by every output."""

import re

import h5py
import pytest
from scipy.stats import norm

from tests.harness.command_line import document, succeed
from tests.harness.seldom import SET_SELDOM

FAST = ("--set", "simulation.speed=max", *SET_SELDOM)
NINETY = re.compile(r"\b90 ?%|nine times")


def fieldkit(*words: object) -> str:
    return succeed(*words).output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sure")
    fieldkit("init", "--simulated", folder)
    settings = folder / "fieldkit.toml"
    text = re.sub(
        r"^#?\[estimator\]$", "[estimator]\nconfidence = 0.95", settings.read_text("utf-8"), flags=re.M
    )
    settings.write_text(text, "utf-8")
    fieldkit("record", "-C", folder, "--for", "10m", "--name", "sure", "-q", *FAST)
    return folder


@pytest.fixture(scope="module")
def session(folder):
    (path,) = (folder / "recordings").glob("*.h5")
    return path


def test_every_text_and_page_names_the_confidence_of_the_session(folder, session, tmp_path):
    report, base = tmp_path / "report.html", tmp_path / "map"
    outputs = {
        "estimate": fieldkit("estimate", session, "-j", 1),
        "show": fieldkit("show", session),
        "map": fieldkit("map", session, "-o", base, "--window", "all"),
        "replay": fieldkit("replay", session),
        "plan": fieldkit("plan", "-C", folder, "--on", "2026-01-01", "--for", "20m"),
        "report": fieldkit("report", session, "-o", report) + report.read_text("utf-8"),
    }
    assert [name for name, text in outputs.items() if NINETY.search(text)] == []
    silent = {name for name, text in outputs.items() if "95 %" not in text}
    assert silent == {"show"}  # its ± has no caption


def test_files_state_the_confidence_of_each_slope(session, tmp_path):
    fieldkit("export", session, "--to", "csv", "-o", tmp_path)
    (slopes,) = tmp_path.glob("*-slopes.csv")
    header, *rows = slopes.read_text("utf-8").splitlines()
    place = header.split(",").index("confidence")
    assert {row.split(",")[place] for row in rows} == {"0.95"}
    fieldkit("map", session, "-o", tmp_path / "map", "--window", "all")
    with h5py.File(tmp_path / "map.nc") as file:
        assert file.attrs["confidence"] == 0.95
        texts = [str(value) for item in (file, *file.values()) for value in item.attrs.values()]
    assert not NINETY.search(" ".join(texts))


def test_intervals_are_as_much_wider_as_those_of_a_normal_distribution(session):
    estimate = ("estimate", session, "-j", 1)
    wide, narrow = document(*estimate), document(*estimate, "--set", "estimator.confidence=0.90")
    gains = [estimates["learnt"]["parameters"][0] for estimates in (wide, narrow)]
    widths = [gain["high"] - gain["low"] for gain in gains]
    assert widths[0] / widths[1] == pytest.approx(norm.ppf(0.975) / norm.ppf(0.95), rel=5e-4)
    for outer, inner in zip(wide["slopes"], narrow["slopes"], strict=True):
        assert (outer["confidence"], inner["confidence"]) == (0.95, 0.90)
        assert outer["tilt_deg"] == inner["tilt_deg"]
        assert outer["tilt_region_deg"][0] <= inner["tilt_region_deg"][0]
        assert outer["tilt_region_deg"][1] >= inner["tilt_region_deg"][1]
