"""Whatever bytes of a journal are damaged: what comes back and what is reported lost is what was written."""

from __future__ import annotations

import random
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from fieldkit.model.samples import Event, EventKind
from fieldkit.sessions import session_file
from fieldkit.sessions.layout import SessionHeader, journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, same, sample

FLIPPED, ZEROED, CUT = "flipped", "zeroed", "cut"
SIZES = (1, 24, 600, 4_120, 30_000, 200_000)


@dataclass(frozen=True)
class Damage:
    """What is done to which file of a journal: `size` bytes from `place` on, or everything from there."""

    file: str
    place: int
    size: int
    how: str

    def done_to(self, data: bytes) -> bytes:
        before, hit = data[: self.place], data[self.place : self.place + self.size]
        if self.how == CUT:
            return before
        other = bytes(len(hit)) if self.how == ZEROED else bytes(byte ^ 0x5A for byte in hit)
        return before + other + data[self.place + self.size :]


@dataclass(frozen=True)
class Recorded:
    """An interrupted recording of `frames` samples of each of the first two streams.

    `needs_file` where the journal has given pictures to the session file for good.
    """

    folder: Path
    header: SessionHeader
    frames: int
    needs_file: bool = False

    @property
    def path(self) -> Path:
        return self.folder / "a.h5"

    def files(self) -> list[tuple[str, int]]:
        """Files of the journal with bytes of the recording, and how many."""
        files = [path for path in sorted(journal_path(self.path).iterdir()) if path.is_file()]
        return [(path.name, path.stat().st_size) for path in files if path.name not in ("lock", "reserve")]


def interrupted(folder: Path, shape: tuple[int, int], frames: int, part_bytes: int) -> Recorded:
    """A recording whose process ended, everything of it on the disk."""
    head = header(shape)
    writer = SessionWriter(folder / "a.h5", head, CountedClock())
    writer._journal.part_bytes = part_bytes
    for seq in range(frames):
        for info in head.streams[:2]:
            writer.append(sample(info, seq))
        if seq % 20 == 3:
            writer.event(Event(EventKind.MARK, seq, seq, f"mark {seq}"))
    writer.abandon()
    (folder / "a.h5.journal" / "reserve").unlink()
    return Recorded(folder, head, frames)


def long_interrupted(folder: Path) -> Recorded:
    """A recording whose first parts have gone; what must stay of them lies in a database without a log."""
    head = header((24, 32))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session_file, "JOURNAL_BYTES", 60_000)
        writer = SessionWriter(folder / "a.h5", head, CountedClock())
        writer._journal.part_bytes = 30_000
        for seq in range(120):
            for info in head.streams[:2]:
                writer.append(sample(info, seq))
        deadline = time.monotonic() + 60
        while writer._journal.full_parts and writer._journal.part_path(1).exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert not writer._journal.part_path(1).exists()
        writer._file_thread.stop()
        writer._file_thread.join()
        writer._file_thread._retained._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        writer.abandon()
    (folder / "a.h5.journal" / "reserve").unlink()
    return Recorded(folder, head, 120, needs_file=True)


KINDS: dict[str, Callable[[Path], Recorded]] = {
    "one part": partial(interrupted, shape=(24, 32), frames=60, part_bytes=10**9),
    "several parts": partial(interrupted, shape=(24, 32), frames=60, part_bytes=60_000),
    "large pages": partial(interrupted, shape=(300, 512), frames=6, part_bytes=10**9),
    "first parts gone": long_interrupted,
}


@pytest.fixture(scope="module", params=KINDS)
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return KINDS[request.param](tmp_path_factory.mktemp("interrupted"))


def recovered_and_lost(recording: Recorded, copy: Path, damage: Damage, *, with_file: bool) -> None:
    """Recover a damaged copy: every sample is right or reported lost, and none is neither."""
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(recording.folder, copy)
    path = copy / "a.h5"
    if not with_file and not recording.needs_file:
        path.unlink()
    victim = journal_path(path) / damage.file
    victim.write_bytes(damage.done_to(victim.read_bytes()))
    report = recover(path)
    lost = {info.name: 0 for info in recording.header.streams}
    for run in report.lost:
        lost[run.stream] += run.count
    with open_session(path) as session:
        for number, info in enumerate(recording.header.streams):
            found = list(session.stream(info.name).samples())
            written = recording.frames if number < 2 else 0
            assert len(found) + lost[info.name] == written, damage
            assert all(same(one, sample(info, one.seq)) for one in found), damage


def some(recording: Recorded, count: int) -> Iterator[Damage]:
    """Damages of every size and kind, most of them where most of the bytes are."""
    chance = random.Random(count)
    files = recording.files()
    for n in range(count):
        name, size = chance.choices(files, [size for _, size in files])[0] if n % 3 else chance.choice(files)
        how = (FLIPPED, ZEROED, FLIPPED, CUT)[n % 4]
        yield Damage(name, chance.randrange(max(1, size)), SIZES[n % len(SIZES)], how)


def every(recording: Recorded) -> Iterator[Damage]:
    """Every page with each part of its frame, and every range of pages of some lengths."""
    for name, size in recording.files():
        step = 1_030 if size < 1_000_000 else 16_390
        for place in range(0, size, step):
            yield Damage(name, place, 1, FLIPPED)
            yield Damage(name, place, 8 * step, FLIPPED)
        for place in range(0, size, 8 * step):
            yield Damage(name, place, 4 * step, ZEROED)
            yield Damage(name, place, size, CUT)


def test_recovered_and_reported_lost_is_what_was_written(recording: Recorded, tmp_path: Path) -> None:
    for n, damage in enumerate(some(recording, 20)):
        recovered_and_lost(recording, tmp_path / "copy", damage, with_file=n % 4 == 3)


@pytest.mark.slow
def test_recovered_and_reported_lost_is_what_was_written_for_every_range(
    recording: Recorded, tmp_path: Path
) -> None:
    for damage in every(recording):
        recovered_and_lost(recording, tmp_path / "copy", damage, with_file=False)
