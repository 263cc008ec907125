"""Sessions of other minor versions are read, and no shape of a header ends in a stack trace."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result

from fieldkit.cli import check as check_verb
from fieldkit.cli import estimate, export, ls, report, show
from fieldkit.model.errors import ConfigError, FormatError, SessionError
from fieldkit.model.samples import Event, EventKind, Sample, Severity
from fieldkit.model.site import RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.results.check import check as checked
from fieldkit.sessions.check import check
from fieldkit.sessions.file_tree import LIBVER, put_columns, put_rows
from fieldkit.sessions.layout import SEALED, Column
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.log import Kind, LogWriter, session_number
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import MinuteRecord
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.seal import seal
from fieldkit.sessions.writer import SessionWriter
from tests.harness.faults import change_header, small_session
from tests.harness.recording import CountedClock, fill, header, same

NEW_KIND, NEW_STATE = EventKind(77), SlopeState(200)
LATER_CONFIG = """
[site]
latitude_deg = 35.56
longitude_deg = 139.4
geoid_m = 36.7
[drone]
height_m = 30
"""


def run(module: Any, *words: object) -> Result:
    return CliRunner().invoke(module.command, [str(word) for word in words])


def rewritten(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """The header with something else in it, and the session sealed with that."""
    with h5py.File(path, "r+", libver=LIBVER) as file:
        change_header(file, change)
    with open_session(path) as session:
        checksums = {name: session.stream(name).column("crc32").tolist() for name in session.streams}
    seal(path, checksums, SEALED)


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    path, clock = tmp_path_factory.mktemp("sealed") / "field.h5", CountedClock()
    writer = SessionWriter(path, header((24, 32)), clock)
    fill(writer, 10, clock)
    now = clock.mono_ns()
    time_ns = clock.to_utc_ns(now)
    writer.put(Event(NEW_KIND, now, time_ns, "the drone came back", "camera", Severity(9), {"height": [1]}))
    slope = SlopeEstimate(time_ns, "b05", NEW_STATE, 5.0, 180.0, model="next")
    writer.put(MinuteRecord(time_ns, (slope,)))
    writer.close()
    return path


@pytest.fixture
def path(sealed, tmp_path):
    return Path(shutil.copy(sealed, tmp_path))


@pytest.fixture(scope="module")
def sealed_by_a_newer(sealed, tmp_path_factory):
    """A session of version 2.9: other kinds, states and fields, a column, a table and a group more."""
    path = Path(shutil.copy(sealed, tmp_path_factory.mktemp("newer")))
    with h5py.File(path, "r+", libver=LIBVER) as file:
        file.attrs["fieldkit_format_version"] = np.bytes_("2.9")
        for group, column in (("events", Column("weight", "<f8")), ("lux", Column("humidity", "<f4"))):
            put_columns(file[group], [column])
            put_rows(file[group], {column.name: np.ones(len(file[group]["time"]))})
        file.create_group("weather")["station"] = 3

    def change(plain: dict[str, Any]) -> None:
        plain["crew"] = ["two"]
        plain["config_toml"] = LATER_CONFIG
        plain["site"]["geoid_m"] = 36.7
        plain["streams"][0]["polarisation"] = "none"
        plain["regions"][1]["kind"] = 7

    rewritten(path, change)
    return path


@pytest.fixture
def newer(sealed_by_a_newer, tmp_path):
    return Path(shutil.copy(sealed_by_a_newer, tmp_path))


def of_version(path: Path, version: str) -> Path:
    """The session as another version of the format would have marked it; file and journal."""
    with h5py.File(path, "r+", libver=LIBVER) as file:
        file.attrs["fieldkit_format_version"] = np.bytes_(version)
    return path


@pytest.mark.parametrize(
    ("version", "step"), [("1.5", "recorded"), ("1.0", "recorded"), ("3.0", "pip install")]
)
def test_file_of_another_major_version_is_refused_at_the_door(path, version, step):
    whole = of_version(path, version).read_bytes()
    with pytest.raises(FormatError, match=re.escape(version)) as refused:
        open_session(path)
    assert (refused.value.exit_code, step in str(refused.value.fix)) == (3, True)
    (finding,) = check(path)
    assert (finding.level, finding.what, finding.fix) == ("fail", "file", refused.value.fix)
    with pytest.raises(FormatError, match=re.escape(version)):
        recover(path)
    assert path.read_bytes() == whole
    assert [name.name for name in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("version", ["1", "3.0"])
def test_journal_of_another_version_is_refused_and_left_as_it_is(tmp_path, version):
    part = journal_path(tmp_path / "cut.h5") / "000001.log"
    part.parent.mkdir()
    facts = [1, 2, 3, "boot", "an-id", 1, 2, header((24, 32)).to_json()]
    log = LogWriter(part, session_number("an-id"))
    head = facts if version == "1" else [version, *facts]
    log.append(Kind.IDENTITY, 0, (0, 0, 0, 0), json.dumps(head).encode())
    log.close()
    before = part.read_bytes()
    with pytest.raises(FormatError, match=f"format {version}"):
        recover(tmp_path / "cut.h5")
    assert part.read_bytes() == before


def test_kinds_states_and_fields_of_a_newer_version_are_kept(newer):
    with open_session(newer) as session:
        (event,) = (one for one in session.events() if one.kind == 77)
        assert (event.kind.name, event.severity, event.text) == ("UNKNOWN_77", 9, "the drone came back")
        (estimate_,) = session.estimates()
        assert (estimate_.state, estimate_.tilt_deg) == (200, 5.0)
        assert session.header.regions[1].kind not in (RegionKind.REFERENCE, RegionKind.TARGET)
        assert len(list(session.samples())) == 16
    assert [one.text for one in check(newer) if one.level == "fail"] == []


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        (show, ()), (ls, ()), (report, ()), (check_verb, ("--no-estimates",)),
        (export, ("--to", "csv")), (export, ("--to", "netcdf")), (export, ("--to", "mcap")),
        (export, ("--to", "png")),
    ],
)  # fmt: skip
def test_session_of_a_newer_version_is_shown_and_exported(newer, verb, options):
    result = run(verb, newer.parent if verb is ls else newer, *options)
    assert result.exit_code == 0, result.output
    if verb is show:
        assert "unknown_77" in result.stdout


def test_keys_of_a_newer_version_are_ignored_and_named(newer):
    (finding,) = (finding for finding in checked(newer).findings if finding.what == "config")
    assert (finding.level, {"site.geoid_m", "drone"} <= set(finding.text.replace(",", "").split())) == (
        "warn", True,
    )  # fmt: skip
    result = run(estimate, newer)
    assert not isinstance(result.exception, ConfigError | TypeError | KeyError | ValueError), result.exception


def content(path: Path) -> tuple[list[Sample], list[Any]]:
    with open_session(path) as session:
        tables = [
            session.header,
            session.region_schedule,
            session.marks(),
            session.time_map(),
            session.health(),
        ]
        return list(session.samples()), [*tables, session.minutes(), session.entries()]


@pytest.mark.parametrize(
    "stored",
    sorted((Path(__file__).parents[2] / "data" / "sessions").glob("*.h5")),
    ids=lambda path: path.stem,
)
def test_a_stored_session_of_every_version_is_read_as_one_of_today(stored, tmp_path):
    samples, tables = content(Path(shutil.copy(stored, tmp_path)))
    today_samples, today_tables = content(small_session(tmp_path / "today.h5"))
    assert all(same(one, other) for one, other in zip(samples, today_samples, strict=True))
    assert repr(tables) == repr(today_tables)  # NaN is NaN
    assert [finding.what for finding in check(tmp_path / stored.name) if finding.level == "fail"] == []


def test_what_an_earlier_version_did_not_have_is_filled(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        names = [name for name in file["integrity/object"][:].tolist() if name.split(b"/")[0] != b"learnt"]
        names.remove(b"camera/fpa_temperature")
        names.remove(b"estimates/n_bins")
        for name in ("learnt", "camera/fpa_temperature", "estimates/n_bins", "integrity/object"):
            del file[name]
        file["integrity/object"] = np.array(names)
    with open_session(path) as session:
        assert session.learnt() == {}
        assert [estimate.n_bins for estimate in session.estimates()] == [0]
        assert np.isnan(session.stream("camera").column("fpa_temperature")).all()


def _set(*keys: str | int, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(plain: Any) -> None:
        for key in keys[:-1]:
            plain = plain[key]
        plain[keys[-1]] = value

    return change


def _nested(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth):
        value = [value]
    return value


SHAPES = [
    _set("site", value=[]), _set("site", value=None), _set("site", "latitude_deg", value="north"),
    _set("streams", value={}), _set("streams", value=[7]), _set("streams", 0, value=None),
    _set("streams", 0, "name", value=["camera"]), _set("streams", 0, "shape", value=[24, "32"]),
    _set("streams", 0, "shape", value=24), _set("streams", 0, "shape", value=[0, 0]),
    _set("streams", 0, "shape", value=[24, 32, 1]), _set("streams", 0, "shape", value=[10**8, 10**8]),
    _set("streams", 1, "shape", value=[10**8]), _set("streams", 0, "metadata_shape", value=[10**8, 32]),
    _set("streams", 1, "raw_bytes", value=10**9), _set("streams", 0, "burst_frames", value=-1),
    _set("streams", 0, "scale", value={}),
    _set("streams", 0, "rate_hz", value=float("nan")), _set("streams", 0, "rate_hz", value=1e308 * 10),
    _set("streams", 0, "settings", value=[1]), _set("streams", 1, "raw_bytes", value=-5),
    _set("streams", 2, "channels", value=5), _set("regions", value=3), _set("regions", 0, value=[]),
    _set("regions", 0, "points_px", value=[[1], [2], [3]]), _set("regions", 0, "kind", value="bed"),
    _set("regions", 0, "kind", value=-1), _set("regions", 0, "emissivity", value=[]),
    _set("title", value={}), _set("config_toml", value=[]), _set("regions", value=_nested(40)),
]  # fmt: skip


@pytest.mark.parametrize("change", SHAPES)
def test_header_of_another_shape_is_a_finding(path, change):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        change_header(file, change)
    (finding,) = check(path)
    assert (finding.level, finding.what) == ("fail", "file")
    assert finding.fix
    result = run(show, path)
    assert result.exit_code != 0
    assert isinstance(result.exception, SessionError)


@pytest.mark.parametrize(
    "details",
    [
        *("{", '{"end_ns": 1e400}'),
        *(
            pytest.param(one, marks=pytest.mark.slow)
            for one in ("[1, 2]", '"text"', "7", "null", '{"end_ns": "noon"}', "[" * 900)
        ),
    ],
)
def test_details_of_another_shape_end_nothing(path, details):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        file["events/data"][-1] = details.encode()
    assert [one.what for one in check(path) if one.level == "fail"] == ["events/data"]
    for verb, options in ((show, ()), (export, ("--to", "csv")), (report, ())):
        result = run(verb, path, *options)
        assert result.exit_code == 0, (verb, result.output, result.exception)


def test_settings_of_another_shape_end_no_check(path):
    rewritten(path, _set("streams", 0, "settings", value={"emissivity": "shiny", "gain": [[]]}))
    findings = check(path)
    assert any(one.what == "camera" for one in findings)
