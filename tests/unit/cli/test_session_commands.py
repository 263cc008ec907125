"""The verbs about sessions, as they are typed: what they print and how they end."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result

from fieldkit.cli import (
    calibrate,
    check,
    estimate,
    export,
    import_session,
    init,
    ls,
    record,
    recover,
    replay,
    report,
    show,
)
from fieldkit.model.errors import ConfigError, IntegrityError, RefusedError, SessionError
from fieldkit.model.marks import Mark
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import Severity
from fieldkit.recording.requests import inbox, send
from fieldkit.results.session import open_session
from fieldkit.results.sources import config_for, source_of
from fieldkit.sessions.writer import SessionWriter
from tests.harness.foreign_files import surfrad
from tests.harness.next_steps import steps
from tests.harness.recording import START_NS, CountedClock, fill, header, sample
from tests.harness.replayed_minutes import replayed_minutes


def run(module: Any, *words: object) -> Result:
    return CliRunner().invoke(module.command, [str(word) for word in words], catch_exceptions=True)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("20261211T025512Z-a.h5", "20261212T025512Z-b.h5"):
        clock = CountedClock()
        writer = SessionWriter(folder / name, header((24, 32)), clock)
        fill(writer, 20, clock)
        writer.close() if "a.h5" in name else writer.abandon()
    return folder


@pytest.fixture
def campaign(recordings, tmp_path):
    """A folder with a sealed and an interrupted session."""
    shutil.copytree(recordings, tmp_path / "recordings")
    return tmp_path


def test_ls_tells_state_length_and_samples(campaign):
    lines = run(ls, campaign).stdout.splitlines()
    assert lines[0].split()[:2] == ["session", "state"]
    assert "20261211T025512Z-a.h5  sealed" in lines[1]
    assert "camera 20  lux 5  thermometer 5" in lines[1]
    assert "20261212T025512Z-b.h5  interrupted" in lines[2]
    sessions = json.loads(run(ls, campaign, "--json").stdout)["sessions"]
    assert [one["state"] for one in sessions] == ["sealed", "interrupted"]
    assert sessions[0]["samples"] == {"camera": 20, "lux": 5, "thermometer": 5}


@pytest.mark.parametrize("zone", ["Mars/Jezero", "Asia", "x" * 300])
def test_ls_of_a_session_whose_time_zone_is_unknown_here_is_in_utc(tmp_path, zone):
    clock, known = CountedClock(), header((24, 32))
    unknown = replace(known, site=replace(known.site, timezone=zone))
    writer = SessionWriter(tmp_path / "a.h5", unknown, clock)
    fill(writer, 1, clock)
    writer.close()
    done = run(ls, tmp_path)
    assert done.exit_code == 0
    assert " UTC " in done.stdout.splitlines()[1]


def test_ls_lists_what_it_cannot_read(campaign):
    (campaign / "recordings" / "photo.h5").write_bytes(b"no session")
    assert "unreadable" in run(ls, campaign).stdout


def test_show_without_a_name_shows_the_newest(campaign):
    done = run(show, "-C", campaign / "recordings")
    assert done.exit_code == 0
    document = json.loads(run(show, campaign / "recordings" / "20261211T025512Z-a.h5", "--json").stdout)
    assert document["schema"] == 1
    assert document["title"] == "three beds – テスト"
    assert [one["samples"] for one in document["streams"]] == [20, 5, 5]
    assert document["regions"][1]["tilt_deg"] == 5.0
    assert document["events"][0]["text"] == "wolke über b05"


def test_check_ends_with_an_integrity_error_where_one_is_interrupted(campaign):
    done = run(check, campaign, "--no-estimates")
    assert isinstance(done.exception, IntegrityError)
    assert "FAIL  state" in done.stdout
    good = run(check, campaign / "recordings" / "20261211T025512Z-a.h5", "--no-estimates", "--json")
    assert good.exit_code == 0
    (session,) = json.loads(good.stdout)["sessions"]
    assert session["level"] in ("ok", "warn")
    assert any("every checksum matches" in one["text"] for one in session["findings"])


def test_check_applies_nothing_where_nothing_is_to_be_corrected(campaign):
    path = campaign / "recordings" / "20261211T025512Z-a.h5"
    assert isinstance(run(check, path, "--apply", "--no-estimates").exception, RefusedError)


def test_check_goes_on_where_one_of_several_needs_no_correction(campaign):
    run(recover, campaign / "recordings" / "20261212T025512Z-b.h5")
    done = run(check, campaign, "--apply", "--no-estimates")
    assert done.exit_code == 0
    for name in ("a.h5", "b.h5"):
        assert f"{name}: its clock comparisons call for no correction" in done.stderr
        assert f"{name}\n" in done.stdout


def test_names_that_ls_prints_are_found_from_the_campaigns_folder(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    for name in ("20261211T025512Z-a.h5", "20261212T025512Z-b.h5"):
        assert name in run(show, "-C", campaign, name).stdout
    subcommands = ((calibrate, "surface"), (calibrate, "uniformity"))
    for words in ((show,), (recover,), (replay,), *subcommands):
        gone = run(*words, "-C", campaign, "c.h5").exception
        assert gone.message == "there is no session c.h5"


def test_an_interrupted_session_is_recovered_by_its_bare_name(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    assert "recovered" in run(recover, "-C", campaign, "20261212T025512Z-b.h5").stdout


def test_recover_finishes_all_of_a_campaign_and_then_nothing(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    done = run(recover, "-C", campaign)
    assert done.exit_code == 0
    assert "20261212T025512Z-b.h5" in done.stdout
    assert "camera: 20 samples" in done.stdout
    again = json.loads(run(recover, campaign / "recordings" / "20261212T025512Z-b.h5", "--json").stdout)
    assert again["sessions"][0]["was_complete"]
    tidied = run(recover, "-C", campaign, "--tidy")
    assert "deleted" in tidied.stderr
    assert "b.h5.crashed" in tidied.stderr
    assert "nothing to tidy" in run(recover, "-C", campaign, "--tidy").stderr
    names = sorted(path.name for path in (campaign / "recordings").iterdir())
    assert names == ["20261211T025512Z-a.h5", "20261212T025512Z-b.h5"]


def test_a_session_that_cannot_be_recovered_does_not_keep_the_others_from_it(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    broken = campaign / "recordings" / "20261210T025512Z-0.h5"
    broken.touch()
    broken.with_name(broken.name + ".journal").mkdir()
    done = run(recover, "-C", campaign)
    assert done.exit_code != 0
    assert str(broken) in done.stderr
    assert "camera: 20 samples" in done.stdout
    assert "recovered" in run(ls, "-C", campaign).stdout


def test_lost_samples_are_named_on_the_screen_and_in_json(campaign):
    path = campaign / "recordings" / "20261211T025512Z-a.h5"
    whole = path.read_bytes()
    with h5py.File(path) as file:
        last = file["camera/counts"].id.get_chunk_info_by_coord((18, 0, 0)).byte_offset
    path.write_bytes(whole[: last + 10])
    told = run(recover, path)
    assert isinstance(told.exception, IntegrityError)
    assert "LOST camera: 2 samples, numbers 18 to 19, after 2016-11-24T15:06:45" in told.stdout
    path.write_bytes(whole[: last + 10])
    (session,) = json.loads(run(recover, path, "--json").stdout)["sessions"]
    (lost,) = [one for one in session["lost"] if one["stream"] == "camera"]
    assert (lost["first"], lost["last"], lost["samples"], lost["before"]) == (18, 19, 2, None)


@pytest.mark.parametrize("module", [check, estimate, replay, report, show])
def test_every_verb_offers_to_recover_an_interrupted_session(campaign, module):
    path = campaign / "recordings" / "20261212T025512Z-b.h5"
    assert f"fieldkit recover {path}" in run(module, path).stderr
    assert "fieldkit recover" not in run(module, campaign / "recordings" / "20261211T025512Z-a.h5").stderr


def test_calibration_says_which_samples_it_is_made_without(tmp_path):
    about = header((24, 32))
    writer = SessionWriter(tmp_path / "board.h5", about, CountedClock())
    for number in range(40):
        now = number * 1_000_000_000
        writer.append(sample(about.streams[0], number, now, START_NS + now))
    writer.close()
    whole = run(calibrate, "uniformity", tmp_path / "board.h5")
    with h5py.File(tmp_path / "board.h5", "r+") as file:
        file["camera/fpa_temperature"][20] += 1.0
    done = run(calibrate, "uniformity", tmp_path / "board.h5", "--name", "again")
    assert done.exit_code == 0
    said = "1 of 40 samples of camera do not match their checksum and are excluded"
    assert "do not match" not in whole.stderr
    assert said in done.stderr


@pytest.mark.parametrize("kind", ["csv", "netcdf", "mcap", "tiff"])
def test_export_of_a_damaged_session_writes_the_rest_and_says_so(campaign, kind):
    path = campaign / "recordings/20261211T025512Z-a.h5"
    with h5py.File(path, "r+") as file:
        file["camera/fpa_temperature"][4] += 1.0
    done = run(export, path, "--to", kind, "-o", campaign / "out")
    assert isinstance(done.exception, IntegrityError)
    assert "1 of 20 samples of camera do not match their checksum" in done.exception.message
    assert done.exception.fix == Action.CHECK(path)
    files = [Path(line) for line in done.stdout.splitlines() if not line.startswith("and")]
    assert files
    assert all(file.exists() for file in files)
    assert not isinstance(run(export, path, "--to", "mcap", "--stream", "lux").exception, IntegrityError)


def test_exports_lie_in_the_results_of_their_campaign_or_beside_a_session_elsewhere(campaign, tmp_path):
    path = campaign / "recordings/20261211T025512Z-a.h5"
    assert run(export, path, "--to", "csv").exit_code == 0
    assert list((campaign / "results" / path.stem).glob("*.csv"))
    alone = tmp_path / "stick" / "a.h5"
    alone.parent.mkdir()
    alone.write_bytes(path.read_bytes())
    assert run(export, alone, "--to", "csv").exit_code == 0
    assert list((tmp_path / "stick" / "a-export").glob("*.csv"))


@pytest.mark.parametrize("kind", ["csv", "parquet", "netcdf"])
def test_export_of_every_stream_refuses_to_pass_over_the_one_named(campaign, kind):
    path = campaign / "recordings" / "20261211T025512Z-a.h5"
    done = run(export, path, "--to", kind, "--stream", "nope")
    assert isinstance(done.exception, ConfigError)
    assert done.exception.place == Argument("stream", "nope")
    assert not (campaign / "results").exists()


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("csv", ("--from", "12:00")),
        ("mcap", ("--until", "-5s")),
        ("png", ("--speed", "60")),
        ("csv", ("--every", "2")),
    ],
)
def test_an_export_refuses_an_option_that_it_does_not_use(campaign, kind, words):
    done = run(export, campaign / "recordings" / "20261211T025512Z-a.h5", "--to", kind, *words)
    assert isinstance(done.exception, ConfigError)
    assert words[0] in {"--from", f"--{done.exception.place.name}"}
    assert "video" in str(done.exception.fix)


def test_frames_of_a_span_are_exported(campaign, tmp_path):
    path = campaign / "recordings" / "20261211T025512Z-a.h5"
    with open_session(path) as session:
        times = [datetime.fromtimestamp(one.time_ns / 1e9, UTC) for one in session.samples("camera")]
    after = times[9] + timedelta(milliseconds=1)
    spans = {
        "late": ("--from", after.isoformat()),
        "early": ("--until", after.isoformat()),
        # clock times of the session's day, as near to it as they can be
        "whole": ("--from", clock_time(times[0], -1), "--until", clock_time(times[0], 1)),
    }
    for name, span in spans.items():
        assert run(export, path, "--to", "png", "-o", tmp_path / name, *span).exit_code == 0
    written = {name: len(list((tmp_path / name).glob("*.png"))) for name in spans}
    assert written == {"late": 10, "early": 10, "whole": 20}
    turned = run(export, path, "--to", "png", "--from", "-1s", "--until", "-5s")
    assert "the end lies before the start" in str(turned.exception)


def clock_time(moment: datetime, hours: float) -> str:
    """What clocks in Greenwich show so many hours later."""
    return f"{moment + timedelta(hours=hours):%H:%M}+00:00"


@pytest.mark.parametrize(
    ("option", "hours"), [("--from", 1), ("--from", 11), ("--until", -1), ("--until", -11)]
)
def test_a_span_outside_the_session_is_refused(campaign, tmp_path, option, hours):
    path = campaign / "recordings" / "20261211T025512Z-a.h5"
    with open_session(path) as session:
        first = datetime.fromtimestamp(session.start_ns / 1e9, UTC)
    done = run(export, path, "--to", "png", "-o", tmp_path / "none", option, clock_time(first, hours))
    assert "no sample lies then: the session lasts from" in str(done.exception)
    assert not (tmp_path / "none").exists()


def test_session_of_which_only_the_journal_is_left_is_offered_too(campaign):
    path = campaign / "recordings" / "20261212T025512Z-b.h5"
    path.unlink()
    done = run(show, path)
    assert f"fieldkit recover {path}" in done.stderr
    assert done.exception.fix == Action.RECOVER(path)
    assert run(recover, path).exit_code == 0


def test_mark_that_the_recorder_had_no_time_to_take_is_recovered_with_kind_and_end(campaign):
    path = campaign / "recordings" / "20261212T025512Z-b.h5"
    inbox(path).mkdir()
    send(inbox(path), Mark("lightning", "storm", "2026-12-12T03:00:00Z", "2026-12-12T03:10:00Z"))
    send(inbox(path), Mark("moved"))
    run(recover, path)
    events = {event["text"]: event for event in json.loads(run(show, path, "--json").stdout)["events"]}
    assert events["lightning"]["label"] == "storm"
    assert events["lightning"]["end"] == "2026-12-12 12:10:00 JST"
    assert (events["moved"]["label"], events["moved"]["end"]) == ("", "")


def test_session_that_does_not_exist_is_named():
    for module in (check, show, recover, replay):
        done = run(module, "nowhere.h5")
        assert isinstance(done.exception, SessionError)
        assert "nowhere.h5" in str(done.exception)
        assert Action.LIST_SESSIONS() in steps(done.exception)


def test_recovering_what_is_no_session_says_what_to_do_and_leaves_nothing(tmp_path):
    path = tmp_path / "junk.h5"
    path.write_bytes(b"no session")
    done = run(recover, path)
    assert isinstance(done.exception, SessionError)
    assert "nothing can be read" in str(done.exception)
    assert ".journal" in str(done.exception.fix)
    assert list(tmp_path.iterdir()) == [path]


def test_import_makes_a_session_and_asks_for_what_it_cannot_know(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for second in range(3):
        cv2.imwrite(str(folder / f"20260512T01000{second}.tif"), np.full((5, 7), 29_500, np.uint16))
    out = tmp_path / "a.h5"
    place = ("--site=35.5,139.4,9", "-C", tmp_path)
    without_scale = run(import_session, folder, *place)
    assert isinstance(without_scale.exception, ConfigError)
    assert steps(without_scale.exception) == [Argument("kelvin_per_count", 0.01)]
    said = ("--time-format", "%Y%m%dT%H%M%S", "--zone", "UTC", "--kelvin-per-count", "0.01")
    without_site = run(import_session, folder, *said, "-C", tmp_path)
    assert isinstance(without_site.exception, ConfigError)
    assert steps(without_site.exception) == [Argument("site")]
    done = run(import_session, folder, *place, *said, "-o", out, "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["samples"] == {"camera": 3}
    assert "29500 K" not in run(show, out).stdout
    assert run(check, out, "--no-estimates").exit_code == 0


def test_import_without_a_site_warns_that_the_campaigns_is_taken(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for second in range(3):
        cv2.imwrite(str(folder / f"20260512T01000{second}.tif"), np.full((5, 7), 29_500, np.uint16))
    said = ("--time-format", "%Y%m%dT%H%M%S", "--zone", "UTC", "--kelvin-per-count", "0.01")
    assert run(init, tmp_path / "fresh", "--quiet").exit_code == 0
    done = run(import_session, folder, *said, "-C", tmp_path / "fresh", "-o", tmp_path / "a.h5")
    assert "warning: no site" in done.stderr
    assert "the paper's" in done.stderr
    with open_session(tmp_path / "a.h5") as session:
        warned = [event for event in session.events() if event.severity is Severity.WARNING]
        assert "site" in warned[0].text
        assert session.site.latitude_deg == 35.558675
    assert run(check, tmp_path / "a.h5").exit_code == 0
    assert isinstance(run(check, tmp_path / "a.h5", "--strict").exception, IntegrityError)
    run(init, tmp_path / "own", "--site", "47.1,8.5,400", "--quiet")
    own = run(import_session, folder, *said, "-C", tmp_path / "own", "-o", tmp_path / "b.h5")
    assert "47.1, 8.5; if it was elsewhere" in own.stderr
    given = run(import_session, folder, *said, "--site=1,2", "-C", tmp_path / "own", "-o", tmp_path / "c.h5")
    assert "no site" not in given.stderr


@pytest.mark.parametrize("present", [False, True])
def test_an_imported_session_is_estimated_under_the_sun_of_its_own_site(tmp_path, present):
    """In Tokyo it is night when it is noon at Alamosa; SPA (pvlib) gives 29.3 degrees there at 19:05 UTC."""
    campaign = tmp_path / "tokyo"
    assert run(init, campaign, "--quiet").exit_code == 0
    log = tmp_path / "light.csv"
    log.write_text("time,lux [lx]\n" + "".join(f"2016-01-01T19:{m:02}:00Z,50000\n" for m in range(3, 7)))
    out = campaign / "recordings" / "noon.h5"
    place = ("--site", "37.70,-105.92,2317", "-C", campaign)
    assert run(import_session, log, *place, "-o", out).exit_code == 0
    source = source_of(out, present=present)
    assert source.config.site.latitude_deg == 37.70
    with open_session(out) as session:
        assert source.config.site == session.site
        minutes = replayed_minutes(session, source.config, present=present)
        moved = config_for(session, ("site.latitude_deg=47.0",), present=present)
    assert [90.0 - minute.sun_zenith_deg for minute in minutes] == pytest.approx([29.3] * 4, abs=0.2)
    assert moved.site.latitude_deg == 47.0
    assert moved.site.longitude_deg == -105.92


def test_auto_offset_needs_a_session_and_an_offset_its_unit(tmp_path):
    table = tmp_path / "log.csv"
    table.write_text("time,T1 [C]\n2026-05-12T01:00:00Z,3\n")
    done = run(import_session, table, "--clock-offset", "auto", "--site=1,2")
    assert isinstance(done.exception, ConfigError)
    assert done.exception.fix == Action.IMPORT_INTO()
    for name in ("events", "a/b", "", "x y"):
        assert "cannot name a stream" in run(import_session, table, "--as", name, "--site=1,2").stderr
    wrong = run(import_session, table, "--clock-offset", "soon", "--site=1,2")
    assert "use +12s or -2m, or auto" in wrong.stderr


def test_a_stream_added_to_a_session_refuses_the_sessions_own_options(tmp_path):
    table = tmp_path / "log.csv"
    table.write_text("time,T1 [C]\n2026-05-12T01:00:00Z,3\n")
    assert run(import_session, table, "--site=1,2", "-o", tmp_path / "a.h5").exit_code == 0
    done = run(import_session, table, "--into", tmp_path / "a.h5", "--site=1,2", "--title", "x", "--as", "b")
    assert isinstance(done.exception, ConfigError)
    assert steps(done.exception) == [Argument("title"), Argument("site")]


def test_a_place_against_the_one_in_the_file_is_refused_with_both(tmp_path):
    (tmp_path / "slv16001.dat").write_bytes(surfrad())  # 37.70 N 105.92 W
    done = run(import_session, tmp_path / "slv16001.dat", "--site=35.5,139.4,9", "-o", tmp_path / "a.h5")
    assert isinstance(done.exception, ConfigError)
    assert steps(done.exception) == [Argument("site")]


@pytest.mark.parametrize("name", ["beds/1", "../../oops", "a\\b"])
def test_a_name_cannot_put_a_session_where_no_verb_looks(tmp_path, name):
    assert run(init, "--simulated", tmp_path / "c").exit_code == 0
    done = run(record, "-C", tmp_path / "c", "--for", "10s", "--name", name)
    assert isinstance(done.exception, ConfigError)
    assert "has a slash" in str(done.exception)
    assert not list(tmp_path.rglob("*.h5"))
