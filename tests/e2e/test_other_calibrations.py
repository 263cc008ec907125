"""Scale, light meter, clock and uniformity of a day of three beds."""

import hashlib
import json
import math
import os
import pty
import shlex
import shutil
import threading
import time
import tomllib
import tty
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.model.samples import Frame, Sample
from fieldkit.recording.in_progress import status, stop
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.time_map import TimeStep
from fieldkit.weather import packaged_day
from tests.harness.calibration_days import (
    TRUE_EMISSIVITY,
    calibrated,
    fieldkit,
    found_with_damage,
    mean_error_deg,
    record_beds,
    rewritten,
)
from tests.harness.command_line import program
from tests.harness.waiting import wait_until
from tests.shared_data import shared


@pytest.fixture(scope="module")
def beds(tmp_path_factory):
    """A campaign that knows its sand."""
    folder = tmp_path_factory.mktemp("beds")
    record_beds(folder, surface={"emissivity": TRUE_EMISSIVITY})
    return folder


@pytest.fixture(scope="module")
def three_beds(beds):
    return next(beds.glob("recordings/*three-beds.h5"))


def test_the_scale_from_one_bed_and_what_temperatures_cannot_tell(three_beds, beds):
    said = fieldkit(
        "calibrate", "surface", three_beds, "--region", "b15", "--name", "one-bed",
        "--set", "estimator.model=paper",
    ).output  # fmt: skip
    assert "albedo, emissivity" in said
    command = ("surface", three_beds, "--set", "estimator.model=paper", "--tilt-sd")
    exact, rough = (
        calibrated(*command, "0.1", "--name", "exact"),
        calibrated(*command, "2", "--name", "rough"),
    )
    assert exact["standard_uncertainty"] < rough["standard_uncertainty"]
    plain = mean_error_deg(three_beds, "estimator.model=paper", "surface.emissivity=0.90")
    assert fieldkit(
        "calibrate", "surface", three_beds, "--region", "b15", "--name", "paper-bed",
        "--set", "estimator.model=paper", "--set", "surface.emissivity=0.90",
    )  # fmt: skip
    scaled = mean_error_deg(
        three_beds, "estimator.model=paper", "surface.emissivity=0.90", "estimator.scale=@paper-bed"
    )
    assert scaled < plain


def test_the_light_meters_factor_from_the_station(three_beds):
    """The scene's meter answers 108 lm/W to the beam and 130 to the sky (its own constants): 109 together."""
    station = ("irradiance", three_beds, "--station", "alamosa-2016-01-01")
    found = calibrated(*station)
    assert 1.0 / found["value"] == pytest.approx(109.0, abs=1.5)
    assert found["unit"] == "W/m2/lx"
    said = fieldkit("calibrate", *station).output
    assert f"{1.0 / found['value']:.0f} lm/W" in said
    unsure = calibrated(*station, "--reference-sd", "0.2", "--name", "unsure")
    assert unsure["standard_uncertainty"] / unsure["value"] == pytest.approx(0.2, abs=0.02)


def with_logger(session: Path, to: Path, name: str, times_ns: np.ndarray, watts: np.ndarray) -> Path:
    """The session with the table of a logger that ran beside it, brought in as a user does."""
    with open_session(session) as opened:
        beside = (opened.start_ns < times_ns) & (times_ns < opened.end_ns)
    rows = [
        f"{datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat()},{watt:.1f}"
        for time_ns, watt in zip(times_ns[beside].tolist(), watts[beside].tolist(), strict=True)
    ]
    table = to.with_suffix(".csv")
    table.write_text("\n".join(["time,light [W/m2]", *rows]) + "\n", encoding="utf-8")
    fieldkit("import", table, "--into", session, "--as", name, "-o", to)
    return to


def watts_per_lux(session: Path, *options: str | Path) -> dict[str, Any]:
    found: dict[str, Any] = calibrated("irradiance", session, *options)
    return found


BOTH_LM_W = 109.0
"""The scene's meter answers 108 lm/W to the beam, 130 to the sky (its own constants): together, that day."""


