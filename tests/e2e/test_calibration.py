"""The calibrator's journey on simulated devices: an emissivity day, its record, and a day of slopes with it.

Truth is the simulated field's: sand of emissivity 0.80 where the configuration believes 0.90.
"""

from __future__ import annotations

import hashlib
import json
import socket
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from fieldkit.commands import main
from fieldkit.commands.demo import mean_tilt_error_deg
from fieldkit.commands.estimating import config_for, estimator_for, minutes_of
from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.samples import Frame, Reading, Sample
from fieldkit.sessions.exchange.imported import Foreign, write_foreign
from fieldkit.sessions.reader import open_session
from fieldkit.weather import packaged
from tests.shared_data import shared

TRUE_EMISSIVITY = 0.80
FAST = ("--set", "simulation.speed=max", "--set", f"simulation.emissivity={TRUE_EMISSIVITY}")
SAND = {"name": "sand", "kind": "reference", "points_px": [[18, 77], [64, 74], [65, 101], [15, 106]]}
FOIL = {"name": "foil", "points_px": [[93, 74], [140, 77], [145, 106], [95, 101]]}
STEEP = {
    "name": "steep",
    "points_px": [[92, 28], [129, 29], [135, 56], [92, 53]],
    "tilt_deg": 25.0,
    "azimuth_deg": 180.0,
}


