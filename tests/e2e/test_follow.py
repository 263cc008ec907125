"""``fieldkit show --follow`` tells what is added to a session while it is recorded."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

from tests.harness.recording import record_until_killed, started

FOLLOW = "from fieldkit.commands.show import command; import sys; command.main(sys.argv[1:])"


def test_follower_sees_samples_arrive_until_the_end(tmp_path: Path) -> None:
    path, counters = tmp_path / "field.h5", tmp_path / "counters"
    recorder = started(record_until_killed, path, counters, 400, 100.0, counters=counters, stage=1)
    words = [sys.executable, "-c", FOLLOW, str(path), "--follow", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    recorder.join(60)
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    cameras = [one["samples"] for one in told if one.get("stream") == "camera"]
    assert cameras == sorted(cameras)
    assert len(cameras) >= 2
    assert {one["unit"] for one in told if one.get("stream") == "lux"} == {"lx"}
    assert "the recording has ended" in done.stderr


def test_map_follows_a_recording_and_leaves_it_alone(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "fieldkit"]
    made = subprocess.run([*program, "init", "--simulated", tmp_path], capture_output=True, check=False)
    assert made.returncode == 0, made.stderr
    words = [*program, "record", "-C", tmp_path, "--for", "9m", "-q", "--set", "simulation.speed=20"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as recorder:
        deadline = time.monotonic() + 60
        while not list((tmp_path / "recordings").glob("*.journal")) and time.monotonic() < deadline:
            time.sleep(0.05)
        done = subprocess.run(
            [*program, "map", "-C", tmp_path, "--follow", "--json"],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )
        said = recorder.communicate(timeout=60)[1]
    assert recorder.returncode == 0, said
    assert done.returncode == 0, done.stderr
    assert "the recording has ended" in done.stderr
    maps = [json.loads(line)["minutes"] for line in done.stdout.splitlines()]
    assert maps == sorted(maps)
    assert len(set(maps)) >= 2
    assert maps[-1] == 9
    assert not list((tmp_path / "results").rglob("*.part"))
