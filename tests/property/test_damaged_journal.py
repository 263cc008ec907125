"""Whatever bytes of a journal are damaged: what comes back and what is reported lost is what was written."""

import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from fieldkit.model.samples import Event, EventKind
from fieldkit.sessions import journal, session_file
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, same, sample
from tests.harness.waiting import wait_until

FLIPPED, ZEROED, CUT, DELETED, SWAPPED, BIT = "flipped", "zeroed", "cut", "deleted", "swapped", "bit"
HOW = (FLIPPED, ZEROED, CUT, DELETED, SWAPPED, BIT)
SIZES = (1, 24, 600, 4_120, 30_000, 200_000)


@dataclass(frozen=True)
class Damage:
    """What is done to which file of a journal: `size` bytes from `place` on, or everything from there."""

    file: str
    place: int
    size: int
    how: str

    def done_to(self, data: bytes) -> bytes:
        end = self.place + self.size
        before, hit, after = data[: self.place], data[self.place : end], data[end:]
        if self.how == SWAPPED:  # with as many bytes behind them
            return before + after[: self.size] + hit + after[self.size :]
        return {
            CUT: before,
            DELETED: before + after,
            ZEROED: before + bytes(len(hit)) + after,
            FLIPPED: before + bytes(byte ^ 0x5A for byte in hit) + after,
            BIT: before + bytes([hit[0] ^ 0x04]) + hit[1:] + after if hit else data,
        }[self.how]


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
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal, "PART_BYTES", part_bytes)  # a full part takes 256 MB
        writer = SessionWriter(folder / "a.h5", head, CountedClock())
    for seq in range(frames):
        for info in head.streams[:2]:
            writer.append(sample(info, seq))
        if seq % 20 == 3:
            writer.put(Event(EventKind.MARK, seq, seq, f"mark {seq}"))
    writer.abandon()
    (folder / "a.h5.journal" / "reserve").unlink()
    return Recorded(folder, head, frames)


def long_interrupted(folder: Path) -> Recorded:
    """A recording whose first parts have gone; their frames are only in the session file."""
    head = header((24, 32))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal, "PART_BYTES", 30_000)  # a full part takes 256 MB
        patch.setattr(session_file, "JOURNAL_BYTES", 60_000)  # after 750 MB parts go
        writer = SessionWriter(folder / "a.h5", head, CountedClock())
        for seq in range(120):
            for info in head.streams[:2]:
                writer.append(sample(info, seq))
        first = journal_path(folder / "a.h5") / "000001.log"
        wait_until(lambda: not first.exists(), "the first part stays")
        writer.abandon(at_once=False)
    (folder / "a.h5.journal" / "reserve").unlink()
    return Recorded(folder, head, 120, needs_file=True)


KINDS: dict[str, Callable[[Path], Recorded]] = {
    "one part": partial(interrupted, shape=(24, 32), frames=60, part_bytes=10**9),
    "several parts": partial(interrupted, shape=(24, 32), frames=60, part_bytes=60_000),
    "large frames": partial(interrupted, shape=(300, 512), frames=6, part_bytes=10**9),
    "first parts gone": long_interrupted,
}


@pytest.fixture(
    scope="module",
    params=[
        *("several parts", "first parts gone"),
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("one part", "large frames")),
    ],
)
def recording(request, tmp_path_factory):
    return KINDS[request.param](tmp_path_factory.mktemp("interrupted"))


def recovered_and_lost(recording: Recorded, copy: Path, *damages: Damage, with_file: bool) -> bool:
    """Recover a damaged copy: every sample is right or reported lost, and none is neither.

    Whether the end is known; where it is not, samples may be missing there.
    """
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(recording.folder, copy)
    path = copy / "a.h5"
    if not with_file and not recording.needs_file:
        path.unlink()
    for damage in damages:
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
            known = len(found) + lost[info.name]
            assert known == written or (known < written and not report.end_is_known), damages
            assert all(same(one, sample(info, one.seq)) for one in found), damages
    return report.end_is_known


def some(recording: Recorded, count: int) -> Iterator[Damage]:
    """Damages of every size and kind, most of them where most of the bytes are."""
    chance = random.Random(count)
    files = recording.files()
    for n in range(count):
        name, size = chance.choices(files, [size for _, size in files])[0] if n % 3 else chance.choice(files)
        yield Damage(name, chance.randrange(max(1, size)), chance.choice(SIZES), HOW[n % len(HOW)])


@pytest.mark.parametrize("count", [6, pytest.param(125, marks=pytest.mark.slow)])
def test_recovered_and_reported_lost_is_what_was_written(recording, tmp_path, count):
    known = [
        recovered_and_lost(recording, tmp_path / "copy", damage, with_file=n % 4 == 3)
        for n, damage in enumerate(some(recording, count))
    ]
    assert sum(known) > count // 2  # only where the last record itself is hit is the end not known


@pytest.mark.parametrize("count", [4, pytest.param(60, marks=pytest.mark.slow)])
def test_damage_of_the_end_and_of_its_count_leaves_no_wrong_number(recording, tmp_path, count):
    """The count beside the journal is damaged too: then what was at the end is known no more."""
    chance, files = random.Random(count), dict(recording.files())
    part = max(name for name in files if name[0].isdigit())
    for n in range(count):
        end = Damage(part, chance.randrange(files[part] // 2, files[part]), 10**9, HOW[n % 3])
        place = chance.randrange(files["confirmed.log"])
        counted = Damage("confirmed.log", place, chance.choice(SIZES), HOW[n // 3 % 3])
        recovered_and_lost(recording, tmp_path / "copy", end, counted, with_file=n % 4 == 3)
