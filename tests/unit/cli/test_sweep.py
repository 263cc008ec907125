"""``fieldkit sweep`` and ``fieldkit estimate`` over several sessions."""

import csv
import hashlib
import json
import re
import shutil
from collections import defaultdict
from pathlib import Path
from statistics import fmean

import pytest
from pyarrow import parquet

from fieldkit import __version__
from fieldkit.model.errors import ConfigError
from fieldkit.results.minutes import solve
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.two_sessions import copy_of_both

GRID = ("--set", "surface.albedo=0.15:0.25:0.05", "--set", "surface.emissivity=0.88,0.90")
PAPER = ("--set", "estimator.model=paper")
"""Where it is the sweep that counts: a tenth of the time of the learned model."""
SWEEP = ("sweep", *GRID, *PAPER)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return copy_of_both(tmp_path_factory, tmp_path_factory.mktemp("sweep")) / "recordings"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def swept(recordings, tmp_path_factory):
    """A folder with the sweep `results/r` of all recordings, its `cache`, and what it `printed`."""
    folder = tmp_path_factory.mktemp("swept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        printed = succeed(*SWEEP, recordings, "-j", 1, "-o", folder / "results" / "r", "--json").stdout
    (folder / "printed").write_text(printed, "utf-8")
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_sweep_has_a_row_for_each_session_set_and_bed(swept):
    table = rows(swept / "results" / "r.csv")
    assert len(table) == 2 * 6 * 3
    assert table[0]["session"].endswith("-s1")
    assert {row["surface.albedo"] for row in table} == {"0.15", "0.2", "0.25"}
    tilts = {"b05": "5.0", "b15": "15.0", "b25": "25.0"}
    assert {(row["region"], row["true_tilt_deg"]) for row in table} == set(tilts.items())
    b15 = [row for row in table if (row["region"], row["surface.emissivity"]) == ("b15", "0.9")]
    darkest, darker, dark = (float(row["median_tilt_deg"]) for row in b15[:3])
    # of the same heat a whiter bed must have had more sun: tilt grows with the albedo assumed
    assert darkest < darker < dark


def test_the_row_of_a_set_is_what_estimate_gives_with_it(recordings, swept, tmp_path):
    settings = ("--set", "surface.albedo=0.25", "--set", "surface.emissivity=0.88", *PAPER)
    succeed("estimate", recordings, *settings, "-j", 1, "-o", tmp_path / "one.csv")
    solved = ("ok", "flat", "wide", "not_resolved")
    b25 = [row for row in rows(tmp_path / "one.csv") if (row["session"][-2:], row["region"]) == ("s2", "b25")]
    minutes = [row for row in b25 if row["state"] in solved]
    errors = [float(row["tilt_deg"]) - 25.0 for row in minutes]
    table = rows(swept / "results" / "r.csv")
    of_set = [row for row in table if (row["surface.albedo"], row["surface.emissivity"]) == ("0.25", "0.88")]
    (row,) = (row for row in of_set if (row["session"][-2:], row["region"]) == ("s2", "b25"))
    assert int(row["answered"]) == len(errors) > 0
    assert int(row["wide"]) == sum(minute["state"] == "wide" for minute in minutes) > 0
    assert float(row["mean_abs_error_deg"]) == pytest.approx(sum(map(abs, errors)) / len(errors), abs=1e-12)
    assert float(row["worst_abs_error_deg"]) == max(map(abs, errors))


def test_again_gives_the_same_bytes_from_the_cache_or_afresh_by_one_process_or_two(
    recordings, swept, tmp_path, monkeypatch
):
    fresh = {path.name: path.read_bytes() for path in (swept / "results").iterdir()}
    for jobs, cache, known in ((1, swept / "cache", 12), (2, tmp_path / "other", 0)):
        monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
        folder = tmp_path / str(jobs)
        found = succeed("sweep", recordings, *GRID, *PAPER, "-j", jobs, "-o", folder / "r")
        assert f" {known} of them" in found.stderr
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == fresh


def test_a_value_that_solves_few_minutes_is_not_ranked(recordings, tmp_path):
    few = ("--set", "estimator.model=paper", "--set", "estimator.min_minutes=3,8")
    found = fieldkit("sweep", recordings, *few, "-j", 1, "-o", tmp_path / "r")
    assert re.search(r"estimator\.min_minutes +3: \d+\.\d°  8: not ranked", found.stdout), found.output
    assert "nan" not in found.stdout
    assert "NaN" not in (tmp_path / "r.json").read_text("utf-8")


def checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_provenance_names_content_and_code(recordings, swept):
    about = json.loads((swept / "results" / "r.json").read_text("utf-8"))
    assert about["schema"] == 1
    assert about["parameters"] == {
        "surface.albedo": ["0.15", "0.20", "0.25"],
        "surface.emissivity": ["0.88", "0.90"],
        "estimator.model": ["paper"],
    }
    paths = sorted(recordings.glob("*.h5"))
    assert [session["sha256"] for session in about["sessions"]] == [checksum(path) for path in paths]
    assert about["files"]["r.csv"] == checksum(swept / "results" / "r.csv")
    assert about["code_version"].startswith(f"{__version__}+")
    assert {"command_line", "python", "platform", "packages", "ranking"} <= set(about)


def test_parquet_is_the_same_table(swept):
    table = parquet.read_table(swept / "results" / "r.parquet").to_pylist()
    assert [{k: str(v) for k, v in row.items()} for row in table] == rows(swept / "results" / "r.csv")


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("surface.albdo=0.1,0.2", r"albedo\?"),
        ("surface.albedo=0.1,1.2", "1.2"),
        ("record.every_s=30,60", "record.every_s"),
        ("simulation.albedo=0.1,0.2", "simulation.albedo"),
    ],
)
def test_values_that_cannot_be_are_refused_before_anything_runs(recordings, cache, setting, said):
    with pytest.raises(ConfigError, match=said):
        invoke("sweep", recordings, "--set", setting)
    assert not cache.exists()


