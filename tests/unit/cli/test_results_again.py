"""Results of ``fieldkit estimate -o``, what ``fieldkit report`` makes of them again, and reports as PDF."""

import json
import re
import sys
import zlib

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.results import result_files
from tests.harness import recording
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.next_steps import at


@pytest.fixture(scope="module")
def session(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("again"))


@pytest.fixture(scope="module")
def without_slopes(tmp_path_factory):
    """A session of twenty frames: its report has all pages and no slopes."""
    path = tmp_path_factory.mktemp("short") / "a.h5"
    recording.recorded(path, recording.header((24, 32)), 20)
    return path


def test_results_of_the_campaigns_configuration_are_reported_with_it(session, tmp_path):
    base, settings = tmp_path / "r", ("surface.albedo=0.35",)
    succeed("estimate", session, "-j", 1, "-o", base)
    assert result_files.recall((base,), settings) == ((session,), settings, False)
    succeed("estimate", session, "-j", 1, "-o", base, "--campaign")
    assert result_files.recall((base,), settings) == ((session,), settings, True)
    campaign = session.parent.parent / "fieldkit.toml"
    before = campaign.read_text("utf-8")
    campaign.write_text("nonsense")
    try:
        found = fieldkit("report", base, "-o", tmp_path / "report.html")
    finally:
        campaign.write_text(before)
    assert found.exit_code == 3
    assert "fieldkit.toml" in found.stderr


def test_results_may_be_named_by_any_of_their_files(session, tmp_path):
    succeed("estimate", session, "-j", 1, "-o", tmp_path / "r")
    for ending in result_files.ENDINGS:
        assert result_files.recall((tmp_path / f"r{ending}",), ())[0] == (session,)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "cannot be read"),
        ("[1]", "not what an estimate wrote"),
        ('{"weather": "fine"}', "not what an estimate wrote"),
        (json.dumps({"sessions": [], "parameters": {}}), "many sets of parameters"),
    ],
)
def test_what_is_no_result_is_called_so(tmp_path, text, said):
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(ConfigError, match=said):
        result_files.recall((tmp_path / "bad",), ())


def test_the_folder_one_is_in_may_be_reported(without_slopes, monkeypatch):
    monkeypatch.chdir(without_slopes.parent)
    succeed("report", ".")


@pytest.mark.parametrize("nameless", [".", ".."])
@pytest.mark.parametrize("verb", [("estimate",), ("map",), ("sweep", "--set", "surface.albedo=0.1,0.2")])
def test_a_folder_is_no_name_for_results(session, tmp_path, monkeypatch, verb, nameless):
    monkeypatch.chdir(tmp_path)
    found = fieldkit(*verb, session, "-o", nameless)
    assert found.exit_code == 2, found.output
    assert f"-o {nameless} " in found.stderr
    assert not list(tmp_path.glob("**/*.csv"))


def test_a_report_can_be_a_pdf_with_the_page_beside_it(without_slopes, tmp_path):
    found = succeed("report", without_slopes, "-o", tmp_path / "day.pdf")
    assert found.stdout.strip() == str(tmp_path / "day.pdf")
    printed = (tmp_path / "day.pdf").read_bytes()
    assert printed.startswith(b"%PDF-")
    assert printed.rstrip().endswith(b"%%EOF")
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", printed, re.DOTALL)
    objects = b"".join(zlib.decompressobj().decompress(stream) for stream in streams if stream[:1] == b"x")
    assert len(re.findall(rb"/MediaBox\s*\[\s*0 0 595\.\d+ 841\.\d+\s*\]", objects)) >= 2  # A4, in points
    assert (tmp_path / "day.html").exists()


def test_without_the_printer_it_is_refused_before_the_work(session, tmp_path, monkeypatch):
    # as without the extra, which takes an environment of its own
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    found = fieldkit("report", session, "-o", tmp_path / "day.pdf")
    assert found.exit_code == 3
    assert "fieldkit-slope[pdf]" in found.stderr
    assert not (tmp_path / "day.html").exists()


def test_results_stand_for_their_sessions_and_parameters(session, tmp_path):
    settings = ("--set", "surface.albedo=0.31", "--set", "estimator.model=paper")
    succeed("estimate", session, *settings, "-o", tmp_path / "base")
    found = fieldkit("report", tmp_path / "base", "-o", tmp_path / "base.html", "--json")
    assert json.loads(found.stdout)["sessions"] == [str(session)]
    by_hand = tmp_path / "by-hand.html"
    succeed("report", session, *settings, "-o", by_hand)
    assert (tmp_path / "base.html").read_text("utf-8") == by_hand.read_text("utf-8")
    assert "\nalbedo = 0.31\n" in by_hand.read_text("utf-8")


def test_a_sweep_has_no_one_report(session, tmp_path):
    grid = ("--set", "surface.albedo=0.2,0.3")
    succeed("sweep", session, *grid, "-j", 1, "-o", tmp_path / "many")
    with pytest.raises(ConfigError, check=at(tmp_path / "many.json")):
        invoke("report", tmp_path / "many")