def test_the_light_meters_factor_from_a_pyranometer_and_a_pyrheliometer(three_beds, tmp_path):
    """Alamosa's own instruments on that day, whose sky the scene has, logged beside the beds."""
    weather = packaged_day()
    global_ = with_logger(three_beds, tmp_path / "global.h5", "cmp11", weather.time_ns, weather.ghi_w_m2)
    found = watts_per_lux(global_, "--pyranometer", "cmp11")
    assert 1.0 / found["value"] == pytest.approx(BOTH_LM_W, rel=0.04)  # three instruments close to 4 % there
    assert "pyranometer cmp11" in found["method"]
    beam = with_logger(three_beds, tmp_path / "beam.h5", "chp1", weather.time_ns, weather.dni_w_m2)
    with_sky = watts_per_lux(beam, "--pyrheliometer", "chp1", "--name", "with-sky")
    assert with_sky["value"] == pytest.approx(1.0 / BOTH_LM_W, abs=2 * with_sky["expanded_uncertainty"])
    alone = ("--name", "alone", "--set", "irradiance.diffuse=none")
    assert watts_per_lux(beam, "--pyrheliometer", "chp1", *alone)["value"] < with_sky["value"]
    refused = fieldkit("calibrate", "irradiance", beam, "--pyranometer", "cmp11", code=3)
    assert "'cmp11'" in refused.output
    assert "chp1" in refused.output


def test_minutes_far_from_any_value_of_the_reference_do_not_count(three_beds, tmp_path):
    """A logger that missed ten minutes: nobody knows whether the sky was steady in them."""
    weather = packaged_day()
    logger = with_logger(three_beds, tmp_path / "whole.h5", "cmp11", weather.time_ns, weather.ghi_w_m2)
    whole = watts_per_lux(logger, "--pyranometer", "cmp11")
    with open_session(three_beds) as opened:
        middle_ns = (opened.start_ns + opened.end_ns) // 2
    kept = np.abs(weather.time_ns - middle_ns) > 300 * 10**9
    logger = with_logger(
        three_beds, tmp_path / "gap.h5", "cmp11", weather.time_ns[kept], weather.ghi_w_m2[kept]
    )
    missed = watts_per_lux(logger, "--pyranometer", "cmp11", "--name", "gap")
    assert missed["details"]["minutes"] == whole["details"]["minutes"] - np.count_nonzero(~kept)


def test_the_light_meters_factor_from_the_stations_own_file(three_beds, tmp_path, monkeypatch):
    """SURFRAD, Alamosa, 2016-01-01, as published; the record names the file and its checksum."""
    file = shared("data/weather/slv16001.dat")
    monkeypatch.chdir(file.parent)
    found = watts_per_lux(three_beds, "--station", file.name, "--name", "surfrad")
    assert 1.0 / found["value"] == pytest.approx(BOTH_LM_W, abs=1.5)
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (three_beds, file)]
    assert [source["sha256"] for source in found["sources"]] == sums
    other_day = fieldkit("calibrate", "irradiance", three_beds, "--station", "slv15365.dat", code=3)
    assert "another day" in other_day.output
    elsewhere = fieldkit("calibrate", "irradiance", three_beds, "--station", "tbl17005.dat", code=3)
    assert "40.125, -105.237" in elsewhere.output  # where Table Mountain stands


def record_readings(folder: Path, count: int) -> Path:
    """The session of a receiver ``gps``, stopped once so many of its readings are in it."""
    process = program("record", "-C", folder, "--quiet", stdout=None, stderr=None)
    try:
        wait_until(lambda: session_in_progress(folder / "recordings"), "nothing is recorded", every_s=0.1)
        wait_until(lambda: status(folder)["counts"]["gps"] >= count, "too few readings", every_s=0.2)
        path = stop(folder)
    finally:
        process.kill()
        process.wait()
    assert path is not None
    return path


@pytest.fixture
def talking(tmp_path):
    """Records an NMEA receiver that sends, five times a second, what a function says; the session."""
    far, near = pty.openpty()
    tty.setraw(near)
    ended = threading.Event()

    def record(said: Callable[[float], bytes]) -> Path:
        def talk() -> None:
            start = math.inf
            while not ended.wait(0.2):
                if start == math.inf and session_in_progress(tmp_path / "recordings"):
                    start = time.monotonic()
                os.write(far, said(max(0.0, time.monotonic() - start)))

        threads.append(threading.Thread(target=talk, daemon=True))
        threads[-1].start()
        gps = f'[device.gps]\ndriver = "nmea"\nport = "{os.ttyname(near)}"\n'
        (tmp_path / "fieldkit.toml").write_text(
            campaign_toml({"site": SIMULATED["site"]}) + gps, encoding="utf-8"
        )
        return record_readings(tmp_path, 25)

    threads: list[threading.Thread] = []
    yield record
    ended.set()
    for thread in threads:
        thread.join(2)
    os.close(far)
    os.close(near)


