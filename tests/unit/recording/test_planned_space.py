"""What a recording is planned to take is what it takes on the disk, journal and file together."""

from pathlib import Path

from fieldkit.model.samples import Health, StreamHealth
from fieldkit.recorder.device_reader import Sampling
from fieldkit.recording.preflight import bytes_per_second
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import STREAMS, CountedClock, header, sample

SECONDS = 600
HEADER = header((120, 160), rows=0)


def on_disk(path: Path) -> int:
    """Bytes of the session's files, without the room kept for its end."""
    files = [path, *(file for file in journal_path(path).iterdir() if file.name != "reserve")]
    return sum(512 * file.stat().st_blocks for file in files)


def test_bursts_of_a_small_camera_with_meters_take_no_more_than_planned(tmp_path):
    """A reading of a meter once took ten times what was planned for it."""
    path, streams = tmp_path / "a.h5", HEADER.streams
    writer = SessionWriter(path, HEADER, CountedClock())
    empty, counted = on_disk(path), writer.bytes_written
    for second in range(SECONDS):
        for number in range(3 * (second % 60 == 0)):
            writer.append(sample(streams[0], second // 60 * 3 + number))
        for info in streams[1:]:
            writer.append(sample(info, second))
        health = tuple(StreamHealth(name, second, 0, 0) for name in STREAMS)
        writer.put(Health(second, second, health, 10**11, 10**9, 1.5, 2.5, 3.5))
    writer.abandon(at_once=False)
    grown, counted = on_disk(path) - empty, writer.bytes_written - counted
    planned = SECONDS * bytes_per_second(streams, Sampling(every_s=60.0))
    assert planned / 2 < grown < planned
    assert abs(grown - counted) < 4096 * 5  # whole blocks
