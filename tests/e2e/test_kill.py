"""A recording process killed at any moment loses nothing that it had stored."""

import random
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest

from fieldkit.model.samples import Quality
from fieldkit.recording.recordings import is_interrupted
from fieldkit.sessions.check import check
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import Outcome, recover
from tests.harness.recording import (
    STREAMS,
    Counters,
    apply_until_killed,
    header,
    kill,
    record_until_killed,
    recorded,
    recover_until_killed,
    same,
    sample,
    started,
)

RATE_HZ = 200.0
FEW, MANY = range(2), range(2, 200)
PROJECT = Path(__file__).parents[2]


def trials(few: range, many: range) -> list[object]:
    return [*few, *(pytest.param(n, marks=pytest.mark.slow) for n in many)]


def stored_counts(counters: Path) -> dict[str, int]:
    counted = Counters(counters)
    return {name: counted[number] for number, name in enumerate(STREAMS)}


def check_complete(path: Path, stored: dict[str, int]) -> None:
    """Every stored sample is there, with the right content, and at most the one in flight besides."""
    with open_session(path) as session:
        for name in STREAMS:
            info = header().stream(name)
            found = list(session.stream(name).samples())
            assert stored[name] <= len(found) <= stored[name] + 1
            for seq, item in enumerate(found):
                assert same(item, sample(info, seq, item.mono_ns, item.time_ns))


def killed_recording(tmp_path: Path, delay_s: float, *, frames: int = 10_000, stage: int = 1) -> Path:
    path, counters = tmp_path / "field.h5", tmp_path / "counters"
    process = started(record_until_killed, path, counters, frames, RATE_HZ, counters=counters, stage=stage)
    time.sleep(delay_s)  # the moment of the kill is what is tried
    kill(process)
    return path


@pytest.mark.parametrize("trial", trials(FEW, MANY))
def test_killed_recording_is_recovered_to_the_last_stored_sample(tmp_path, trial):
    path = killed_recording(tmp_path, random.Random(trial).uniform(0.02, 1.2))
    stored = stored_counts(tmp_path / "counters")
    # Without recovery: what another program sees, and what is missing from it.
    with h5py.File(path, "r", swmr=True) as file:
        in_file = min(file["camera"][name].shape[0] for name in ("time", "counts", "crc32"))
    assert stored["camera"] - in_file <= 2.0 * RATE_HZ
    with open_session(path) as session:
        assert session.state == "interrupted"
        assert not any(item.quality & Quality.BAD_CRC for item in session.samples())
    report = recover(path)
    assert report.outcome is Outcome.COMPLETE
    assert not report.damage
    check_complete(path, stored)
    with open_session(path) as session:
        assert session.state == "recovered"
    assert not path.with_name("field.h5.journal").exists()


@pytest.mark.parametrize("trial", trials(range(2), range(2, 140)))
def test_recording_killed_while_it_begins_can_be_finished_or_leaves_nothing(tmp_path, trial):
    path = killed_recording(tmp_path, random.Random(trial).uniform(0.0, 0.25), stage=0)
    if path.exists() or path.with_name("field.h5.journal").exists():
        assert recover(path).outcome is Outcome.COMPLETE
    assert not is_interrupted(path)
    if path.exists():
        check_complete(path, stored_counts(tmp_path / "counters"))
    assert not path.with_name("field.h5.journal").exists()


@pytest.mark.parametrize("trial", trials(range(2), range(2, 50)))
def test_recovery_killed_at_any_moment_can_be_run_again(tmp_path, trial):
    path = killed_recording(tmp_path, 0.3)
    stored = stored_counts(tmp_path / "counters")
    again = tmp_path / "again"
    process = started(recover_until_killed, path, again, counters=again, stage=1)
    time.sleep(random.Random(trial).uniform(0.0, 0.25))  # likewise
    kill(process)
    assert recover(path).outcome is Outcome.COMPLETE
    check_complete(path, stored)
    assert sorted(item.name for item in tmp_path.glob("field*")) in (
        ["field.h5", "field.h5.crashed"],
        ["field.h5"],
    )


@pytest.mark.parametrize("trial", trials(range(2), range(2, 50)))
def test_closing_killed_at_any_moment_can_be_finished(tmp_path, trial):
    path = killed_recording(tmp_path, random.Random(trial).uniform(0.0, 0.12), frames=40, stage=2)
    assert recover(path).outcome is Outcome.COMPLETE
    check_complete(path, {"camera": 40, "lux": 4, "thermometer": 4})


@pytest.mark.parametrize("trial", trials(range(2), range(2, 60)))
def test_correcting_the_times_killed_at_any_moment_leaves_the_session_sealed(tmp_path, trial):
    path, counters = tmp_path / "field.h5", tmp_path / "counters"
    recorded(path, header((24, 32)), 40)
    process = started(apply_until_killed, path, counters, counters=counters, stage=1)
    time.sleep(random.Random(trial).uniform(0.0, 0.1))  # likewise
    kill(process)
    with open_session(path) as session:
        assert session.state == "sealed"
        assert [step.add_ns for step in session.time_map()] in ([], [10**9, 2 * 10**9])
        assert session.count("camera") == 40
    assert not any(finding.level == "fail" and finding.what == "file" for finding in check(path))


UNCLOSED = """
import sys, time
from pathlib import Path
from fieldkit.sessions import session_file
from tests.harness.recording import HostClock, SessionWriter, header, sample
session_file.FLUSH_EVERY_S = 0.0  # the file's thread is nearly always inside the HDF5 library
head, clock = header(), HostClock()
writer = SessionWriter(Path(sys.argv[1]), head, clock)
until = time.monotonic() + float(sys.argv[2])
while time.monotonic() < until:
    writer.append(sample(head.streams[0], 0, clock.mono_ns()))
raise KeyboardInterrupt
"""


@pytest.mark.parametrize("trial", trials(range(2), range(2, 60)))
def test_process_that_ends_without_closing_ends_and_leaves_the_session_to_recovery(tmp_path, trial):
    path, delay_s = tmp_path / "field.h5", random.Random(trial).uniform(0.05, 0.3)
    command = [sys.executable, "-c", UNCLOSED, str(path), str(delay_s)]
    done = subprocess.run(command, cwd=PROJECT, timeout=500, capture_output=True, check=False)
    assert b"KeyboardInterrupt" in done.stderr
    report = recover(path)
    assert report.outcome is Outcome.COMPLETE
    assert not report.damage
