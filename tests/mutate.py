"""Does a mistake in the code make a test fail? Make mistakes on purpose, one at a time, and count.

``make mutate ROOM=physics`` tries one room, ``make mutate`` all of them. The mistakes of a room stand in
``tests/mutations/ROOM.toml``: a file, a text in it that stands there exactly once, what is written in its
place, what a user would see of it, and the tests that should notice where the room's own are not the
nearest. Each is made in a copy of the tree, never in the tree itself; the nearest tests must pass in the
copy without it, and fail with it. The result is a table, and `--out` as JSON. What was found is kept and used
again while the file and its tests stay as they are, so a trial that was stopped goes on where it was.

Exit 1 when fewer than 90 % were noticed in some room, 2 when a mutation or the trial itself is at fault.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import select
import shutil
import signal
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import pytest

ROOT = Path(__file__).parents[1]
LISTS = ROOT / "tests/mutations"
KEPT = ROOT / ".cache/mutations"
LEAST_KILLED = 0.9
LONGEST_S = 150
"""A mutation after which the tests go on for so long has been noticed: something waits for ever."""
OPTIONS = ("-qx", "-p", "no:cacheprovider", "-m", "not slow")
LIBRARIES = (
    "astropy.coordinates", "click.testing", "h5py", "numpy", "pydantic", "rich.console", "tomlkit",
    "scipy.interpolate", "scipy.ndimage", "scipy.optimize", "scipy.stats",
)  # fmt: skip
"""Imported once: half of the time of most trials. Nothing of fieldkit: that is mutated."""
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", ".cache", ".*_cache", "__pycache__", "build", "site")


@dataclass(frozen=True, slots=True)
class Mutation:
    """One mistake: in `file`, `new` is written where `old` stands; `why` says what a user would see of it."""

    room: str
    file: str
    old: str
    new: str
    why: str
    tests: tuple[str, ...]

    def digest(self) -> str:
        """Of the mistake, the file it is made in and the tests that should notice it."""
        made_of = hashlib.sha256(repr(asdict(self)).encode())
        for path in (self.file, *self.tests):
            for file in _python_files(ROOT / path.partition("::")[0]):
                made_of.update(file.read_bytes())
        return made_of.hexdigest()

    def faults(self) -> Iterator[str]:
        """Why the mistake cannot be made, if it cannot."""
        found = (ROOT / self.file).read_text(encoding="utf-8").count(self.old)
        if found != 1:
            yield f"{self.old!r} stands {found} times in {self.file}, wanted: once"
        if self.old == self.new:
            yield f"{self.old!r} is not changed"
        for test in self.tests:
            if not (ROOT / test.partition("::")[0]).exists():
                yield f"there is no {test}"

    def __str__(self) -> str:
        return f"{self.file}: {self.old.strip()!r} -> {self.new.strip()!r} ({self.why})"


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a room: how many mutations, how many the tests noticed, and those that they did not."""

    room: str
    mutations: int
    killed: int
    survived: list[str]

    @property
    def share(self) -> float:
        """Killed of all, 0 to 1."""
        return self.killed / self.mutations


def _python_files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


def read_list(room: str) -> list[Mutation]:
    """The mutations of a room; raises `SystemExit` where one cannot be made."""
    table = tomllib.loads((LISTS / f"{room}.toml").read_text(encoding="utf-8"))
    listed = []
    for entry in table["mutation"]:
        tests = tuple(entry.pop("tests", table["tests"]))
        listed.append(Mutation(room=room, tests=tests, **entry))
    if wrong := [fault for mutation in listed for fault in mutation.faults()]:
        raise SystemExit("\n".join(f"{room}: {fault}" for fault in wrong))
    return listed


