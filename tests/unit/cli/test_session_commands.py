"""The verbs about sessions, as they are typed: what they print and how they end."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from fieldkit.model.errors import ConfigError, IntegrityError, RefusedError, SessionError
from fieldkit.model.marks import Mark
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import Severity
from fieldkit.recording.requests import inbox, send
from fieldkit.results.session import open_session
from fieldkit.results.sources import config_for, source_of
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.foreign_files import surfrad
from tests.harness.next_steps import at, steps
from tests.harness.recording import header, interrupted, recorded, sample, session_of
from tests.harness.replayed_minutes import replayed_minutes


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    recorded(folder / "20261211T025512Z-a.h5", header((24, 32)), 20)
    interrupted(folder / "20261212T025512Z-b.h5", header((24, 32)), 20)
    return folder


@pytest.fixture
def campaign(recordings, tmp_path):
    """A folder with a sealed and an interrupted session."""
    shutil.copytree(recordings, tmp_path / "recordings")
    return tmp_path


@pytest.fixture
def sealed(campaign):
    return campaign / "recordings" / "20261211T025512Z-a.h5"


@pytest.fixture
def crashed(campaign):
    """The session that was interrupted."""
    return campaign / "recordings" / "20261212T025512Z-b.h5"


def test_ls_tells_state_length_and_samples(campaign):
    lines = fieldkit("ls", campaign).stdout.splitlines()
    assert lines[0].split()[:2] == ["session", "state"]
    assert "20261211T025512Z-a.h5  sealed" in lines[1]
    assert lines[1].split()[-7:-1] == ["camera", "20", "lux", "5", "thermometer", "5"]
    assert "20261212T025512Z-b.h5  interrupted" in lines[2]
    sessions = document("ls", campaign)["sessions"]
    assert [session["state"] for session in sessions] == ["sealed", "interrupted"]
    assert sessions[0]["samples"] == {"camera": 20, "lux": 5, "thermometer": 5}


@pytest.mark.parametrize("zone", ["Mars/Jezero", "Asia", "x" * 300])
def test_ls_of_a_session_whose_time_zone_is_unknown_here_is_in_utc(tmp_path, zone):
    known = header((24, 32))
    recorded(tmp_path / "a.h5", replace(known, site=replace(known.site, timezone=zone)), 1)
    assert " UTC " in succeed("ls", tmp_path).stdout.splitlines()[1]


def test_show_without_a_name_shows_the_newest(campaign):
    assert "three beds" in succeed("show", "-C", campaign / "recordings").stdout
    shown = document("show", campaign / "recordings" / "20261211T025512Z-a.h5")
    assert (shown["schema"], shown["title"]) == (1, "three beds – テスト")
    assert [stream["samples"] for stream in shown["streams"]] == [20, 5, 5]
    assert shown["regions"][1]["tilt_deg"] == 5.0
    assert shown["events"][0]["text"] == "wolke über b05"


def test_check_ends_with_an_integrity_error_where_one_is_interrupted(campaign, sealed):
    done = fieldkit("check", campaign, "--no-estimates")
    assert done.exit_code == IntegrityError.exit_code
    assert "FAIL  state" in done.stdout
    (session,) = document("check", sealed, "--no-estimates")["sessions"]
    assert session["level"] in ("ok", "warn")
    assert any("20 samples" in finding["text"] for finding in session["findings"])


def test_check_applies_nothing_where_nothing_is_to_be_corrected(campaign):
    with pytest.raises(RefusedError):
        invoke("check", campaign / "recordings" / "20261211T025512Z-a.h5", "--apply", "--no-estimates")


def test_check_goes_on_where_one_of_several_needs_no_correction(campaign):
    fieldkit("recover", campaign / "recordings" / "20261212T025512Z-b.h5")
    done = succeed("check", campaign, "--apply", "--no-estimates")
    for name in ("a.h5", "b.h5"):
        assert f"{name}: " in done.stderr
        assert f"{name}\n" in done.stdout


def test_names_that_ls_prints_are_found_from_the_campaigns_folder(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    for name in ("20261211T025512Z-a.h5", "20261212T025512Z-b.h5"):
        assert name in fieldkit("show", "-C", campaign, name).stdout
    for command in ("show", "recover", "replay", "calibrate surface", "calibrate uniformity"):
        with pytest.raises(SessionError, check=at("c.h5", Action.LIST_SESSIONS())):
            invoke(*command.split(), "-C", campaign, "c.h5")


def test_recover_finishes_all_of_a_campaign_and_then_nothing(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    done = succeed("recover", "-C", campaign)
    assert "20261212T025512Z-b.h5" in done.stdout
    assert "camera: 20 samples" in done.stdout
    assert document("recover", "-C", campaign, "20261212T025512Z-b.h5")["sessions"][0]["was_complete"]
    assert "b.h5.crashed" in succeed("recover", "-C", campaign, "--tidy").stderr
    assert "b.h5" not in fieldkit("recover", "-C", campaign, "--tidy").stderr
    names = sorted(path.name for path in (campaign / "recordings").iterdir())
    assert names == ["20261211T025512Z-a.h5", "20261212T025512Z-b.h5"]


def test_a_session_that_cannot_be_recovered_does_not_keep_the_others_from_it(campaign):
    (campaign / "fieldkit.toml").write_text("schema = 1\n")
    broken = campaign / "recordings" / "20261210T025512Z-0.h5"
    broken.touch()
    broken.with_name(broken.name + ".journal").mkdir()
    done = fieldkit("recover", "-C", campaign)
    assert done.exit_code != 0
    assert str(broken) in done.stderr
    assert "camera: 20 samples" in done.stdout
    assert "recovered" in fieldkit("ls", "-C", campaign).stdout


def test_lost_samples_are_named_on_the_screen_and_in_json(sealed):
    whole = sealed.read_bytes()
    with h5py.File(sealed) as file:
        last = file["camera/counts"].id.get_chunk_info_by_coord((18, 0, 0)).byte_offset
    sealed.write_bytes(whole[: last + 10])
    damaged = fieldkit("recover", sealed)
    assert damaged.exit_code == IntegrityError.exit_code
    assert "LOST camera: 2 samples, " in damaged.stdout
    assert "18 to 19, after 2016-11-24T15:06:45" in damaged.stdout
    sealed.write_bytes(whole[: last + 10])
    (session,) = json.loads(fieldkit("recover", sealed, "--json").stdout)["sessions"]
    (lost,) = [lost for lost in session["lost"] if lost["stream"] == "camera"]
    assert (lost["first"], lost["last"], lost["samples"], lost["before"]) == (18, 19, 2, None)


@pytest.mark.parametrize("verb", ["check", "estimate", "replay", "report", "show"])
def test_every_verb_offers_to_recover_an_interrupted_session(crashed, verb):
    assert f"fieldkit recover {crashed}" in fieldkit(verb, crashed).stderr


def test_calibration_says_which_samples_it_is_made_without(tmp_path):
    about = header((24, 32))
    frames = (sample(about.streams[0], second, second * 1_000_000_000) for second in range(40))
    session_of(tmp_path / "board.h5", about, *frames)
    whole = fieldkit("calibrate", "uniformity", tmp_path / "board.h5")
    with h5py.File(tmp_path / "board.h5", "r+") as file:
        file["camera/fpa_temperature"][20] += 1.0
    done = succeed("calibrate", "uniformity", tmp_path / "board.h5", "--name", "again")
    assert "1 of 40 samples" not in whole.stderr
    assert "1 of 40 samples" in done.stderr


@pytest.mark.parametrize("kind", ["csv", "netcdf", "mcap", "tiff"])
def test_export_of_a_damaged_session_writes_the_rest_and_says_so(campaign, sealed, kind):
    with h5py.File(sealed, "r+") as file:
        file["camera/fpa_temperature"][4] += 1.0
    done = fieldkit("export", sealed, "--to", kind, "-o", campaign / "out")
    assert done.exit_code == IntegrityError.exit_code
    assert "1 of 20 samples" in done.stderr
    assert f"fieldkit check {sealed}" in done.stderr
    files = [Path(line) for line in done.stdout.splitlines() if not line.startswith("and")]
    assert files
    assert all(file.exists() for file in files)
    succeed("export", sealed, "--to", "mcap", "--stream", "lux", "-o", campaign / "lux")


def test_exports_lie_in_the_results_of_their_campaign_or_beside_a_session_elsewhere(sealed, tmp_path):
    succeed("export", sealed, "--to", "csv")
    assert list((tmp_path / "results" / sealed.stem).glob("*.csv"))
    alone = tmp_path / "stick" / "a.h5"
    alone.parent.mkdir()
    alone.write_bytes(sealed.read_bytes())
    succeed("export", alone, "--to", "csv")
    assert list((tmp_path / "stick" / "a-export").glob("*.csv"))


@pytest.mark.parametrize("kind", ["csv", "parquet", "netcdf"])
def test_export_of_every_stream_refuses_to_pass_over_the_one_named(campaign, sealed, kind):
    with pytest.raises(ConfigError, check=at(Argument("stream", "nope"))):
        invoke("export", sealed, "--to", kind, "--stream", "nope")
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
    with pytest.raises(ConfigError, match="video") as error:
        invoke("export", campaign / "recordings" / "20261211T025512Z-a.h5", "--to", kind, *words)
    assert words[0] in {"--from", f"--{error.value.place.name}"}


def test_frames_of_a_span_are_exported(sealed, tmp_path):
    with open_session(sealed) as session:
        times = [datetime.fromtimestamp(frame.time_ns / 1e9, UTC) for frame in session.samples("camera")]
    after = times[9] + timedelta(milliseconds=1)
    spans = {
        "late": ("--from", after.isoformat()),
        "early": ("--until", after.isoformat()),
        # clock times of the session's day, as near to it as they can be
        "whole": ("--from", clock_time(times[0], -1), "--until", clock_time(times[0], 1)),
    }
    for name, span in spans.items():
        succeed("export", sealed, "--to", "png", "-o", tmp_path / name, *span)
    written = {name: len(list((tmp_path / name).glob("*.png"))) for name in spans}
    assert written == {"late": 10, "early": 10, "whole": 20}
    with pytest.raises(ConfigError):
        invoke("export", sealed, "--to", "png", "--from", "-1s", "--until", "-5s")


def clock_time(moment: datetime, hours: float) -> str:
    """What clocks in Greenwich show so many hours later."""
    return f"{moment + timedelta(hours=hours):%H:%M}+00:00"


@pytest.mark.parametrize(
    ("option", "hours"), [("--from", 1), ("--from", 11), ("--until", -1), ("--until", -11)]
)
def test_a_span_outside_the_session_is_refused(sealed, tmp_path, option, hours):
    with open_session(sealed) as session:
        first = datetime.fromtimestamp(session.start_ns / 1e9, UTC)
    with pytest.raises(ConfigError, match=f":{first:%M:%S} to "):
        invoke("export", sealed, "--to", "png", "-o", tmp_path / "none", option, clock_time(first, hours))
    assert not (tmp_path / "none").exists()


def test_session_of_which_only_the_journal_is_left_is_offered_too(crashed):
    crashed.unlink()
    with pytest.raises(SessionError) as error:
        invoke("show", crashed)
    assert error.value.fix == Action.RECOVER(crashed)
    succeed("recover", crashed)


def test_mark_that_the_recorder_had_no_time_to_take_is_recovered_with_kind_and_end(crashed):
    inbox(crashed).mkdir()
    send(inbox(crashed), Mark("lightning", "storm", "2026-12-12T03:00:00Z", "2026-12-12T03:10:00Z"))
    send(inbox(crashed), Mark("moved"))
    fieldkit("recover", crashed)
    events = {event["text"]: event for event in document("show", crashed)["events"]}
    assert events["lightning"]["label"] == "storm"
    assert events["lightning"]["end"] == "2026-12-12 12:10:00 JST"
    assert (events["moved"]["label"], events["moved"]["end"]) == ("", "")


def test_recovering_what_is_no_session_says_what_to_do_and_leaves_nothing(tmp_path):
    path = tmp_path / "junk.h5"
    path.write_bytes(b"no session")
    with pytest.raises(SessionError, match=r"(?s)junk\.h5.*\.journal"):
        invoke("recover", path)
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture
def frames(tmp_path):
    """Three frames of counts, named by their times."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for second in range(3):
        cv2.imwrite(str(folder / f"20260512T01000{second}.tif"), np.full((5, 7), 29_500, np.uint16))
    return folder


