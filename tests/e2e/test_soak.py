"""A day of recording in accelerated time: nothing lost, memory flat."""

import json
import shutil

import pytest

from tests.harness.command_line import run_code
from tests.harness.disk import PROJECT

SOAK = """
import json, sys
from pathlib import Path
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

class WaitingClock(CountedClock):
    def hold_until(self, settled):
        self.settled = settled  # which the simulated clock waits for

def resident_mb():
    resident, shared = map(int, Path("/proc/self/statm").read_text().split()[1:3])
    return (resident - shared) * 4096 / 1e6

path, frames = Path(sys.argv[1]), int(sys.argv[2])
head = header()
clock = WaitingClock()
writer = SessionWriter(path, head, clock)
ready = [sample(head.streams[0], seq) for seq in range(64)]
memory, largest = [], 0
for seq in range(frames):
    frame = ready[seq % 64]
    writer.append(frame)
    if seq % 9 == 0:
        writer.append(sample(head.streams[1], seq // 9))
        writer.append(sample(head.streams[2], seq // 9))
    while not clock.settled(0.1):
        pass
    if seq % (frames // 20) == 0:
        memory.append(resident_mb())
        journal = sum(one.stat().st_size for one in journal_path(path).iterdir() if one.name != "reserve")
        largest = max(largest, journal)
report = writer.close()
print(json.dumps({"memory": memory, "counts": report.counts, "journal": largest}))
"""


@pytest.mark.parametrize("frames", [2000, pytest.param(24 * 3600 * 9, marks=pytest.mark.slow)])
def test_long_recording_loses_nothing_and_keeps_its_memory(tmp_path, frames):
    if shutil.disk_usage(tmp_path).free < frames * 40_000 + 2_000_000_000:
        pytest.skip("not enough room on this disk")
    found = json.loads(run_code(SOAK, tmp_path / "soak.h5", frames, cwd=PROJECT))
    meters = -(-frames // 9)
    assert found["counts"] == {"camera": frames, "lux": meters, "thermometer": meters}
    assert found["journal"] < 1_100_000_000
    if frames > 100_000:
        half = found["memory"][10:]
        assert max(half) - min(half) < 20
        assert (half[-1] - half[0]) / (frames / 9 / 3600 / 2) <= 0.2  # MB an hour


FLAT = """
import gc, json, sys
from pathlib import Path
import fieldkit
from fieldkit.config import load_config
from fieldkit.config.template import SIMULATED
from fieldkit.recording.campaign import create_campaign

memory = []

def look(minute):
    gc.collect()
    lines = Path("/proc/self/status").read_text().splitlines()
    memory.append(next(int(line.split()[1]) / 1000 for line in lines if line.startswith("RssAnon")))

folder, hours = Path(sys.argv[1]), int(sys.argv[2])
create_campaign(folder, SIMULATED)
config = load_config(folder / "fieldkit.toml", settings=["simulation.speed=max"])
fieldkit.record(config, duration=hours * 3600, on_minute=look)
print(json.dumps(memory))
"""


@pytest.mark.slow
def test_the_memory_of_a_recorder_that_estimates_grows_by_less_than_a_fifth_of_a_megabyte_an_hour(tmp_path):
    printed = run_code(FLAT, tmp_path / "sand", 24, cwd=PROJECT)
    memory = json.loads(printed)[6 * 60 :]  # by then all that has a bound has reached it
    assert (memory[-1] - memory[0]) / (len(memory) / 60) <= 0.2