def nmea(moment: datetime, status: str) -> bytes:
    """An RMC sentence with its check, as receivers write it: A with a fix, V without."""
    place = "3541.3668,N,13945.3012,E,0.02,77.52" if status == "A" else ",,,,,"
    body = f"GPRMC,{moment:%H%M%S}.00,{status},{place},{moment:%d%m%y},,,{status if status == 'A' else 'N'}"
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def test_a_receivers_time_counts_from_its_fix_on_and_is_applied(talking):
    """Until then it goes by its own clock, from the date its maker gave it (gpsd's and minmea's logs)."""

    def said(seconds: float) -> bytes:
        if seconds < 2.5:
            return nmea(datetime(1980, 1, 6, tzinfo=UTC) + timedelta(seconds=seconds), "V")
        return nmea(datetime.now(UTC) + timedelta(seconds=27.5), "A")

    session = talking(said)
    found = calibrated("clock", session, "--gps", "gps", "--apply")
    assert found["value"] == pytest.approx(27.0, abs=0.7)  # whole seconds, cut off: half a second late
    assert found["expanded_uncertainty"] == pytest.approx(0.8, abs=0.2)  # of its sentences 0.4 s, k = 2
    with open_session(session) as opened:
        moved_ns = opened.times_ns("gps") - opened.stream("gps").time_ns(recorded=True)
    assert moved_ns == pytest.approx(found["value"] * 1e9, abs=1e6)
    refused = fieldkit("calibrate", "clock", session, "--gps", "watch", code=3)
    assert "watch" in refused.output


@pytest.mark.parametrize(
    ("status", "weeks", "said"),
    [("V", 0, "never had a fix"), ("A", 1024, "1024 weeks off: its count of weeks has rolled over")],
)
def test_a_receiver_without_a_date_to_be_believed_is_refused(talking, status, weeks, said):
    session = talking(lambda _: nmea(datetime.now(UTC) - timedelta(weeks=weeks), status))
    assert said in " ".join(fieldkit("calibrate", "clock", session, "--gps", "gps", code=8).output.split())


def test_a_clock_that_is_right_is_left_as_it_is(three_beds):
    assert "nothing," in fieldkit("calibrate", "clock", three_beds, "--sun").output


def test_an_offset_within_its_uncertainty_moves_no_times(three_beds, tmp_path):
    """Minutes that haze looks like would spoil a clock that is right; an earlier offset is taken back."""
    session = shutil.copy(three_beds, tmp_path / three_beds.name)
    apply_time_map(session, [TimeStep(0, 3600 * 10**9, "by mistake")])
    said = fieldkit("calibrate", "clock", session, "--sun", "--apply").output
    assert f"{session.name}: +0.0 s" in " ".join(said.split())
    with open_session(session) as opened:
        assert (opened.times_ns("lux") == opened.stream("lux").time_ns(recorded=True)).all()


def test_the_clock_against_the_sun_and_applied(three_beds, tmp_path):
    """An hour wrong, as a forgotten daylight saving time would be."""
    wrong = rewritten(
        three_beds, tmp_path / "wrong.h5", lambda one: one._replace(time_ns=one.time_ns - 3_600_000_000_000)
    )
    found = calibrated("clock", wrong, "--sun")
    assert found["value"] == pytest.approx(3600.0, abs=max(600.0, 2 * found["expanded_uncertainty"]))
    with open_session(wrong) as session:
        recorded = session.start_ns
    said = " ".join(fieldkit("calibrate", "clock", wrong, "--sun").output.split())
    command = shlex.split(said.partition("used by: ")[2])
    assert command == ["fieldkit", "calibrate", "clock", str(wrong), "--sun", "--apply"]
    fieldkit(*command[1:])
    with open_session(wrong) as session:
        assert next(session.samples()).time_ns - recorded == pytest.approx(found["value"] * 1e9, abs=1e9)


@pytest.mark.parametrize(
    "command", [("clock", "--sun"), ("irradiance", "--station", "alamosa-2016-01-01")], ids=" ".join
)
def test_no_calibration_depends_on_how_light_is_damaged(three_beds, tmp_path, command):
    halved, doubled = found_with_damage(three_beds, tmp_path, "lux/value", *command)
    assert halved == doubled


