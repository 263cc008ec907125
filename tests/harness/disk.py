"""The disk as it may be found after a power cut, from a record of every write; and disks that fail.

`disk.c` is compiled and loaded into a recording process; where there is no compiler the
tests that need it are skipped.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

SOURCE = Path(__file__).with_name("disk.c")
PROJECT = Path(__file__).parents[2]
PAGE = 4096


def library(folder: Path) -> Path:
    """The compiled library; skips the test where it cannot be made."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs a C compiler on Linux")
    built = folder / "disk.so"
    if not built.exists():
        subprocess.run(
            [compiler, "-shared", "-fPIC", "-O2", "-o", str(built), str(SOURCE), "-ldl", "-lpthread"],
            check=True,
        )
    return built


def run_watched(
    folder: Path, *words: str, log: Path | None = None, fail: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a module with everything below `folder`/disk watched, which may `fail` as `disk.c` describes."""
    root = folder / "disk"
    root.mkdir(exist_ok=True)
    environment = {
        **os.environ,
        "LD_PRELOAD": str(library(folder)),
        "FAULTY_ROOT": str(root),
        "FAULTY_FAIL": fail,
    }
    if log is not None:
        environment["FAULTY_LOG"] = str(log)
    return subprocess.run(
        [sys.executable, *words], cwd=PROJECT, env=environment, capture_output=True, text=True, check=False
    )


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """No file becomes larger: the kernel writes what fits, then refuses, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[Path]:
    """A file system of its own; skips where that is not allowed."""
    place = folder / "small"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("mounting a small file system is not allowed here")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False)


@dataclass(frozen=True)
class Change:
    """One recorded change: kind as in disk.c."""

    kind: str
    path: str
    offset: int = 0
    data: bytes = b""


def read_log(path: Path, root: Path) -> list[Change]:
    """The changes in order, their paths relative to `root`."""
    data, place, changes = path.read_bytes(), 0, []
    while place < len(data):
        kind, length = chr(data[place]), struct.unpack_from("<H", data, place + 1)[0]
        name = data[place + 3 : place + 3 + length].decode()
        place += 3 + length
        offset, size = struct.unpack_from("<qq", data, place)
        place += 16
        content = data[place : place + size] if kind in "WR" else b""
        place += len(content)
        changes.append(Change(kind, os.path.relpath(name, root), offset, content))
    return changes


@dataclass
class Disk:
    """Files in memory, as a sequence of changes leaves them."""

    files: dict[str, bytearray] = field(default_factory=dict)

    def apply(self, change: Change) -> None:
        """Carry out one change."""
        if change.kind == "W":
            write(self.files.setdefault(change.path, bytearray()), change.offset, change.data)
        elif change.kind == "T":
            cut(self.files.setdefault(change.path, bytearray()), change.offset)
        elif change.kind == "U":
            self.files.pop(change.path, None)
        elif change.kind == "R":
            raise AssertionError("nothing is renamed while recording")

    def store(self, folder: Path) -> Path:
        """Put the files into a folder."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return folder


def write(content: bytearray, offset: int, data: bytes) -> None:
    if len(content) < offset:
        content.extend(bytes(offset - len(content)))
    content[offset : offset + len(data)] = data


def cut(content: bytearray, size: int) -> None:
    if len(content) > size:
        del content[size:]
    else:
        content.extend(bytes(size - len(content)))


def after(changes: Sequence[Change], count: int) -> Disk:
    """Every change up to `count` on the disk, in order."""
    disk = Disk()
    for change in changes[:count]:
        disk.apply(change)
    return disk


def torn(changes: Sequence[Change], count: int, chance: random.Random, *, sector: bool) -> Disk:
    """The same, but the last write cut off at a byte, or at a 512-byte border."""
    disk = after(changes, count - 1)
    last = changes[count - 1]
    if last.kind == "W":
        size = chance.randrange(len(last.data) + 1)
        size = size // 512 * 512 if sector else size
        disk.apply(Change("W", last.path, last.offset, last.data[:size]))
    return disk


def zeroed_tail(changes: Sequence[Change], count: int) -> Disk:
    """The files as long as they were, but what came since their last sync is zeros."""
    disk, since = Disk(), _since_sync(changes[:count])
    for number, change in enumerate(changes[:count]):
        lost = change.kind == "W" and number >= since.get(change.path, 0)
        disk.apply(Change("W", change.path, change.offset, bytes(len(change.data))) if lost else change)
    return disk


def reordered(changes: Sequence[Change], count: int, chance: random.Random) -> Disk:
    """Of the pages written since the last sync of their file, a random half, each in one of its versions."""
    disk, since = Disk(), _since_sync(changes[:count])
    versions: dict[tuple[str, int], list[bytes]] = {}
    newest = Disk()
    for number, change in enumerate(changes[:count]):
        pending = change.kind == "W" and number >= since.get(change.path, 0)
        if not pending:
            disk.apply(change)
        if change.kind == "U":
            versions = {key: value for key, value in versions.items() if key[0] != change.path}
        newest.apply(change)
        if pending:
            for page in range(change.offset // PAGE, (change.offset + len(change.data) - 1) // PAGE + 1):
                content = newest.files[change.path][page * PAGE : (page + 1) * PAGE]
                versions.setdefault((change.path, page), []).append(bytes(content))
    for (path, page), written in versions.items():
        if chance.random() < 0.5:
            disk.apply(Change("W", path, page * PAGE, chance.choice(written)))
    return disk


def confirmed(changes: Sequence[Change], count: int) -> Disk:
    """Nothing but what completed syncs had covered: what was written to a file since its last one is gone.

    So is a file, or a folder with all in it, whose name came since the last sync of the folder around it.
    """
    disk, since = Disk(), _since_sync(changes[:count])
    named: dict[str, int] = {}
    for number, change in enumerate(changes[:count]):
        if change.kind in "WT":
            named.setdefault(change.path, number)
            named.setdefault(os.path.dirname(change.path), number)
        elif change.kind == "U":
            named.pop(change.path, None)
        if change.kind == "U" or number < since.get(change.path, 0):
            disk.apply(change)

    def is_there(path: str) -> bool:
        return not path or (
            named[path] < since.get(os.path.dirname(path) or ".", 0) and is_there(os.path.dirname(path))
        )

    disk.files = {path: content for path, content in disk.files.items() if is_there(path)}
    return disk


def _since_sync(changes: Sequence[Change]) -> dict[str, int]:
    """For each file, the number of the change at which its last completed sync began."""
    begun: dict[str, int] = {}
    since: dict[str, int] = {}
    for number, change in enumerate(changes):
        if change.kind == "B":
            begun[change.path] = number
        elif change.kind == "E":
            since[change.path] = begun[change.path]
    return since


def durable_counts(changes: Sequence[Change], marks: str) -> Iterator[int]:
    """After each change, how many samples a completed sync had covered (see `faulty_recorder`)."""
    durable = 0
    for change in changes:
        if change.path == marks and change.kind == "W":
            durable = int(struct.unpack("<q", change.data)[0])
        yield durable
