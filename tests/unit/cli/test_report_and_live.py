"""``fieldkit report``, also of results, and ``fieldkit live`` on a simulated campaign with one recording."""

import io
import json
import re
import sys
import webbrowser
import zlib

import cv2
import numpy as np
import pytest
from rich.console import Console

from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.next_step import Argument
from fieldkit.pixel_axes import BELOW_PX, LEFT_PX
from fieldkit.recording.status import latest_of
from fieldkit.results import report, result_files
from fieldkit.results.sources import config_for
from fieldkit.sessions.reader import open_session
from fieldkit.views.screen import THEMES, snapshot
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.next_steps import at
from tests.harness.recording import header, recorded
from tests.harness.replayed_minutes import replayed_minutes

FAST = ("--set", "simulation.speed=max")


@pytest.fixture(scope="module")
def session(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def campaign(session):
    return session.parent.parent


def test_status_shows_what_the_live_view_shows_slopes_temperatures_and_named_probes(campaign, session):
    with open_session(session) as opened:
        config = config_for(opened)
        whole = replayed_minutes(opened, config)
        latest = latest_of(opened)
        last = next(minute for minute in reversed(whole) if minute.time_ns == latest.minute.time_ns)
        assert latest.minute.temperature_k == last.temperature_k
        stored = [(one.time_ns, one.region, one.tilt_deg) for one in opened.estimates()[-3:]]
        assert [(one.time_ns, one.region, one.tilt_deg) for one in latest.minute.estimates] == stored
    paper = Console(file=io.StringIO(), width=80)
    with paper.use_theme(THEMES["dark"]):
        paper.print(snapshot(latest, 80))
    lines = paper.file.getvalue().splitlines()
    b15 = next(line for line in lines if line.startswith("b15"))
    assert f"{last.temperature_k['b15'] - 273.15:.2f}" in b15
    assert re.search(r"contact +T1 \S+  T2 \S+  T3 \S+  air \S+ °C", "\n".join(lines))


def without_minutes(path):
    """A session of twenty frames: its report has all pages and no slopes."""
    recorded(path, header((24, 32)), 20)
    return path


def test_report_opens_in_the_browser_that_the_environment_names(tmp_path, monkeypatch):
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {tmp_path / "shown"}\n')
    browser.chmod(0o755)
    session, page = without_minutes(tmp_path / "a.h5"), tmp_path / "r.html"
    monkeypatch.setenv("BROWSER", str(browser))
    monkeypatch.setattr(webbrowser, "_tryorder", None)  # the variable is read once in a process
    monkeypatch.setattr(webbrowser, "_browsers", {})
    succeed("report", session, "-o", page, "--open")
    assert (tmp_path / "shown").read_text().strip() == page.as_uri()


def test_report_of_no_session_named_is_of_the_newest_and_goes_to_the_campaigns_reports(campaign, session):
    found = succeed("report", "-C", campaign)
    written = campaign / "reports" / f"{session.stem}.html"
    assert found.stdout.strip() == str(written)
    text = written.read_text(encoding="utf-8")
    assert re.search(r"b05 \d+\.\d° \(\d+\.\d–\d+\.\d\), wide", text)
    assert "Simulated." in text
    assert re.search(r"<td[^>]*>paper<.*<strong>learned<.strong>", text, re.DOTALL)


def test_one_image_for_a_slide_has_frames_map_and_slopes(session, tmp_path):
    succeed("report", session, "-o", tmp_path / "day.png", "--palette", "white-hot")
    image = cv2.imread(str(tmp_path / "day.png"))
    assert image.shape == (1080, 1920, 3)
    colours = [len(np.unique(part.reshape(-1, 3), axis=0)) for part in np.split(image[100:520], 3, axis=1)]
    assert min(colours) > 50  # a frame in each third
    assert np.ptp(image[100:520], axis=2).max() == 0  # white hot is grey
    assert len(np.unique(image[580:, :900].reshape(-1, 3), axis=0)) > 50  # the map
    assert np.ptp(image[580:, :900], axis=2).max() > 50  # whose hue is azimuth
    assert (image[580:, 960:].min(axis=2) < 100).mean() > 0.005  # letters


def test_a_report_has_one_of_three_kinds_and_an_image_one_session(session, tmp_path):
    with pytest.raises(ConfigError, match="one session"):
        invoke("report", session, session, "-o", tmp_path / "two.png")
    with pytest.raises(ConfigError, check=at(tmp_path / "day.docx")):
        invoke("report", session, "-o", tmp_path / "day.docx")
    with pytest.raises(ConfigError, check=at(Argument("palette"))):
        invoke("report", session, "-o", tmp_path / "day.html", "--palette", "white-hot")


def test_report_of_a_session_elsewhere_lies_beside_it_and_the_folder_one_is_in_may_be_reported(
    tmp_path, monkeypatch
):
    moved = without_minutes(tmp_path / "a.h5")
    found = json.loads(fieldkit("report", "--json", moved).stdout)
    assert found == {"schema": 1, "sessions": [str(moved)], "report": str(moved.with_suffix(".html"))}
    assert moved.with_suffix(".html").exists()
    monkeypatch.chdir(tmp_path)
    succeed("report", ".")


def test_report_with_other_settings_than_recorded_shows_the_configuration_it_was_made_with(session, tmp_path):
    out = tmp_path / "white.html"
    settings = ("--set", "estimator.model=full", "--set", "surface.albedo=0.35")
    succeed("report", session, "-o", out, *settings)
    text = out.read_text(encoding="utf-8")
    assert "full model" in text
    shown = text.split("Active configuration")[1]
    assert "\nalbedo = 0.35\n" in shown.split("[surface]")[1].split("[")[0]


def test_report_of_several_sessions_leaves_out_what_is_none_and_says_so(session, tmp_path):
    folder = tmp_path / "sand" / "recordings"
    folder.mkdir(parents=True)
    for name in ("a.h5", "b.h5"):
        (folder / name).write_bytes(session.read_bytes())
    (folder / "c.h5").write_text("nothing")
    found = fieldkit("report", folder)
    assert found.exit_code == 3
    assert "1 of 3 sessions" in found.stderr
    text = (tmp_path / "sand" / "reports" / "campaign.html").read_text(encoding="utf-8")
    assert "<h1>sand</h1>" in text
    assert "2 sessions" in text
    assert text.count("<strong>b15</strong>") == 2


def test_report_that_cannot_be_written_is_a_matter_of_storage(session, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="file"):
        invoke("report", session, "-o", tmp_path / "file" / "report.html")


def test_picture_of_the_report_is_from_the_middle_and_without_doubts(session):
    with open_session(session) as opened:
        frame = report.middle_frame(opened)
        assert not frame.quality
        assert abs(frame.time_ns - (opened.start_ns + opened.end_ns) / 2) < 90e9


def test_live_writes_one_picture_with_regions(campaign, tmp_path):
    png = tmp_path / "now.png"
    found = succeed("live", "-C", campaign, "--png", png, *FAST)
    assert found.stdout.strip() == str(png)
    assert cv2.imread(str(png)).shape == (720 + BELOW_PX, LEFT_PX + 960 + 110, 3)


def test_live_shows_minutes_and_records_nothing(campaign, session):
    found = succeed("live", "-C", campaign, "--for", "3m", *FAST)
    assert found.stderr.count("W/m² (eq10 /0.44") >= 2
    assert list((campaign / "recordings").glob("*.h5")) == [session]


def test_live_says_which_instrument_is_missing(campaign, tmp_path):
    toml = (campaign / "fieldkit.toml").read_text(encoding="utf-8")
    gone = toml + '\n[device.second]\ndriver = "lutron"\nport = "/dev/ttyNOSUCH"\n'
    (tmp_path / "fieldkit.toml").write_text(gone, encoding="utf-8")
    found = succeed("live", "-C", tmp_path, "--png", tmp_path / "now.png", *FAST)
    assert ": second" in found.stderr


# --- results of an estimate, and what a report makes of them again


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


@pytest.mark.parametrize("nameless", [".", ".."])
@pytest.mark.parametrize("verb", [("estimate",), ("map",), ("sweep", "--set", "surface.albedo=0.1,0.2")])
def test_a_folder_is_no_name_for_results(session, tmp_path, monkeypatch, verb, nameless):
    monkeypatch.chdir(tmp_path)
    found = fieldkit(*verb, session, "-o", nameless)
    assert found.exit_code == 2, found.output
    assert f"-o {nameless} " in found.stderr
    assert not list(tmp_path.glob("**/*.csv"))


def test_a_report_can_be_a_pdf_with_the_page_beside_it(tmp_path):
    found = succeed("report", without_minutes(tmp_path / "a.h5"), "-o", tmp_path / "day.pdf")
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