def fieldkit(*arguments: str | Path, code: int = 0) -> Result:
    found = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert found.exit_code == code, found.output
    return found


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with an emissivity day recorded by the wizard, and its record."""
    folder = tmp_path_factory.mktemp("sand")
    given = {**SIMULATED, "region": [SAND, FOIL, STEEP]}
    (folder / "fieldkit.toml").write_text(campaign_toml(given), encoding="utf-8")
    said = fieldkit(
        "calibrate", "emissivity", "-C", folder, "--sample", "dry-sand", "--for", "3h30m", *FAST,
        "--set", "record.burst_frames=3", "--set", 'simulation.foil="foil"',
        "--set", "simulation.start=2016-01-01T12:15:00-07:00",
    )  # fmt: skip
    (folder / "said.txt").write_text(said.output, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def emissivity_day(campaign: Path) -> Path:
    return next(campaign.glob("recordings/*dry-sand.h5"))


@pytest.fixture(scope="module")
def record(campaign: Path) -> dict[str, Any]:
    return tomllib.loads(next(campaign.glob("calibration/*dry-sand.toml")).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def beds(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another campaign of three beds, which uses the record; one hour recorded."""
    folder = tmp_path_factory.mktemp("beds")
    given = {
        **SIMULATED,
        "surface": {"emissivity": "@dry-sand"},
        "estimator": {"model": "full", "azimuth": "known"},
    }
    (folder / "calibration").mkdir()
    for file in campaign.glob("calibration/*.toml"):
        (folder / "calibration" / file.name).write_bytes(file.read_bytes())
    (folder / "fieldkit.toml").write_text(campaign_toml(given), encoding="utf-8")
    said = fieldkit("record", "-C", folder, "--for", "75m", "--name", "three-beds", *FAST, "--no-color")
    (folder / "said.txt").write_text(said.output, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def three_beds(beds: Path) -> Path:
    return next(beds.glob("recordings/*three-beds.h5"))


def mean_error_deg(session: Path, *settings: str) -> float:
    with open_session(session) as opened:
        estimator = estimator_for(opened, config_for(opened, settings))
        return mean_tilt_error_deg(list(minutes_of(opened, estimator)), estimator.regions)


# --- emissivity day, record, slopes


def test_the_wizard_watches_steadiness_and_the_truth_lies_inside_what_it_states(
    campaign: Path, record: dict[str, Any]
) -> None:
    said = (campaign / "said.txt").read_text()
    assert "K/min steady" in said
    assert "K/min wait" in said
    assert "temperatures 2 of 3" in said
    assert "largest contribution: reflected temperature" in said
    assert abs(record["value"] - TRUE_EMISSIVITY) <= record["expanded_uncertainty"]
    assert record["expanded_uncertainty"] < 0.05
    assert record["instrument"]["range"] == "high"
    assert record["details"]["reflected_by"] == "foil, ISO 18434-1"


def test_a_shutter_correction_runs_before_each_burst(emissivity_day: Path) -> None:
    with open_session(emissivity_day) as session:
        assert session.count("camera") == pytest.approx(3 * 210, abs=6)
        assert session.state == "sealed"


def test_the_script_on_the_recording_says_the_same_and_names_its_session(
    emissivity_day: Path, record: dict[str, Any], tmp_path: Path
) -> None:
    copy = tmp_path / emissivity_day.name
    copy.write_bytes(emissivity_day.read_bytes())
    again = json.loads(fieldkit("calibrate", "emissivity", copy, "--sample", "dry-sand", "--json").stdout)
    assert again["value"] == pytest.approx(record["value"], abs=1e-12)
    assert again["sources"] == record["sources"]
    assert again["sources"][0]["sha256"] == hashlib.sha256(copy.read_bytes()).hexdigest()
    assert (tmp_path / "calibration" / Path(again["record"]).name).exists()


def test_slopes_are_better_with_the_record_than_without(three_beds: Path) -> None:
    """Full model, azimuth known, 75 minutes: the record 0.3°, the paper's 0.90 1.1°."""
    with_record = mean_error_deg(three_beds)
    without = mean_error_deg(three_beds, "surface.emissivity=0.90")
    assert with_record < 0.5 * without
    assert with_record < 0.6


def test_the_session_keeps_the_record_and_can_be_read_under_another(
    beds: Path, three_beds: Path, record: dict[str, Any]
) -> None:
    with open_session(three_beds) as session:
        config = config_for(session)
    assert config.surface_parameters().emissivity == record["value"]
    kept = config.calibrations()["surface.emissivity"]
    assert kept.sources[0].sha256 == record["sources"][0]["sha256"]
    before = three_beds.read_bytes()
    plain = fieldkit("estimate", three_beds, "--json").stdout
    other = fieldkit("estimate", three_beds, "--json", "--set", "surface.emissivity=0.95").stdout
    assert json.loads(plain)["slopes"] != json.loads(other)["slopes"]
    assert three_beds.read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"date = 2016": "date = 2014", "expires = 2016": "expires = 2014"}, "dry-sand is 729 days old"),
        ({'range = "high"': 'range = "low"'}, "dry-sand was made in range low; here is high"),
        ({'model = "': 'model = "Other '}, "dry-sand was made with Other "),
    ],
    ids=["old", "other range", "other camera"],
)
def test_a_record_older_than_a_year_or_of_another_camera_is_warned_of(
    beds: Path, tmp_path: Path, changes: dict[str, str], said: str
) -> None:
    assert "warning" not in (beds / "said.txt").read_text()
    (tmp_path / "calibration").mkdir()
    for file in beds.glob("calibration/*.toml"):
        text = file.read_text(encoding="utf-8")
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "calibration" / file.name).write_text(text, encoding="utf-8")
    (tmp_path / "fieldkit.toml").write_text((beds / "fieldkit.toml").read_text(), encoding="utf-8")
    warned = fieldkit("record", "-C", tmp_path, "--for", "1m", *FAST).output
    assert f"warning: surface.emissivity: {said}" in warned


# --- wrong inputs


def rewritten(source: Path, to: Path, change: Callable[[Sample], Sample]) -> Path:
    """The session once more, each sample as `change` makes it."""
    with open_session(source) as session:
        header = session.header
        samples = sorted((change(one) for one in session.samples()), key=lambda one: one.time_ns)
    clockless = (replace(one, mono_ns=one.time_ns) for one in samples)
    write_foreign(to, header, Foreign(header.streams, list(clockless)), str(source))
    return to


def in_fahrenheit(sample: Sample) -> Sample:
    if isinstance(sample, Frame) or sample.stream != "thermometer":
        return sample
    celsius = (value - 273.15 for value in sample.values)  # stored in kelvin, as the driver took it for °C
    return replace(sample, values=tuple(1.8 * value + 32.0 + 273.15 for value in celsius))


