"""``fieldkit report`` as PDF, and of results that `estimate` wrote."""

import json
import re
import sys
import zlib

import pytest

from fieldkit.model.errors import ConfigError
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.next_steps import at


@pytest.fixture(scope="module")
def session(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("pdf"))


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def test_a_report_can_be_a_pdf_with_the_page_beside_it(session, tmp_path):
    found = succeed("report", session, "-o", tmp_path / "day.pdf")
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