def test_a_corrupt_session_among_others_is_told_and_the_others_are_done(recordings, tmp_path):
    folder = tmp_path / "three"
    shutil.copytree(recordings, folder)
    whole = next(recordings.glob("*.h5")).read_bytes()
    (folder / "torn.h5").write_bytes(whole[: len(whole) // 3])
    found = fieldkit("sweep", folder, *GRID[:2], *PAPER, "-j", 1, "-o", tmp_path / "r")
    assert found.exit_code == 3
    assert "torn.h5" in found.stderr
    assert "1 of 3 sessions" in found.stderr
    assert len({row["session"] for row in rows(tmp_path / "r.csv")}) == 2
    (problem,) = json.loads((tmp_path / "r.json").read_text("utf-8"))["problems"]
    assert problem["path"].endswith("torn.h5")


def test_damaged_pictures_of_a_session_are_left_out_and_told(recordings, tmp_path):
    folder = tmp_path / "two"
    shutil.copytree(recordings, folder)
    torn = sorted(folder.glob("*.h5"))[1]
    with open_session(torn) as session:
        block = session.group("camera")["counts"].id.get_chunk_info(1)
    with torn.open("r+b") as file:
        file.seek(block.byte_offset)
        file.write(b"\xaa" * block.size)
    found = fieldkit("estimate", folder, *PAPER, "-j", 1, "-o", tmp_path / "r")
    assert found.exit_code == 7
    assert re.search(f"{torn}: .* 1 minutes", found.stderr)
    assert "1 of 2 sessions" in found.stderr
    table = [row for row in rows(tmp_path / "r.csv") if row["session"].endswith("s2")]
    damaged = [row["temperature_k"] for row in table if "bad_crc" in row["flags"]]
    assert (
        damaged == [""] * 3
    )  # a minute of three beds, the burst of a chunk: nothing rather than the filling of a lost block
    assert fieldkit("estimate", torn, *PAPER).exit_code == 7


def test_a_sweep_that_was_stopped_goes_on(recordings, tmp_path, monkeypatch):
    real, count = solve, 0

    def stopped_after_five(*arguments):
        nonlocal count
        count += 1
        if count > 5:
            raise KeyboardInterrupt
        return real(*arguments)

    # a real Ctrl-C comes after no known number of runs
    monkeypatch.setattr("fieldkit.results.minutes.solve", stopped_after_five)
    found = fieldkit("sweep", recordings, *GRID, *PAPER, "-j", 1, "-o", tmp_path / "r")
    assert found.exit_code == 130
    monkeypatch.setattr("fieldkit.results.minutes.solve", real)
    found = succeed("sweep", recordings, *GRID, *PAPER, "-j", 1, "-o", tmp_path / "r")
    assert " 5 of them" in found.stderr


def test_best_parameters_and_their_worth_are_told(swept):
    ranking = json.loads((swept / "printed").read_text("utf-8"))["ranking"]
    assert ranking["sessions"] == 2
    assert set(ranking["sensitivity"]) == {"surface.albedo", "surface.emissivity"}
    table = rows(swept / "results" / "r.csv")
    by_set = defaultdict(list)
    for row in table:
        by_set[row["set"]].append(float(row["median_abs_error_deg"]))
    # each session has three beds: the mean over sessions of their means is that of all
    assert ranking["error_deg"] == pytest.approx(min(map(fmean, by_set.values())), abs=1e-12)


def test_estimate_of_many_prints_each_once_and_keeps_every_minute(recordings, tmp_path):
    named_twice = min(recordings.glob("*.h5"))
    found = succeed("estimate", named_twice, recordings, *PAPER, "-j", 1, "-o", tmp_path / "base")
    assert len(json.loads((tmp_path / "base.json").read_text("utf-8"))["sessions"]) == 2
    assert [line for line in found.stdout.splitlines() if line.endswith(("-s1", "-s2"))]
    table = rows(tmp_path / "base.csv")
    assert {row["session"][-2:] for row in table} == {"s1", "s2"}
    assert {"time", "region", "tilt_deg", "flags", "temperature_k", "irradiance_w_m2"} <= set(table[0])
    documents = document("estimate", recordings, *PAPER, "-j", 1)["sessions"]
    assert [len(found["slopes"]) for found in documents] == [3, 3]
    assert {found["minutes"] for found in documents} <= {11, 12}  # eleven, and what began of the next
