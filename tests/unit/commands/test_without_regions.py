"""Sessions of which nobody has drawn regions yet, such as one just imported."""

from __future__ import annotations

import warnings

import pytest
from click.testing import CliRunner

from fieldkit.commands import main


def fieldkit(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture
def session(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    campaign = tmp_path / "c"
    assert fieldkit("init", campaign, "--site=-33.86,151.2,20").exit_code == 0
    log = tmp_path / "log.csv"
    rows = [f"2024-01-05T10:{minute}:{second}+11:00,80000" for minute in range(10, 20) for second in (10, 40)]
    log.write_text("\n".join(["time,lux [lx]", *rows]) + "\n")
    made = fieldkit("import", log, "-C", campaign)
    assert made.exit_code == 0, made.output
    (path,) = (campaign / "recordings").glob("*.h5")
    return path


@pytest.mark.parametrize("arguments", [("estimate",), ("sweep", "--set", "surface.albedo=0.1,0.2")])
def test_what_needs_beds_says_how_to_draw_them_and_writes_nothing(session, tmp_path, arguments):
    verb, *options = arguments
    found = fieldkit(verb, session, *options, "-j", 1, "-o", tmp_path / "results" / "r")
    assert found.exit_code == 3, found.output
    assert f"{session.name} has no beds to estimate" in found.stderr
    assert "fieldkit roi add" in found.stderr
    assert not (tmp_path / "results").exists()


def test_the_light_can_be_reported_and_replayed_without_beds(session):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        found = fieldkit("report", session)
    assert found.exit_code == 0, found.output
    replayed = fieldkit("replay", session, "--speed", "max")
    assert replayed.exit_code == 0
    assert "no region is a target" in replayed.stderr


def test_a_scale_without_a_known_bed_is_refused_without_a_warning(session):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fieldkit("calibrate", "surface", session)
    assert "has no bed of known slope" in found.stderr


def test_the_report_of_several_without_beds_says_that_nothing_was_found(session):
    other = session.with_name("other.h5")
    other.write_bytes(session.read_bytes())
    found = fieldkit("report", session.parent)
    assert found.exit_code == 0, found.output
    text = (session.parent.parent / "reports" / "campaign.html").read_text("utf-8")
    assert "No slope of a bed of known tilt was found" in text
