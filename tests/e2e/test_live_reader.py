"""A second process reads along for a whole session: nothing wrong, nothing shrinking, never an exception."""

import json
import multiprocessing
import time
from pathlib import Path

from fieldkit.model.samples import Quality
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import open_session
from tests.harness.recording import STREAMS, Counters, header, record_until_killed, same, sample, started
from tests.harness.waiting import PATIENCE_S

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