STATED = ("--time-format", "%Y%m%dT%H%M%S", "--zone", "UTC", "--kelvin-per-count", "0.01")


def asks_for(*arguments: Argument) -> Callable[[ConfigError], bool]:
    return lambda error: steps(error) == list(arguments)


def test_import_makes_a_session_and_asks_for_what_it_cannot_know(frames, tmp_path):
    out, place = tmp_path / "a.h5", ("--site=35.5,139.4,9", "-C", tmp_path)
    with pytest.raises(ConfigError, check=asks_for(Argument("kelvin_per_count", 0.01))):
        invoke("import", frames, *place)
    with pytest.raises(ConfigError, check=asks_for(Argument("site"))):
        invoke("import", frames, *STATED, "-C", tmp_path)
    assert document("import", frames, *place, *STATED, "-o", out)["samples"] == {"camera": 3}
    assert "29500 K" not in succeed("show", out).stdout
    succeed("check", out, "--no-estimates")


def test_import_without_a_site_warns_that_the_campaigns_is_taken(frames, tmp_path):
    succeed("init", tmp_path / "fresh", "--quiet")
    done = succeed("import", frames, *STATED, "-C", tmp_path / "fresh", "-o", tmp_path / "a.h5")
    assert re.search("warning: .*the paper's", done.stderr)
    with open_session(tmp_path / "a.h5") as session:
        warned = [event for event in session.events() if event.severity is Severity.WARNING]
        assert "site" in warned[0].text
        assert session.site.latitude_deg == 35.558675
    succeed("check", tmp_path / "a.h5")
    assert fieldkit("check", tmp_path / "a.h5", "--strict").exit_code == IntegrityError.exit_code
    succeed("init", tmp_path / "own", "--site", "47.1,8.5,400", "--quiet")
    own = ("import", frames, *STATED, "-C", tmp_path / "own", "-o")
    assert "47.1, 8.5; " in succeed(*own, tmp_path / "b.h5").stderr
    assert "warning: " not in succeed(*own, tmp_path / "c.h5", "--site=1,2").stderr


