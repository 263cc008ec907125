"""Whatever becomes of a session's files: what comes back and what is reported lost is what was written.

Or recovery says that the end is not known. A process records a session and is killed; on the way it makes a
copy of everything as it then is. Another records another session. Each trial damages the very files that were
written (through links, so that device and inode stay) or copies of them, recovers, and puts back the bytes.
"""

import os
import random
import shutil
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, EventKind, Sample
from fieldkit.sessions import journal, journal_reader, session_file
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.log import LogReader
from fieldkit.sessions.reader import open_interrupted, open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.salvage import LostRange, Salvage
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import SPAWN, CountedClock, header, kill, same, sample
from tests.harness.waiting import wait_until

FOLDER, LOCK, FILE = "a.h5.journal", "a.h5.journal/lock", "a.h5"
SIZES = (1, 24, 600, 4_120, 30_000, 200_000)
STRANGER_NS = 7
UNREADABLE, KNOWN = "unreadable", "end known"
OLDER_COPY = "replaced as a whole by an older copy, which nothing can tell"


@dataclass(frozen=True)
class Kind:
    """A recording of `frames` samples of each of the first two streams."""

    shape: tuple[int, int]
    frames: int
    part_bytes: int
    journal_bytes: int = 750_000_000

    @property
    def header(self) -> SessionHeader:
        return header(self.shape)


KINDS = {
    "several parts": Kind((24, 32), 60, 60_000),
    "first parts gone": Kind((24, 32), 120, 30_000, journal_bytes=60_000),
    "one part": Kind((24, 32), 60, 10**9),
    "large frames": Kind((300, 512), 6, 10**9),
}


def record_on(folder: Path, kind: Kind, shift_ns: int) -> None:
    """Record, with a copy of everything on the way, and wait to be killed."""
    journal.PART_BYTES, session_file.JOURNAL_BYTES = kind.part_bytes, kind.journal_bytes
    session_file.FLUSH_EVERY_S = session_file.PARTIAL_AFTER_S = 0.0
    path = folder / "now" / FILE
    path.parent.mkdir()
    writer = SessionWriter(path, kind.header, CountedClock())
    writer.release_reserve()
    first = journal_path(path) / "000001.log"
    for seq in range(kind.frames):
        for info in kind.header.streams[:2]:
            item = sample(info, seq)
            writer.append(item._replace(mono_ns=item.mono_ns + shift_ns))
        if seq % 20 == 3:
            writer.put(Event(EventKind.MARK, seq, seq, f"mark {seq}"))
        if seq == kind.frames * 2 // 3:
            wait_until(lambda: first.exists() == (kind.journal_bytes > 10**6), "the first part stays")
            shutil.copytree(folder / "now", folder / "older")
    threading.Event().wait()


def is_caught_up(path: Path, frames: int) -> bool:
    """Whether the session file has all samples."""
    with suppress(SessionError, OSError, RuntimeError), open_interrupted(path) as session:
        return min(session.count("camera"), session.count("lux")) == frames
    return False  # not made yet, or just being written


@dataclass(frozen=True)
class Recording:
    """What the processes left: the session as it is, as it was, and the stranger's."""

    kind: Kind
    folder: Path
    contents: dict[str, bytes]

    @classmethod
    def of(cls, kind: Kind, folder: Path) -> "Recording":
        for name, shift_ns in (("own", 0), ("stranger", STRANGER_NS)):
            (folder / name).mkdir()
            process = SPAWN.Process(target=record_on, args=(folder / name, kind, shift_ns))
            process.start()
            path = folder / name / "now" / FILE
            wait_until(lambda path=path: is_caught_up(path, kind.frames), "the file is behind")
            kill(process)
        now = folder / "own" / "now"
        names = [str(path.relative_to(now)) for path in sorted(now.rglob("*")) if path.is_file()]
        return cls(kind, folder, {name: (now / name).read_bytes() for name in names})

    @property
    def parts(self) -> list[str]:
        return [name for name in self.contents if Path(name).name[0].isdigit()]

    def other(self, whose: str, name: str) -> bytes | None:
        """A file of the same name, as it was ("own/older") or of the stranger ("stranger/now")."""
        path = self.folder / whose / name
        return path.read_bytes() if path.exists() else None

    def lay_out(self, folder: Path, *, as_copies: bool) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        (folder / FOLDER).mkdir(parents=True)
        for name in self.contents:
            (shutil.copy2 if as_copies else os.link)(self.folder / "own" / "now" / name, folder / name)

    def put_back(self) -> None:
        for name, data in self.contents.items():
            path = self.folder / "own" / "now" / name
            if path.read_bytes() != data:
                path.write_bytes(data)  # the same file: opened to be written, not replaced


