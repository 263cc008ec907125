"""``estimator.confidence``: one key, honoured by every output."""

import re

import h5py
import pytest
from scipy.stats import norm

from fieldkit.config.template import SIMULATED
from tests.harness.command_line import document, succeed
from tests.harness.simulated import record_simulated

LEARNED = ('estimator.model="learned"', 'estimator.azimuth="free"')
NINETY = re.compile(r"\b90 ?%|nine times")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    tables = {**SIMULATED, "estimator": {"confidence": 0.95}}
    return record_simulated(tmp_path_factory.mktemp("sure"), 10, *LEARNED, tables=tables).path


def test_every_text_and_page_names_the_confidence_of_the_session(session, tmp_path):
    report, base = tmp_path / "report.html", tmp_path / "map"
    outputs = {
        "estimate": succeed("estimate", session, "-j", 1).output,
        "show": succeed("show", session).output,
        "map": succeed("map", session, "-o", base, "--window", "all").output,
        "replay": succeed("replay", session).output,
        "plan": succeed("plan", "-C", session.parents[1], "--on", "2026-01-01", "--for", "20m").output,
        "report": succeed("report", session, "-o", report).output + report.read_text("utf-8"),
    }
    assert [name for name, text in outputs.items() if NINETY.search(text)] == []
    silent = {name for name, text in outputs.items() if "95 %" not in text}
    assert silent == {"show"}  # its ± has no caption


def test_files_state_the_confidence_of_each_slope(session, tmp_path):
    succeed("export", session, "--to", "csv", "-o", tmp_path)
    (slopes,) = tmp_path.glob("*-slopes.csv")
    header, *rows = slopes.read_text("utf-8").splitlines()
    place = header.split(",").index("confidence")
    assert {row.split(",")[place] for row in rows} == {"0.95"}
    succeed("map", session, "-o", tmp_path / "map", "--window", "all")
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
