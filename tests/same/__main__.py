"""Run two checkouts on the same sessions and list every value that differs.

``make same OTHER=../other-checkout``: the other checkout, with its own virtual environment, records a dozen
sessions, ends twenty recordings by SIGKILL and damages twenty files. Both checkouts then recover, check,
estimate, map, report and export copies of them. Exit code 1 where a value differs by more than ``--to`` of
itself (default: not at all). For moves of code that must not change a number; some twenty minutes.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from difflib import SequenceMatcher
from itertools import zip_longest
from pathlib import Path

from rich.progress import track

from tests.same.program import Program
from tests.same.sessions import make
from tests.same.values import comparable, values_of

HERE = Path(__file__).parents[2]
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
SHOWN = 5


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.same", description=__doc__)
    parser.add_argument("other", type=Path, help="a checkout with a virtual environment in .venv")
    parser.add_argument("--to", type=float, default=0.0, help="relative difference that numbers may have")
    parser.add_argument(
        "--sessions", type=Path, help="folder to keep the sessions in, and to find them again"
    )
    parser.add_argument("--only", default="", help="compare only sessions whose name contains this text")
    options = parser.parse_args()
    programs = Program(options.other.resolve()), Program(HERE)
    with tempfile.TemporaryDirectory(prefix="fieldkit-same-") as scratch:
        folder = options.sessions or Path(scratch) / "sessions"
        if not (folder / "all").exists():
            made = [
                path.relative_to(folder) for path in track(make(programs[0], folder), "sessions", total=57)
            ]
            (folder / "all").write_text("\n".join(map(str, made)))
        chosen = [line for line in (folder / "all").read_text().splitlines() if options.only in line]
        differ = [
            compare(programs, folder / line, Path(scratch) / f"run-{number}", options.to)
            for number, line in enumerate(track(chosen, "values"))
        ]
    print(f"{len(differ)} compared, {sum(differ)} differ")
    return int(any(differ))


def compare(programs: tuple[Program, Program], source: Path, scratch: Path, to: float) -> bool:
    """Whether anything that the two find in a session differs; what does is printed."""
    # Both at the same path: some outputs print it, at its length.
    folder = scratch / source.parent.name
    before, after = (_found(program, source, folder) for program in programs)
    differences = [
        (key, *pair)
        for key in {**before, **after}
        for pair in different(before.get(key, ["nothing"]), after.get(key, ["nothing"]), to)
    ]
    for key, old, new in differences[:SHOWN]:
        print(f"{source.parent.name}: {key}\n  - {old[:180]}\n  + {new[:180]}")
    if len(differences) > SHOWN:
        print(f"{source.parent.name}: and {len(differences) - SHOWN} more lines")
    return bool(differences)


def _found(program: Program, source: Path, folder: Path) -> dict[str, list[str]]:
    """Lines by name of all that a program finds in a copy of a session; the copy is removed."""
    copied(source, folder)
    found = {key: comparable(text, folder) for key, text in values_of(program, source, folder)}
    shutil.rmtree(folder)
    return found


def copied(source: Path, folder: Path) -> None:
    """A copy of a session, a table or a campaign."""
    if source.is_dir():
        shutil.copytree(source, folder)
    else:
        folder.mkdir(parents=True)
        shutil.copy(source, folder)


def different(before: list[str], after: list[str], to: float) -> Iterator[tuple[str, str]]:
    """Pairs of lines that differ; where there are more or fewer of them, by the longest common sequences."""
    if len(before) == len(after):
        yield from (pair for pair in zip(before, after, strict=True) if not equal(*pair, to))
        return
    for what, a, b, c, d in SequenceMatcher(None, before, after).get_opcodes():
        if what != "equal":
            yield from zip_longest(before[a:b], after[c:d], fillvalue="nothing")


def equal(old: str, new: str, to: float) -> bool:
    """Whether two lines have the same words, and the same numbers to a relative `to`."""
    if old == new or to == 0.0:
        return old == new
    if _NUMBER.sub("#", old) != _NUMBER.sub("#", new):
        return False
    pairs = zip(map(float, _NUMBER.findall(old)), map(float, _NUMBER.findall(new)), strict=True)
    return all(abs(a - b) <= to * max(abs(a), abs(b)) for a, b in pairs)


if __name__ == "__main__":
    sys.exit(main())
