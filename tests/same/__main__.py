"""Record and evaluate the same sessions in two checkouts and list every value that differs.

``make same OTHER=../other-checkout``: each checkout, with its own virtual environment, records a dozen
sessions of simulated instruments with the same seeds and clocks, then checks, estimates, maps, reports and
exports copies of them. Neither reads a file of the other, so their formats may differ. Exit code 1 where a
value differs by more than ``--to`` of itself (default: not at all). For moves of code that must not change a
number; some twenty minutes.
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
    parser.add_argument(
        "--only", default="", help="record and compare only sessions whose name contains this text"
    )
    options = parser.parse_args()
    programs = Program(options.other.resolve()), Program(HERE)
    with tempfile.TemporaryDirectory(prefix="fieldkit-same-") as scratch:
        folder = options.sessions or Path(scratch) / "sessions"
        sides = folder / "before", folder / "after"
        for program, side in zip(programs, sides, strict=True):
            if not (side / "all").exists():
                finished = track(make(program, side, options.only), side.name, total=12)
                paths = [path.relative_to(side) for path in finished]
                (side / "all").write_text("\n".join(map(str, paths)))
        names = dict.fromkeys(line for side in sides for line in (side / "all").read_text().splitlines())
        chosen = [name for name in names if options.only in name]
        differ = [
            compare(programs, sides, name, Path(scratch) / f"run-{number}", options.to)
            for number, name in enumerate(track(chosen, "values"))
        ]
    print(f"{len(differ)} compared, {sum(differ)} differ")
    return int(any(differ))


def compare(
    programs: tuple[Program, Program], sides: tuple[Path, Path], name: str, scratch: Path, to: float
) -> bool:
    """Whether anything that the two find in their session `name` differs; what does is printed."""
    # Both at the same path: some outputs print it, at its length.
    folder = scratch / Path(name).parent.name
    before, after = (
        _values(program, side / name, folder) for program, side in zip(programs, sides, strict=True)
    )
    differences = [
        (key, *pair)
        for key in {**before, **after}
        for pair in different(before.get(key, ["nothing"]), after.get(key, ["nothing"]), to)
    ]
    for key, old, new in differences[:SHOWN]:
        print(f"{name}: {key}\n  - {old[:180]}\n  + {new[:180]}")
    if len(differences) > SHOWN:
        print(f"{name}: and {len(differences) - SHOWN} more lines")
    return bool(differences)


def _values(program: Program, source: Path, folder: Path) -> dict[str, list[str]]:
    """Lines by name of all that a program finds in a copy of a session; the copy is removed."""
    if not source.exists():
        return {}
    folder.mkdir(parents=True)
    shutil.copy(source, folder)
    values = {key: comparable(text, folder) for key, text in values_of(program, source, folder)}
    shutil.rmtree(folder)
    return values


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