@pytest.mark.parametrize("days", [0, -18])
def test_a_phones_time_is_that_of_the_key_press_not_of_the_programs_start(beds, days):
    """The start of the program made it -2 to -14 s wrong, stated as good to a second."""
    shown = datetime.now(UTC) + timedelta(days=days, seconds=90)
    keys, terminal = pty.openpty()
    words = ("calibrate", "clock", "-C", beds, "--at", shown.isoformat(), "--json")
    with program(*words, stdin=terminal) as process:
        assert process.stderr is not None
        assert "key" in process.stderr.readline()
        time.sleep(2.0)  # as long as a slow start would take
        pressed = datetime.now(UTC)
        os.write(keys, b" ")
        out, said = process.communicate(timeout=500)
    assert ("both clocks" in said) == (days != 0)  # a whole day is a slip of a date
    os.close(keys)
    os.close(terminal)
    found = json.loads(out)
    assert found["value"] == pytest.approx((shown - pressed).total_seconds(), abs=0.5)
    assert found["expanded_uncertainty"] == pytest.approx(1.0, abs=0.1)


def test_a_phones_time_without_a_terminal_is_refused(beds):
    shown = datetime.now(UTC).isoformat()
    assert "key press" in fieldkit("calibrate", "clock", "-C", beds, "--at", shown, code=2).output


def uniform(source: Path, to: Path, offsets_k: dict[str, float], hours_later: float = 0.0) -> Path:
    """Two minutes of a session as if one board at 290 K lay over all regions."""
    with open_session(source) as session:
        header, regions = session.header, session.regions
        start = session.start_ns
        later_ns = round(hours_later * 3.6e12)
        random = np.random.default_rng(1)
        samples: list[Sample] = []
        for number, frame in enumerate(_frames(session.samples("camera"), 90)):
            kelvin = 290.0 + 0.05 * random.standard_normal(frame.counts.shape)
            for region in regions:
                kelvin[region.mask(frame.counts.shape)] += offsets_k.get(region.name, 0.0)
            at = start + later_ns + number * 1_300_000_000
            counts = np.round(kelvin / 0.01).astype(np.uint16)
            samples.append(frame._replace(time_ns=at, mono_ns=at, counts=counts))
    write_imported(to, header, ImportedRecording(header.streams, samples), str(source))
    return to


def _frames(samples: Iterator[Sample], count: int) -> Iterator[Frame]:
    for _ in range(count):
        frame = next(samples)
        assert isinstance(frame, Frame)
        yield frame


def test_a_board_before_and_after_gives_offsets_drift_and_a_record_that_corrects(beds, three_beds, tmp_path):
    first = uniform(three_beds, tmp_path / "before.h5", {"b15": 0.31, "b25": -0.20})
    second = uniform(three_beds, tmp_path / "after.h5", {"b15": 0.41, "b25": -0.20}, hours_later=2.0)
    found = calibrated("uniformity", first, second, "--name", "board")
    assert found["values"]["b15"] == pytest.approx(0.36, abs=0.02)
    assert found["values"]["b25"] == pytest.approx(-0.20, abs=0.02)
    assert found["details"]["drift_k_per_h"]["b15"] == pytest.approx(0.05, abs=0.005)
    assert found["uncertainties"]["b15"] > found["uncertainties"]["b05"]
    rough = calibrated("uniformity", first, second, "--target-sd", "0.5", "--name", "rough")
    assert rough["uncertainties"]["b05"] == pytest.approx(0.5, abs=0.1)
    three = tomllib.loads((beds / "fieldkit.toml").read_text())["region"]
    regions = [{**one, "offset_k": "@board"} if one["name"] == "b15" else one for one in three]
    config = tmp_path / "fieldkit.toml"
    config.write_text(campaign_toml({**SIMULATED, "region": regions}), encoding="utf-8")
    from fieldkit.config import load_config

    assert load_config(config).estimator_settings().offsets_k == {"b15": pytest.approx(0.36, abs=0.02)}


def test_what_is_no_uniform_target_is_refused(three_beds, tmp_path):
    session = tmp_path / "beds.h5"
    session.write_bytes(three_beds.read_bytes())
    assert "one target" in fieldkit("calibrate", "uniformity", session, code=8).output
