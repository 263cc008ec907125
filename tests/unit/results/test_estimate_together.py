"""Sessions joined: from Python and from the command line, what is printed, written and left as it was."""

import csv
import json
import shutil
from types import MappingProxyType

import pytest

import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.time_map import TimeStep
from tests.harness import command_line

DAY_NS = 86_400_000_000_000
SITE = "35.558675,139.395232,9"


@pytest.fixture
def days(sessions, tmp_path):
    """A session, and the other as if recorded a day later."""
    later = tmp_path / shutil.copy(sessions[1], tmp_path / "later.h5")
    apply_time_map(later, [TimeStep(0, DAY_NS, "another clock")])
    return [later, sessions[0]]


def typed(*arguments):
    return command_line.fieldkit("estimate", *arguments)


def test_one_slope_of_each_region_by_all_sessions_in_files_of_their_own(days, tmp_path):
    before = [path.read_bytes() for path in days]
    steps = []
    found = fieldkit.estimate_together(days, albedo=0.21, on_progress=lambda *step: steps.append(step))
    assert found.sessions == [path.resolve() for path in reversed(days)]
    assert list(found.final) == ["b05", "b15", "b25"]
    assert found["b15"].n_bins == found.minutes == 22
    assert repr(found).startswith("<Estimates of 22 min: b05 ")
    assert {one.name for one in found.learnt.final.parameters} >= {"gain", "exchange"}
    assert steps == [(1, 3), (2, 3), (3, 3)]
    written = found.write(tmp_path / "joined")
    assert {path.stem for path in written} == {"joined", "joined-learnt", "joined-budget"}
    with (tmp_path / "joined.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["region"], row["minutes"]) for row in rows] == [(name, "22") for name in found.final]
    about = json.loads((tmp_path / "joined.json").read_text())
    assert [one["path"] for one in about["sessions"]] == [str(path) for path in found.sessions]
    assert (about["together"], about["settings"]) == (True, ["surface.albedo=0.21"])
    with (tmp_path / "joined-budget.csv").open() as file:
        assert {row["region"] for row in csv.DictReader(file)} == set(found.final)
    assert [path.read_bytes() for path in days] == before


def test_the_command_prints_the_slopes_and_names_the_sessions(days):
    done = typed(*days, "--together")
    assert done.exit_code in (0, 8), done.output
    assert "b25" in done.stdout
    assert f"{days[0]} {days[1]} --together -o " in done.stderr
    document = json.loads(typed(*days, "--together", "--json").stdout)
    assert document["together"] == [str(path.resolve()) for path in reversed(days)]
    assert [one["minutes"] for one in document["slopes"]] == [22, 22, 22]


def test_a_session_of_two_days_is_joined_as_two_sessions_are(days, tmp_path):
    samples = []
    for path in reversed(days):
        with open_session(path) as session:
            header = session.header
            samples += [one._replace(mono_ns=one.time_ns) for one in session.samples()]
    recording = ImportedRecording(header.streams, samples)
    write_imported(tmp_path / "both.h5", header, recording, "two sessions")
    both, apart = fieldkit.estimate_together([tmp_path / "both.h5"]), fieldkit.estimate_together(days)
    assert both["b15"].n_bins == apart["b15"].n_bins == 22
    assert both["b15"].tilt_deg == pytest.approx(apart["b15"].tilt_deg, abs=0.5)


def test_sessions_of_the_same_minutes_are_refused_by_name(sessions):
    done = typed(*sessions, "--together")
    assert done.exit_code == 3
    assert f"{sessions[1].resolve()}: " in done.stderr.replace("\n", "")
    assert done.stdout == ""


def test_one_session_or_another_model_cannot_be_joined(days):
    with pytest.raises(ConfigError, match="two hours"):
        fieldkit.estimate_together(days[:1])
    with pytest.raises(ConfigError, match=r'estimator\.model = "learned"') as refused:
        fieldkit.estimate_together(days, model="full")
    assert "estimator.model" in refused.value.fix
    assert typed(*days, "--together", "-j", 2).exit_code == 2


TEMPERATURES = MappingProxyType({0: (325.2, 323.6), 5: (325.1, 323.5), 10: (325.0, 323.45)})


def table(path, day):
    """Kelvin of a bed and a level reference about noon."""
    rows = [
        f"2017-08-{day}T12:{minute:02d}:00+09:00,{reference},{bed},800"
        for minute, (bed, reference) in TEMPERATURES.items()
    ]
    path.write_text("\n".join(["time,reference_k,bed_k,irradiance_w_m2", *rows]))
    return path


def test_tables_are_joined_by_the_same_option(tmp_path):
    paths = [table(tmp_path / f"{day}.csv", day) for day in (29, 30)]
    done = typed(*paths, "--together", "--site", SITE, "--json")
    assert done.exit_code in (0, 8), done.output
    document = json.loads(done.stdout)
    assert document["together"] == list(map(str, paths))
    assert [(one["region"], one["minutes"]) for one in document["slopes"]] == [("bed", 6)]
    twice = typed(paths[0], table(tmp_path / "again.csv", 29), "--together", "--site", SITE)
    assert twice.exit_code == 3
    assert "begins at 2017-08-29 03:00 UTC" in twice.stderr.replace("\n", " ")
