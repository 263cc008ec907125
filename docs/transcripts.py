"""What the pages show of the command line, compared with what it prints, and written anew from it.

``python docs/transcripts.py [PAGE.md ...]`` runs pages and puts the numbers that came into them; a test
compares. In a block marked ``console`` lines after ``$`` are typed, with those after ``>`` that follow; the
others are what is printed, on stdout and stderr together. A block marked ``python`` is run, and prints what a
``text`` block right after it shows; one with a ``title`` becomes that file, which later ones may import.
``...`` stands for anything. What a page runs, it runs one after the other in an empty folder.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = re.compile(r"(?ms)^```(console|python)(?: title=\"(\S+)\")?\n(.*?)^```\n(?:\n```text\n(.*?)^```)?")
NUMBER = r"(\d+(?:\.\d+)?)"
HOME = "/home/me"

Run = Callable[[str], list[str]]


def pages() -> list[Path]:
    """The pages that show what commands print."""
    found = (ROOT / "docs").rglob("*.md")
    return sorted(page for page in found if RUN.search(page.read_text(encoding="utf-8")))


def commands(page: Path) -> list[tuple[str, list[str] | None]]:
    """Each command of a page with the lines it is said to print, None where the page does not say."""
    found: list[tuple[str, list[str] | None]] = []
    for kind, file, body, printed in RUN.findall(page.read_text(encoding="utf-8")):
        if kind == "python":
            run = f"tee {file} <<'PYTHON' | python -W error -\n{body}PYTHON"
            found.append((run, printed.splitlines() or None))
            continue
        for typed, shown in re.findall(r"(?m)^\$ (.*\n(?:> .*\n)*)((?:(?!\$ ).*\n)*)", body):
            found.append((typed.rstrip("\n").replace("\n> ", "\n"), shown.splitlines()))
    return found


def shell(folder: Path) -> Run:
    """Runs commands like a terminal does, each in the folder the one before left; gives what they print."""
    (folder / "home").mkdir()
    (folder / "work").mkdir()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "XDG_CONFIG_HOME": str(folder / "home")}
    at = folder / "work"

    def run(command: str) -> list[str]:
        nonlocal at
        done = subprocess.run(
            ["bash", "-c", f"{command}\npwd > {folder / 'where'}"],
            check=False, cwd=at, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        at = Path((folder / "where").read_text().strip())
        return done.stdout.replace(str(folder / "work"), HOME).splitlines()

    return run


def same_words(shown: str, printed: str) -> re.Match[str] | None:
    """The printed line as the shown one, whatever its numbers and spaces are; a group for each number."""
    pieces = re.split(rf"(\.\.\.|{NUMBER[1:-1]}|\s+)", shown.strip())
    pattern = "".join(
        ".*" if piece == "..."
        else NUMBER if re.fullmatch(NUMBER, piece)
        else r"\s+" if piece.isspace()
        else re.escape(piece)
        for piece in pieces
    )  # fmt: skip
    return re.fullmatch(pattern, printed.strip())


def matches(shown: str, printed: str) -> bool:
    """Whether a printed line is the shown one, but for spaces."""
    found = same_words(shown, printed)
    return found is not None and list(found.groups()) == re.findall(NUMBER, shown)


def aligned(
    shown: Sequence[str], printed: Sequence[str], is_same: Callable[[str, str], object]
) -> Iterator[tuple[str, str | None]]:
    """Each shown line with the printed one it stands for; None for ``...``, empty lines and missing ones."""
    rest = [line for line in printed if line.strip()]
    skipping = False
    for line in shown:
        if line.strip() in ("", "..."):
            skipping = skipping or line.strip() == "..."
            yield line, None
            continue
        while skipping and rest and not is_same(line, rest[0]):
            rest.pop(0)
        yield line, rest.pop(0) if rest else None
        skipping = False
    if rest and not skipping:
        yield "", rest[0]


def differs(shown: Sequence[str], printed: Sequence[str]) -> str | None:
    """What is wrong with a command's output, or None; a shown line ``...`` stands for any lines."""
    for line, came in aligned(shown, printed, matches):
        if not line.strip() and came is not None:
            return f"the page does not show {came!r}"
        if line.strip() not in ("", "...") and (came is None or not matches(line, came)):
            return f"the page shows {line!r}, printed was {came or 'nothing more'!r}"
    return None


def refreshed(shown: Sequence[str], printed: Sequence[str]) -> list[str]:
    """The shown lines with the numbers that were printed; lines of other words stay for a person to mend."""

    def is_same(line: str, came: str) -> object:
        """After ``...`` the line with the page's own numbers if it came, else the first with its words."""
        came_as_shown = any(matches(line, one) for one in printed)
        return matches(line, came) if came_as_shown else same_words(line, came)

    lines = []
    for line, came in aligned(shown, printed, is_same):
        found = same_words(line, came) if came is not None and line.strip() else None
        if found is None:
            lines += [line] if line.strip() or came is None else []
        elif "..." in line:
            numbers = iter(found.groups())
            lines.append(re.sub(NUMBER, lambda _, numbers=numbers: next(numbers), line))
        else:
            lines.append((came or "").rstrip())
    return lines


def refresh(page: Path) -> None:
    """Run a page and write the numbers into it."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        run = shell(Path(folder))
        for typed, shown in commands(page):
            printed = run(typed)
            if shown:
                now = refreshed(shown, printed)
                text = text.replace("\n".join(shown), "\n".join(now), 1)
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for name in [Path(word) for word in sys.argv[1:]] or pages():
        refresh(name)