class Vandal:
    """Random damages to the files in a folder; `deeds` says what was done."""

    def __init__(self, recording: Recording, folder: Path, chance: random.Random) -> None:
        self.recording = recording
        self.folder = folder
        self.chance = chance
        self.deeds: list[str] = []
        self.can_be_told = True
        self._foreign_files = 0

    def strike(self) -> None:
        ways = (
            self.damage,
            self.damage,
            self.damage,
            self.cut,
            self.remove,
            self.replace,
            self.repeat,
            self.rename,
        )
        self.chance.choice(ways)()

    def store(self, name: str, data: bytes | None, deed: str) -> None:
        """Give a file other bytes, in place or as a new file that takes its name; without bytes it goes."""
        path, in_place = self.folder / name, self.chance.random() < 0.5
        self.deeds.append(f"{name} {deed}{' in place' * in_place}")
        if not in_place or data is None:
            path.unlink(missing_ok=True)
        if data is not None:
            path.write_bytes(data)

    def victim(self) -> str:
        """A part most often: most of the bytes are there."""
        names = [name for name in self.recording.contents if (self.folder / name).exists()]
        return self.chance.choices(names, [3 if name in self.recording.parts else 1 for name in names])[0]

    def damage(self) -> None:
        name = self.victim()
        data = (self.folder / name).read_bytes()
        start, size = self.chance.randrange(len(data) + 1), self.chance.choice(SIZES)
        before, hit, after = data[:start], data[start : start + size], data[start + size :]
        deed, result = self.chance.choice(
            [
                ("cut", before),
                ("shortened", before + after),
                ("zeroed", before + bytes(len(hit)) + after),
                ("flipped", before + bytes(byte ^ 0x5A for byte in hit) + after),
                ("bit", before + bytes(byte ^ 4 for byte in hit[:1]) + hit[1:] + after),
                ("swapped", before + after[:size] + hit + after[size:]),
                ("doubled", before + hit + hit + after),
            ]
        )
        self.store(name, result, f"{deed} {start}+{size}")

    def somebody(self, *others: str) -> str:
        """Whose file comes in; a stranger's once, as without the session file most of the others decide."""
        whose = self.chance.choice(others[: len(others) - self._foreign_files])
        self._foreign_files += whose.startswith("stranger")
        return whose

    def cut(self) -> None:
        """Where a record begins: nothing of it is left."""
        name = self.chance.choice([name for name in self.recording.contents if name.endswith(".log")])
        if (self.folder / name).exists():
            log = LogReader(self.folder / name)
            places = [head.at for head in log.heads()] or [0]
            log.close()
            place = self.chance.choice(places[-8:] if self.chance.random() < 0.5 else places)
            self.store(name, (self.folder / name).read_bytes()[:place], f"cut at record {place}")

    def remove(self) -> None:
        parts = self.recording.parts
        name = self.chance.choice([parts[0], parts[len(parts) // 2], parts[-1], self.victim()])
        self.store(name, None, "removed")

    def replace(self) -> None:
        """By the same file of another session, or as it was while it was recorded."""
        whose, name = self.somebody("own/older", "stranger/now"), self.victim()
        is_told = name != FILE or whose == "own/older"  # the file of another session is that session
        if is_told and (data := self.recording.other(whose, name)):
            self.store(name, data, f"of {whose}")

    def repeat(self) -> None:
        """A part stands there a second time, or one of another session or as it was beside it."""
        whose = self.somebody("own/now", "own/older", "stranger/now")
        if data := self.recording.other(whose, self.chance.choice(self.recording.parts)):
            self.store(
                f"{FOLDER}/{self.chance.choice(['000000', '000099', 'copy'])}.log", data, f"of {whose}"
            )

    def rename(self) -> None:
        one, other = (self.folder / self.chance.choice(self.recording.parts) for _ in range(2))
        if one != other and one.exists() and other.exists():
            self.deeds.append(f"{one.name} and {other.name} renamed")
            aside = one.with_name("aside")
            one.rename(aside)
            other.rename(one)
            aside.rename(other)

    def replace_journal(self, whose: str, *, file: bool) -> None:
        """All of the journal, its lock too, and the session file."""
        there = self.recording.folder / whose
        others = {str(path.relative_to(there)) for path in there.rglob("*") if path.is_file()}
        for name in sorted({*self.recording.contents, *others} - set([] if file else [FILE])):
            self.store(name, self.recording.other(whose, name), f"of {whose}")


def damaged(recording: Recording, folder: Path, seed: int) -> Vandal:
    """A session damaged in a way that the seed tells."""
    chance = random.Random(seed)
    recording.lay_out(folder, as_copies=chance.random() < 0.3)
    vandal = Vandal(recording, folder, chance)
    chosen = chance.random()
    if chosen < 0.05:
        vandal.replace_journal("stranger/now", file=False)
    elif chosen < 0.1:
        vandal.replace_journal("own/older", file=False)
    elif chosen < 0.12:  # what a kill at that moment would have left: nothing can tell
        vandal.replace_journal("own/older", file=True)
        vandal.can_be_told = False
    else:
        if chance.random() < 0.2:
            vandal.store(FILE, None, "removed")
        for _ in range(chance.choice([0, 1, 1, 1, 1, 2, 2, 3])):
            vandal.strike()
    return vandal


@dataclass(frozen=True)
class Remains:
    """What came back of a session, and what was said to be lost; `doubt` where its end is not known."""

    samples: list[Sample]
    entries: int
    lost: Sequence[LostRange]
    lost_entries: int
    doubt: str

    def strange(self, kind: Kind) -> list[str]:
        """Samples that nobody recorded."""
        streams = {info.name: info for info in kind.header.streams}
        return [
            f"strange {item.stream} {item.seq}"
            for item in self.samples
            if not same(item, sample(streams[item.stream], item.seq))
        ]

    def missing(self, kind: Kind) -> list[str]:
        """What is neither there nor said to be lost, nor may be behind an end that is not known."""
        there = Counter(item.stream for item in self.samples)
        for run in self.lost:
            there[run.stream] += run.count
        there["entries"] = self.entries + self.lost_entries
        written = {**dict.fromkeys(("camera", "lux"), kind.frames), "entries": 2 + (kind.frames + 16) // 20}
        return [
            f"{there[name]} of {count} {name}"
            for name, count in written.items()
            if not (there[name] == count or (there[name] < count and self.doubt))
        ]


def recovered(path: Path) -> Remains:
    report = recover(path)
    if not report.counts:
        return Remains([], 0, (), 0, "nothing was ever recorded")
    with open_session(path) as session:
        marks = [event for event in session.events() if event.kind is EventKind.MARK]
        entries = len(marks) + len(session.region_history())
        return Remains(list(session.samples()), entries, report.lost, report.lost_entries, report.doubt)


def salvaged(path: Path) -> Remains:
    """The same without the new file, whose making takes most of the time."""
    with Salvage(path) as salvage:
        samples = [sample for name in salvage.statistics for sample, _ in salvage.samples(name)]
        entries = len(list(salvage.entries()))
        return Remains(samples, entries, salvage.lost, salvage.lost_entries, salvage.doubt)


def tried(recording: Recording, folder: Path, seed: int, remains: Callable[[Path], Remains]) -> str:
    """Outcome of a session damaged in the way that a seed tells."""
    vandal = damaged(recording, folder, seed)
    with pytest.MonkeyPatch.context() as patch:
        if seed % 2:
            patch.setattr(journal_reader, "boot_id", lambda: "another boot")
        try:
            found = remains(folder / FILE)
        except SessionError:
            return UNREADABLE
        finally:
            recording.put_back()
    faults = found.strange(recording.kind) + found.missing(recording.kind) * vandal.can_be_told
    assert not faults, (seed, vandal.deeds, faults)
    if not vandal.can_be_told:
        return OLDER_COPY
    return "end not known" if found.doubt else KNOWN


@pytest.fixture(
    scope="module",
    params=[
        *("several parts", "first parts gone"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("one part", "large frames")),
    ],
)
def recording(request, tmp_path_factory):
    return Recording.of(KINDS[request.param], tmp_path_factory.mktemp("recorded"))


@pytest.mark.parametrize(
    ("remains", "seeds"),
    [(salvaged, range(30)), pytest.param(recovered, range(500), marks=pytest.mark.slow)],
)
def test_recovered_and_reported_lost_is_what_was_written(recording, tmp_path, remains, seeds):
    outcomes = Counter(tried(recording, tmp_path / "trial", seed, remains) for seed in seeds)
    print(f"{len(seeds)} damages:", ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
    assert outcomes[KNOWN] > len(seeds) // 10  # in a journal of one part few damages leave its end alone
    assert outcomes[UNREADABLE] < len(seeds) // 10
