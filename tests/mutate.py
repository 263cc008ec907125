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
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LISTS = ROOT / "tests/mutations"
KEPT = ROOT / ".cache/mutations.json"
LEAST_KILLED = 0.9
LONGEST_S = 150
"""A mutation after which the tests go on for so long has been noticed: something waits for ever."""
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

    def mutated(self, text: str) -> str:
        """The text with the mistake; raises `SystemExit` where `old` does not stand there exactly once."""
        found = text.count(self.old)
        if found != 1 or self.old == self.new:
            raise SystemExit(f"{self.room}: {self.old!r} stands {found} times in {self.file}, wanted: once")
        return text.replace(self.old, self.new)

    def __str__(self) -> str:
        return f"{self.file}: {self.old.strip()!r} -> {self.new.strip()!r} ({self.why})"


def _python_files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


def read_list(room: str) -> list[Mutation]:
    """The mutations of a room; raises `SystemExit` where one cannot be made."""
    table = tomllib.loads((LISTS / f"{room}.toml").read_text(encoding="utf-8"))
    listed = []
    for entry in table["mutation"]:
        tests = tuple(entry.pop("tests", table["tests"]))
        listed.append(Mutation(room=room, tests=tests, **entry))
    for mutation in listed:
        mutation.mutated((ROOT / mutation.file).read_text(encoding="utf-8"))
        if missing := [test for test in mutation.tests if not (ROOT / test.partition("::")[0]).exists()]:
            raise SystemExit(f"{room}: there is no {missing[0]}")
    return listed


class Copy:
    """A copy of the tree in which mistakes are made and unmade."""

    def __init__(self, folder: Path) -> None:
        self._root = folder / "fieldkit"
        shutil.copytree(ROOT, self._root, symlinks=True, ignore=NOT_COPIED)
        self._passed: set[str] = set()

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
            return self._pytest(mutation.tests, PYTHONDONTWRITEBYTECODE="1") != 0

    @contextmanager
    def _made(self, mutation: Mutation) -> Iterator[None]:
        file = self._root / mutation.file
        original = file.with_name(f"{file.name}.original")
        file.rename(original)
        try:
            file.write_text(mutation.mutated(original.read_text(encoding="utf-8")), encoding="utf-8")
            yield
        finally:
            original.replace(file)

    def _pytest(self, tests: Iterable[str], **environment: str) -> int:
        command = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider", "-m", "not slow", *tests]
        process = subprocess.Popen(
            command,
            cwd=self._root,
            env={**os.environ, "PYTHONPATH": str(self._root), **environment},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # what the tests started ends with them
        )
        try:
            code = process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            code = 1
        finally:
            _end_group(process)
        if code not in (0, 1, 2):  # 2: the mistake does not even import
            raise SystemExit(f"pytest ended with {code}: {' '.join(command)}")
        return code


def _end_group(process: subprocess.Popen[bytes]) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    process.wait()


def trial(mutations: list[Mutation], kept: dict[str, bool]) -> dict[Mutation, bool]:
    """Which are noticed; `kept` knows some already and learns the others, one by one."""
    digests = {mutation: mutation.digest() for mutation in mutations}  # before the tree may change
    unknown = [mutation for mutation in mutations if digests[mutation] not in kept]
    if unknown:
        _try(unknown, digests, kept)
    return {mutation: kept[digests[mutation]] for mutation in mutations}


def _try(unknown: list[Mutation], digests: dict[Mutation, str], kept: dict[str, bool]) -> None:
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        copy = Copy(Path(folder))
        for mutation in unknown:
            copy.must_pass(mutation.tests)
            killed = kept[digests[mutation]] = copy.is_killed(mutation)
            print("killed  " if killed else "SURVIVED", mutation, flush=True)
            KEPT.parent.mkdir(exist_ok=True)
            KEPT.write_text(json.dumps(kept, indent=0), encoding="utf-8")


def table(rooms: list[str], killed: dict[Mutation, bool]) -> list[dict[str, object]]:
    """One row for each room: how many mutations, how many were noticed, and those that were not."""
    rows: list[dict[str, object]] = []
    for room in rooms:
        tried = [mutation for mutation in killed if mutation.room == room]
        survived = [str(mutation) for mutation in tried if not killed[mutation]]
        count = len(tried) - len(survived)
        rows.append({"room": room, "mutations": len(tried), "killed": count, "survived": survived})
    return rows


def _text(rows: list[dict[str, object]]) -> Iterator[str]:
    yield f"{'room':<14}{'mutations':>10}{'killed':>8}{'':>7}"
    for row in rows:
        share = int(row["killed"]) / int(row["mutations"])  # type: ignore[call-overload]
        yield f"{row['room']:<14}{row['mutations']:>10}{row['killed']:>8}{share:>7.0%}"
    for row in rows:
        yield from (f"survived: {line}" for line in row["survived"])  # type: ignore[attr-defined]


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
    mutations = [mutation for room in wanted for mutation in read_list(room)]
    if chosen.check:
        print(f"{len(mutations)} mutations in {len(wanted)} rooms")
        return 0
    kept: dict[str, bool] = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    rows = table(wanted, trial(mutations, kept))
    print("\n".join(_text(rows)))
    if chosen.out:
        chosen.out.write_text(json.dumps(rows, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return int(any(int(row["killed"]) < LEAST_KILLED * int(row["mutations"]) for row in rows))  # type: ignore[call-overload]


if __name__ == "__main__":
    sys.exit(main())