def ten_minutes_late(sample: Sample) -> Sample:
    late_ns = 600_000_000_000 if sample.stream == "thermometer" else 0
    return replace(sample, time_ns=sample.time_ns + late_ns)


def twice_corrected(sample: Sample) -> Sample:
    if isinstance(sample, Reading):
        return sample
    kelvin = sample.counts * 0.01
    for _ in range(2):
        kelvin = surface_temperature_k(kelvin, TRUE_EMISSIVITY, 229.15)
    return replace(sample, counts=np.round(np.nan_to_num(kelvin, nan=100.0) / 0.01).astype(np.uint16))


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        (in_fahrenheit, (), "°F"),
        (ten_minutes_late, (), "moved by -10"),
        (twice_corrected, ("--reflected", "-44"), "applied an emissivity|apply an emissivity"),
        (None, ("--region", "steep"), "follows the probe T3, not T1"),
        (None, ("--reflected", "0"), "from what it mirrors"),
        (None, ("--reflected", "free"), "cannot be told apart"),
    ],
    ids=["fahrenheit", "clock", "twice", "bed", "contrast", "span"],
)
def test_what_would_give_a_wrong_emissivity_is_refused_and_nothing_is_saved(
    emissivity_day: Path,
    tmp_path: Path,
    change: Callable[[Sample], Sample] | None,
    options: tuple[str, ...],
    said: str,
) -> None:
    import re

    session = tmp_path / "day.h5"
    if change is None:
        session.write_bytes(emissivity_day.read_bytes())
    else:
        rewritten(emissivity_day, session, change)
    refused = fieldkit("calibrate", "emissivity", session, "--sample", "x", *options, code=8)
    assert re.search(said, refused.output), refused.output
    assert "fix:" in refused.output
    assert not (tmp_path / "calibration").exists()


@pytest.mark.parametrize(
    "options",
    [
        ("--tape", "steep", "--tape-emissivity", "0.8", "--region", "steep"),
        ("--band", "1356,1"),
        ("--distance", "5", "--air", "0"),
        ("--reflected", "-46", "--channel", "T1", "--angle", "30"),
    ],
    ids=["tape", "band", "air", "given sky"],
)
def test_other_ways_to_the_same_emissivity(
    emissivity_day: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    """Tape that is the sand itself must give the tape's emissivity; the others differ by little."""
    session = tmp_path / "day.h5"
    session.write_bytes(emissivity_day.read_bytes())
    found = json.loads(
        fieldkit("calibrate", "emissivity", session, "--sample", "x", "--json", *options).stdout
    )
    assert found["value"] == pytest.approx(TRUE_EMISSIVITY, abs=0.02)
    assert found["expanded_uncertainty"] < 0.06


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--region", "mud"), "no region 'mud'"),
        (("--channel", "9"), "no probe '9'"),
        (("--reflected", "mirror"), "no region 'mirror'"),
        (("--band", "7,8,9"), "no band"),
    ],
)
def test_what_is_not_there_is_told_with_what_is(
    emissivity_day: Path, options: tuple[str, ...], said: str
) -> None:
    refused = fieldkit("calibrate", "emissivity", emissivity_day, "--sample", "x", *options, code=3)
    assert said in refused.output


# --- the other calibrations on the same day


def test_the_scale_from_one_bed_and_what_temperatures_cannot_tell(three_beds: Path, beds: Path) -> None:
    said = fieldkit("calibrate", "surface", three_beds, "--bed", "b15", "--name", "one-bed").output
    assert "albedo, emissivity and exchange apart cannot be told from temperatures" in said
    plain = mean_error_deg(three_beds, "estimator.model=paper", "surface.emissivity=0.90")
    assert fieldkit(
        "calibrate", "surface", three_beds, "--bed", "b15", "--name", "paper-bed",
        "--set", "estimator.model=paper", "--set", "surface.emissivity=0.90",
    )  # fmt: skip
    scaled = mean_error_deg(
        three_beds, "estimator.model=paper", "surface.emissivity=0.90", "estimator.scale=@paper-bed"
    )
    assert scaled < plain


