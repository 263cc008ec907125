"""``fieldkit show --follow`` tells what is added to a session while it is recorded."""

from __future__ import annotations

import json
import subprocess
import sys
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