class Copy:
    """A copy of the tree in which mistakes are made and unmade."""

    def __init__(self, folder: Path) -> None:
        self._root = folder / "fieldkit"
        shutil.copytree(ROOT, self._root, symlinks=True, ignore=NOT_COPIED)
        self._passed: set[str] = set()
        for name in LIBRARIES:
            import_module(name)

    def must_pass(self, tests: Iterable[str]) -> None:
        """Raise `SystemExit` where tests fail without any mistake."""
        fresh = [test for test in tests if test not in self._passed]
        if fresh and self._pytest(fresh):
            raise SystemExit(f"these fail without any mutation: {' '.join(fresh)}")
        self._passed.update(fresh)

    def is_killed(self, mutation: Mutation) -> bool:
        """Whether the nearest tests notice a mistake."""
        with self._made(mutation):
            # Without this a compiled mistake of the same second and size would be taken for its original.
            return self._pytest(mutation.tests, compiles=False) != 0

    @contextmanager
    def _made(self, mutation: Mutation) -> Iterator[None]:
        file = self._root / mutation.file
        original = file.with_name(f"{file.name}.original")
        file.rename(original)
        try:
            file.write_text(
                original.read_text(encoding="utf-8").replace(mutation.old, mutation.new), encoding="utf-8"
            )
            yield
        finally:
            original.replace(file)

    def _pytest(self, tests: Iterable[str], *, compiles: bool = True) -> int:
        """Exit code of pytest in a fork of this process, which has the libraries already."""
        child = os.fork()
        if child == 0:
            self._become_pytest([*OPTIONS, *tests], compiles=compiles)
        try:
            code = _exit_code(child)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)  # what the tests started ends with them
        if code not in (0, 1, 2):  # 2: the mistake does not even import
            raise SystemExit(f"pytest ended with {code}: {' '.join(tests)}")
        return code

    def _become_pytest(self, arguments: list[str], *, compiles: bool) -> NoReturn:
        os.setsid()
        os.chdir(self._root)
        nothing = os.open(os.devnull, os.O_RDWR)
        for descriptor in range(3):
            os.dup2(nothing, descriptor)
        sys.modules["__main__"] = ModuleType("__main__")  # what processes of the tests begin with
        sys.path[0] = os.environ["PYTHONPATH"] = str(self._root)
        sys.dont_write_bytecode = not compiles
        os._exit(int(pytest.main(arguments)))


def _exit_code(child: int) -> int:
    """Wait for a child, but not for ever; 1 if it had to be waited for too long or died."""
    end = os.pidfd_open(child)
    ended, _, _ = select.select([end], [], [], LONGEST_S)
    os.close(end)
    if not ended:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) if os.WIFEXITED(status) else 1


def trial(room: str) -> dict[Mutation, bool]:
    """Which mutations of a room are noticed, as far as known from earlier trials, else by trying."""
    digests = {mutation: mutation.digest() for mutation in read_list(room)}  # before the tree may change
    path = KEPT / f"{room}.json"
    kept: dict[str, bool] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if unknown := [mutation for mutation, digest in digests.items() if digest not in kept]:
        KEPT.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
            copy = Copy(Path(folder))
            for mutation in unknown:
                copy.must_pass(mutation.tests)
                killed = kept[digests[mutation]] = copy.is_killed(mutation)
                print("killed  " if killed else "SURVIVED", mutation, flush=True)
                path.write_text(json.dumps(kept, indent=0), encoding="utf-8")
    return {mutation: kept[digest] for mutation, digest in digests.items()}


def row_of(room: str, killed: dict[Mutation, bool]) -> Row:
    """How many mutations of a room there are, how many were noticed, and those that were not."""
    survived = [str(mutation) for mutation in killed if not killed[mutation]]
    return Row(room, len(killed), len(killed) - len(survived), survived)


def _text(rows: list[Row]) -> Iterator[str]:
    yield f"{'room':<14}{'mutations':>10}{'killed':>8}"
    for row in rows:
        yield f"{row.room:<14}{row.mutations:>10}{row.killed:>8}{row.share:>7.0%}"
    for row in rows:
        yield from (f"survived: {line}" for line in row.survived)


def main() -> int:
    """Try the rooms named on the command line."""
    rooms = sorted(path.stem for path in LISTS.glob("*.toml"))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=f"of {', '.join(rooms)}; all without any")
    parser.add_argument("--out", type=Path, help="where the result goes as JSON")
    parser.add_argument("--check", action="store_true", help="only whether every mutation can be made")
    chosen = parser.parse_args()
    if unknown := set(chosen.rooms) - set(rooms):
        parser.error(f"no list of mutations: {', '.join(sorted(unknown))}")
    wanted = chosen.rooms or rooms
    lists = [read_list(room) for room in wanted]
    if chosen.check:
        print(f"{sum(map(len, lists))} mutations in {len(wanted)} rooms")
        return 0
    rows = [row_of(room, trial(room)) for room in wanted]
    print("\n".join(_text(rows)))
    if chosen.out:
        text = json.dumps([asdict(row) for row in rows], indent=2, ensure_ascii=False)
        chosen.out.write_text(text + "\n", encoding="utf-8")
    return int(any(row.share < LEAST_KILLED for row in rows))


if __name__ == "__main__":
    sys.exit(main())