@pytest.mark.parametrize("present", [False, True])
def test_an_imported_session_is_estimated_under_the_sun_of_its_own_site(tmp_path, present):
    """In Tokyo it is night when it is noon at Alamosa; SPA (pvlib) gives 29.3 degrees there at 19:05 UTC."""
    campaign = tmp_path / "tokyo"
    succeed("init", campaign, "--quiet")
    log = tmp_path / "light.csv"
    log.write_text("time,lux [lx]\n" + "".join(f"2016-01-01T19:{m:02}:00Z,50000\n" for m in range(3, 7)))
    out = campaign / "recordings" / "noon.h5"
    place = ("--site", "37.70,-105.92,2317", "-C", campaign)
    succeed("import", log, *place, "-o", out)
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
    with pytest.raises(ConfigError) as error:
        invoke("import", table, "--clock-offset", "auto", "--site=1,2")
    assert error.value.fix == Action.IMPORT_INTO()
    for name in ("events", "a/b"):
        with pytest.raises(ConfigError) as error:
            invoke("import", table, "--as", name, "--site=1,2")
        assert error.value.place == Argument("name")
    wrong = fieldkit("import", table, "--clock-offset", "soon", "--site=1,2")
    assert "-2m" in wrong.stderr


def test_a_stream_added_to_a_session_refuses_the_sessions_own_options(tmp_path):
    table = tmp_path / "log.csv"
    table.write_text("time,T1 [C]\n2026-05-12T01:00:00Z,3\n")
    succeed("import", table, "--site=1,2", "-o", tmp_path / "a.h5")
    with pytest.raises(ConfigError, check=asks_for(Argument("title"), Argument("site"))):
        invoke("import", table, "--into", tmp_path / "a.h5", "--site=1,2", "--title", "x", "--as", "b")


def test_a_place_against_the_one_in_the_file_is_refused_with_both(tmp_path):
    (tmp_path / "slv16001.dat").write_bytes(surfrad())  # 37.70 N 105.92 W
    with pytest.raises(ConfigError, check=at(Argument("site"))):
        invoke("import", tmp_path / "slv16001.dat", "--site=35.5,139.4,9", "-o", tmp_path / "a.h5")


@pytest.mark.parametrize("name", ["beds/1", "../../oops", "a\\b"])
def test_a_name_cannot_put_a_session_where_no_verb_looks(tmp_path, name):
    succeed("init", "--simulated", tmp_path / "c")
    with pytest.raises(ConfigError, match=re.escape(repr(name))):
        invoke("record", "-C", tmp_path / "c", "--for", "10s", "--name", name)
    assert not list(tmp_path.rglob("*.h5"))