def test_the_light_meters_factor_from_the_station(three_beds: Path) -> None:
    """The scene's meter answers 108 lm/W to the beam and 130 to the sky (its own constants): 109 together."""
    found = json.loads(
        fieldkit(
            "calibrate", "irradiance", three_beds, "--station", "alamosa-2016-01-01", "--json"
        ).stdout
    )  # fmt: skip
    assert 1.0 / found["value"] == pytest.approx(109.0, abs=1.5)
    assert found["unit"] == "W/m2/lx"


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
    found: dict[str, Any] = json.loads(
        fieldkit("calibrate", "irradiance", session, *options, "--json").stdout
    )
    return found


BOTH_LM_W = 109.0
"""The scene's meter answers 108 lm/W to the beam, 130 to the sky (its own constants): together, that day."""


def test_the_light_meters_factor_from_a_pyranometer_and_a_pyrheliometer(
    three_beds: Path, tmp_path: Path
) -> None:
    """Alamosa's own instruments on that day, whose sky the scene has, logged beside the beds."""
    weather = packaged()
    global_ = with_logger(three_beds, tmp_path / "global.h5", "cmp11", weather.time_ns, weather.ghi)
    found = watts_per_lux(global_, "--pyranometer", "cmp11")
    assert 1.0 / found["value"] == pytest.approx(BOTH_LM_W, rel=0.04)  # three instruments close to 4 % there
    assert "pyranometer cmp11" in found["method"]
    beam = with_logger(three_beds, tmp_path / "beam.h5", "chp1", weather.time_ns, weather.dni)
    with_sky = watts_per_lux(beam, "--pyrheliometer", "chp1", "--name", "with-sky")
    assert with_sky["value"] == pytest.approx(1.0 / BOTH_LM_W, abs=2 * with_sky["expanded_uncertainty"])
    alone = ("--name", "alone", "--set", "irradiance.diffuse=none")
    assert watts_per_lux(beam, "--pyrheliometer", "chp1", *alone)["value"] < with_sky["value"]
    refused = fieldkit("calibrate", "irradiance", beam, "--pyranometer", "cmp11", code=3)
    assert "no irradiance stream 'cmp11'" in refused.output
    assert "it has chp1" in refused.output


