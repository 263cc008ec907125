"""Whatever bytes of a journal are damaged: what comes back and what is reported lost is what was written."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from fieldkit.samples import Event, EventKind
from fieldkit.sessions.header import SessionHeader
from fieldkit.sessions.layout import journal_path
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
    """An interrupted recording of `frames` samples of each of the first two streams."""

    folder: Path
    header: SessionHeader
    frames: int

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


@pytest.fixture(
    scope="module",
    params=[((24, 32), 60, 10**9), ((24, 32), 60, 60_000), ((300, 512), 6, 10**9)],
    ids=["one part", "several parts", "large pages"],
)
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return interrupted(tmp_path_factory.mktemp("interrupted"), *request.param)


def recovered_and_lost(recording: Recorded, copy: Path, damage: Damage, *, with_file: bool) -> None:
    """Recover a damaged copy: every sample is right or reported lost, and none is neither."""
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(recording.folder, copy)
    path = copy / "a.h5"
    if not with_file:
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
    for n, damage in enumerate(some(recording, 24)):
        recovered_and_lost(recording, tmp_path / "copy", damage, with_file=n % 4 == 3)


@pytest.mark.slow
def test_recovered_and_reported_lost_is_what_was_written_for_every_range(
    recording: Recorded, tmp_path: Path
) -> None:
    for damage in every(recording):
        recovered_and_lost(recording, tmp_path / "copy", damage, with_file=False)
