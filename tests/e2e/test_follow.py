"""Followers report what is added to a session while it is recorded, however slow the computer."""

import json
import subprocess
import sys

from fieldkit.config.template import SIMULATED
from fieldkit.recording.campaign import create_campaign
from tests.harness.command_line import fieldkit, program
from tests.harness.recording import Counters, record_until_killed, started
from tests.harness.seldom import SET_SELDOM
from tests.harness.waiting import PATIENCE_S, wait_until

RECORD = ("record", "--for", "1h", "-q", "--set", "simulation.speed=30", *SET_SELDOM)
FOLLOW = "from fieldkit.cli.show import command; import sys; command.main(sys.argv[1:])"
ENOUGH_FRAMES = 100_000  # more than are recorded before it is asked to close


def test_follower_sees_samples_arrive_until_the_end(tmp_path):
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
    assert "ended" in errors


def test_map_follows_a_recording_and_leaves_it_alone(tmp_path):
    create_campaign(tmp_path, SIMULATED)
    maps: list[int] = []
    with program(*RECORD, "-C", tmp_path, stdout=None) as recorder:
        recordings = tmp_path / "recordings"
        wait_until(lambda: list(recordings.glob("*.journal")), "the recording did not begin", PATIENCE_S)
        with program("map", "-C", tmp_path, "--follow", "--json") as follower:
            assert follower.stdout is not None
            for line in follower.stdout:
                maps.append(json.loads(line)["minutes"])
                if len(set(maps)) == 2 and len(set(maps[:-1])) == 1:  # once: the last map may have as many
                    recorder.terminate()  # as fieldkit stop does
            _, errors = follower.communicate()
        if follower.returncode:
            recorder.kill()  # which nothing else would end
        _, said = recorder.communicate()
    assert follower.returncode == 0, errors
    assert recorder.returncode == 0, said
    assert "ended" in errors
    assert maps == sorted(maps)
    assert maps[-1] == json.loads(fieldkit("map", "-C", tmp_path, "--json").stdout)["minutes"]
    assert not list((tmp_path / "results").rglob("*.new"))
