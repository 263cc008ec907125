"""Followers report what is added to a session while it is recorded, however slow the computer."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.harness.recording import PATIENCE_S, Counters, record_until_killed, started
from tests.harness.waiting import wait_until

PROGRAM = [sys.executable, "-m", "fieldkit"]
FOLLOW = "from fieldkit.cli.show import command; import sys; command.main(sys.argv[1:])"
ENOUGH_FRAMES = 100_000  # more than are recorded before it is asked to close


def test_follower_sees_samples_arrive_until_the_end(tmp_path: Path) -> None:
    path, counters = tmp_path / "field.h5", tmp_path / "counters"
    recorder = started(record_until_killed, path, counters, ENOUGH_FRAMES, 100.0, counters=counters, stage=1)
    words = [sys.executable, "-c", FOLLOW, str(path), "--follow", "--json"]
    told = []
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as follower:
        assert follower.stdout is not None
        for line in follower.stdout:
            told.append(json.loads(line))
            if sum(one.get("stream") == "camera" for one in told) >= 2:
                Counters(counters).stage = 2
        _, errors = follower.communicate()
    recorder.join(PATIENCE_S)
    assert follower.returncode == 0, errors
    cameras = [one["samples"] for one in told if one.get("stream") == "camera"]
    assert cameras == sorted(cameras)
    assert len(cameras) >= 2
    assert {one["unit"] for one in told if one.get("stream") == "lux"} == {"lx"}
    assert "the recording has ended" in errors


def test_map_follows_a_recording_and_leaves_it_alone(tmp_path: Path) -> None:
    made = subprocess.run([*PROGRAM, "init", "--simulated", tmp_path], capture_output=True, check=False)
    assert made.returncode == 0, made.stderr
    words = [*PROGRAM, "record", "-C", tmp_path, "--for", "3h", "-q", "--set", "simulation.speed=20"]
    maps: list[int] = []
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as recorder:
        recordings = tmp_path / "recordings"
        wait_until(lambda: list(recordings.glob("*.journal")), "the recording did not begin", PATIENCE_S)
        words = [*PROGRAM, "map", "-C", str(tmp_path), "--follow", "--json"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as follower:
            assert follower.stdout is not None
            for line in follower.stdout:
                maps.append(json.loads(line)["minutes"])
                if len(set(maps)) == 2 and len(set(maps[:-1])) == 1:  # once: the last map may have as many
                    subprocess.run([*PROGRAM, "stop", "-C", tmp_path], capture_output=True, check=True)
            _, errors = follower.communicate()
        _, said = recorder.communicate()
    assert recorder.returncode == 0, said
    assert follower.returncode == 0, errors
    assert "the recording has ended" in errors
    assert maps == sorted(maps)
    words = [*PROGRAM, "map", "-C", str(tmp_path), "--json"]
    whole = subprocess.run(words, capture_output=True, text=True, check=True)
    assert maps[-1] == json.loads(whole.stdout)["minutes"]
    assert not list((tmp_path / "results").rglob("*.new"))
