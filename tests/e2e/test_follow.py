"""Followers report what is added to a session while it is recorded, however slow the computer."""

import json
import multiprocessing
import subprocess
import sys
import time
from pathlib import Path

from fieldkit.config.template import SIMULATED
from fieldkit.model.samples import Quality
from fieldkit.recording.campaign import create_campaign
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import fieldkit, program
from tests.harness.recording import STREAMS, Counters, header, record_until_killed, same, sample, started
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


# --- a second process reads along for a whole session: nothing wrong, nothing shrinking, never an exception


FRAMES, RATE_HZ, LOOKS = 500, 100.0, 10


def read_along(path: Path, counters: Path, result: Path) -> None:
    """Ten times a second: what is new, checked against what was recorded; what was seen goes into a file.

    The recording is asked to close when enough has been seen of it.
    """
    seen = dict.fromkeys(STREAMS, 0)
    ages_s: list[float] = []
    looks = 0
    with open_session(path) as session:
        assert session.state == "recording"
        while is_locked(journal_path(path)):
            time.sleep(0.1)  # at its own pace, as a reader that nobody wakes
            session.refresh()
            looks += 1
            for name in STREAMS:
                count = session.count(name)
                assert count >= seen[name], f"{name} shrank"
                for item in session.stream(name).samples(seen[name], count):
                    assert not item.quality & Quality.BAD_CRC
                    assert same(item, sample(header().stream(name), item.seq, item.mono_ns, item.time_ns))
                    if name == "camera":
                        ages_s.append((time.monotonic_ns() - item.mono_ns) / 1e9)
                seen[name] = count
            session.events()
            if looks >= LOOKS and seen["camera"] >= FRAMES and Counters(counters).stage == 1:
                Counters(counters).stage = 2
    ages_s.sort()
    middle, worst = ages_s[len(ages_s) // 2], ages_s[-1]
    result.write_text(json.dumps({"seen": seen, "looks": looks, "median_s": middle, "worst_s": worst}))


def test_reader_in_another_process_follows_a_recording(tmp_path):
    path, counters, result = tmp_path / "field.h5", tmp_path / "counters", tmp_path / "result"
    recorder = started(record_until_killed, path, counters, 200 * FRAMES, RATE_HZ, counters=counters, stage=1)
    reader = multiprocessing.get_context("spawn").Process(target=read_along, args=(path, counters, result))
    reader.start()
    reader.join(PATIENCE_S)
    if reader.exitcode != 0:
        Counters(counters).stage = 2
    recorder.join(PATIENCE_S)
    assert reader.exitcode == 0
    assert Counters(counters).stage == 3
    found = json.loads(result.read_text())
    assert found["seen"]["camera"] >= FRAMES
    assert found["looks"] >= LOOKS
