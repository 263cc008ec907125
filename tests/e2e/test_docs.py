"""The documentation says what is: its commands run, and print what the page shows.

In a block marked ``console`` lines after ``$`` are typed, with those after ``>`` that go on with them; the
others are what is printed, on stdout and stderr together. A block marked ``python`` is run, and prints what
a ``text`` block right after it shows. Words must agree, numbers to within 15 % or six of their last digit
(they move with every improvement of an estimator; those after ``±`` so much that only their
presence counts); ``...`` stands for anything. What a page runs, it runs one after the other
in an empty folder.
"""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUN = re.compile(r"(?ms)^```(console|python)\n(.*?)^```\n(?:\n```text\n(.*?)^```)?")
PAGES = sorted(page for page in (ROOT / "docs").rglob("*.md") if RUN.search(page.read_text(encoding="utf-8")))
NUMBER = r"(\d+(?:\.\d+)?)"


def commands(page: Path) -> list[tuple[str, list[str] | None]]:
    """Each command of a page with the lines it is said to print, None where the page does not say."""
    found: list[tuple[str, list[str] | None]] = []
    for kind, body, printed in RUN.findall(page.read_text(encoding="utf-8")):
        if kind == "python":
            found.append((f"python -W error - <<'PYTHON'\n{body}PYTHON", printed.splitlines() or None))
            continue
        for typed, shown in re.findall(r"(?ms)^\$ (.*?\n(?:> .*?\n)*)(.*?)(?=^\$ |\Z)", body):
            found.append((re.sub(r"(?m)^> ", "", typed), shown.splitlines()))
    return found


def matches(shown: str, printed: str) -> bool:
    """Whether a printed line is the shown one, but for spaces and small changes of numbers."""
    pieces = re.split(rf"(\.\.\.|{NUMBER[1:-1]}|\s+)", shown.strip())
    kinds = {"...": ".*"}
    pattern = "".join(
        kinds.get(
            piece, NUMBER if re.fullmatch(NUMBER, piece) else r"\s+" if piece.isspace() else re.escape(piece)
        )
        for piece in pieces
    )
    found = re.fullmatch(pattern, printed.strip())
    if found is None:
        return False
    pairs = zip(re.finditer(NUMBER, shown), found.groups(), strict=True)
    return all(
        float(number) == near(wanted[0]) for wanted, number in pairs if shown[: wanted.start()][-1:] != "±"
    )


def near(shown: str) -> object:
    """Numbers that a reader would take for the one the page shows."""
    decimals = len(shown.partition(".")[2])
    return pytest.approx(float(shown), rel=0.15, abs=6.0 * 10.0**-decimals if decimals else 0.6)


def differs(shown: list[str], printed: list[str]) -> str | None:
    """What is wrong with a command's output, or None; a shown line ``...`` stands for any lines."""
    rest = [line for line in printed if line.strip()]
    skipping = False
    for line in (line for line in shown if line.strip()):
        if line.strip() == "...":
            skipping = True
            continue
        while skipping and rest and not matches(line, rest[0]):
            rest.pop(0)
        if not rest or not matches(line, rest[0]):
            return f"the page shows {line!r}, printed was {rest[0] if rest else 'nothing more'!r}"
        rest.pop(0)
        skipping = False
    return None if skipping or not rest else f"the page does not show {rest[0]!r}"


@pytest.fixture
def shell(tmp_path, monkeypatch):
    """Runs commands like a terminal does, each in the folder the one before left."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    folder = tmp_path / "work"
    folder.mkdir()
    where = tmp_path / "where"

    def run(command: str) -> list[str]:
        at = where.read_text().strip() if where.exists() else str(folder)
        done = subprocess.run(
            ["bash", "-c", f"{command}\npwd > {where}"],
            cwd=at,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return done.stdout.replace(str(folder), "/home/me").splitlines()

    return run


@pytest.mark.timeout(1800)  # one page records four hours of an afternoon
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_shows_is_what_is_printed(page, shell):
    for command, shown in commands(page):
        printed = shell(command)
        wrong = None if shown is None else differs(shown, printed)
        assert not any("Traceback" in line for line in printed), "\n".join(printed)
        assert wrong is None, f"$ {command}\n{wrong}\n\n" + "\n".join(printed)


def test_the_generated_parts_of_the_reference_are_up_to_date():
    spec = importlib.util.spec_from_file_location("docs_generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    for page, make in generate.PAGES.items():
        assert page.read_text(encoding="utf-8") == generate.refreshed(page, make()), (
            "run: python docs/generate.py"
        )


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        (["done in 44 s"], ["done in 44 s"]),
        (["a 5.6 ±2.0°  ok"], ["a  5.9 ±2.1° ok"]),
        (["first", "...", "last"], ["first", "x", "y", "last"]),
        (["took ... s"], ["took 4000 s"]),
        (["...", "b 1"], ["b 10", "b 1"]),
    ],
)
def test_the_comparison_forgives_spaces_and_small_changes(shown, printed):
    assert differs(shown, printed) is None


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        (["done"], []),
        ([], ["an unexpected line"]),
        (["5.6 ok"], ["5.6 shaded"]),
        (["tilt 5.6"], ["tilt 15.6"]),
        (["first", "...", "last"], ["first", "x"]),
        (["(a)"], ["a"]),
    ],
)
def test_the_comparison_sees_what_matters(shown, printed):
    assert differs(shown, printed) is not None