def test_the_light_meters_factor_from_the_stations_own_file(
    three_beds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SURFRAD, Alamosa, 2016-01-01, as published; the record names the file and its checksum."""
    file = shared("data/weather/slv16001.dat")
    monkeypatch.chdir(file.parent)
    found = watts_per_lux(three_beds, "--station", file.name, "--name", "surfrad")
    assert 1.0 / found["value"] == pytest.approx(BOTH_LM_W, abs=1.5)
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (three_beds, file)]
    assert [source["sha256"] for source in found["sources"]] == sums
    other_day = fieldkit("calibrate", "irradiance", three_beds, "--station", "slv15365.dat", code=3)
    assert "of another day" in other_day.output
    elsewhere = fieldkit("calibrate", "irradiance", three_beds, "--station", "tbl17005.dat", code=3)
    assert "40.125, -105.237" in elsewhere.output  # where Table Mountain stands


@pytest.fixture
def receiver() -> Iterator[str]:
    """A gpsd whose receiver is 27.5 s ahead of this computer; the address it listens at."""

    def serve() -> None:
        with suppress(OSError), server.accept()[0] as connection:  # until the recording hangs up
            while True:
                ahead = datetime.now(UTC) + timedelta(seconds=27.5)
                place = {"class": "TPV", "mode": 3, "lat": 37.7, "lon": -105.92, "alt": 2317.0}
                connection.sendall(json.dumps({**place, "time": ahead.isoformat()}).encode() + b"\n")
                time.sleep(0.2)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        yield f"127.0.0.1:{server.getsockname()[1]}"


def test_the_clock_against_a_receiver_and_applied(receiver: str, tmp_path: Path) -> None:
    gps = f'[device.gps]\ndriver = "gpsd"\nport = "{receiver}"\n'
    (tmp_path / "fieldkit.toml").write_text(
        campaign_toml({"site": SIMULATED["site"]}) + gps, encoding="utf-8"
    )
    fieldkit("record", "-C", tmp_path, "--for", "4s", "--name", "fix")
    session = next(tmp_path.glob("recordings/*fix.h5"))
    found = json.loads(fieldkit("calibrate", "clock", session, "--gps", "gps", "--apply", "--json").stdout)
    assert found["value"] == pytest.approx(27.5, abs=0.5)
    assert found["expanded_uncertainty"] == pytest.approx(
        0.8, abs=0.1
    )  # a receiver's sentences: 0.4 s, k = 2
    with open_session(session) as opened:
        moved_ns = opened.times_ns("gps") - opened.stream("gps").time_ns()
    assert moved_ns == pytest.approx(found["value"] * 1e9, abs=1e6)
    refused = fieldkit("calibrate", "clock", session, "--gps", "watch", code=3)
    assert "watch" in refused.output


def test_the_clock_against_the_sun_and_applied(three_beds: Path, tmp_path: Path) -> None:
    """An hour wrong, as a forgotten daylight saving time would be."""
    wrong = rewritten(
        three_beds, tmp_path / "wrong.h5", lambda one: replace(one, time_ns=one.time_ns - 3_600_000_000_000)
    )
    found = json.loads(fieldkit("calibrate", "clock", wrong, "--sun", "--json").stdout)
    assert found["value"] == pytest.approx(3600.0, abs=max(600.0, 2 * found["expanded_uncertainty"]))
    with open_session(wrong) as session:
        recorded = session.start_ns
    fieldkit("calibrate", "clock", wrong, "--sun", "--apply", "--name", "again")
    with open_session(wrong) as session:
        assert next(session.samples()).time_ns - recorded == pytest.approx(found["value"] * 1e9, abs=1e9)


def test_a_phones_time(beds: Path) -> None:
    told = (datetime.now(UTC) + timedelta(seconds=90)).isoformat()
    found = json.loads(fieldkit("calibrate", "clock", "-C", beds, "--told", told, "--json").stdout)
    assert found["value"] == pytest.approx(90.0, abs=5.0)


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
            samples.append(replace(frame, time_ns=at, mono_ns=at, counts=counts))
    write_foreign(to, header, Foreign(header.streams, samples), str(source))
    return to


def _frames(samples: Iterator[Sample], count: int) -> Iterator[Frame]:
    for _ in range(count):
        frame = next(samples)
        assert isinstance(frame, Frame)
        yield frame


def test_a_board_before_and_after_gives_offsets_drift_and_a_record_that_corrects(
    beds: Path, three_beds: Path, tmp_path: Path
) -> None:
    first = uniform(three_beds, tmp_path / "before.h5", {"b15": 0.31, "b25": -0.20})
    second = uniform(three_beds, tmp_path / "after.h5", {"b15": 0.41, "b25": -0.20}, hours_later=2.0)
    found = json.loads(fieldkit("calibrate", "uniformity", first, second, "--name", "board", "--json").stdout)
    assert found["values"]["b15"] == pytest.approx(0.36, abs=0.02)
    assert found["values"]["b25"] == pytest.approx(-0.20, abs=0.02)
    assert found["details"]["drift_k_per_h"]["b15"] == pytest.approx(0.05, abs=0.005)
    assert found["uncertainties"]["b15"] > found["uncertainties"]["b05"]
    three = tomllib.loads((beds / "fieldkit.toml").read_text())["region"]
    regions = [{**one, "offset_k": "@board"} if one["name"] == "b15" else one for one in three]
    config = tmp_path / "fieldkit.toml"
    config.write_text(campaign_toml({**SIMULATED, "region": regions}), encoding="utf-8")
    from fieldkit.config import load_config

    assert load_config(config).estimator_settings().offsets_k == {"b15": pytest.approx(0.36, abs=0.02)}


def test_what_is_no_uniform_target_is_refused(three_beds: Path, tmp_path: Path) -> None:
    session = tmp_path / "beds.h5"
    session.write_bytes(three_beds.read_bytes())
    assert "did not see one target" in fieldkit("calibrate", "uniformity", session, code=8).output
