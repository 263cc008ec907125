"""Words of our own are in no help, message or page."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from fieldkit.cli import main
from fieldkit.cli.common import CommandGroup

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


OURS = re.compile(
    r"\b(pictures?|told|tells?|taught|said|says?|heard|hears?|answers?|nobody|somebody|whoever|doubts?"
    r"|long wave|left out|in force)\b",
    re.IGNORECASE,
)
"""Words that have one of the field: frame, reports, learnt, estimate, reply, warning, longwave, excluded."""

JUSTIFIED = {"fieldkit/page/hub.py": "a person who controls the recording takes the place of another"}
"""Files that keep one of these words, and why."""


def pages() -> Iterator[tuple[str, str]]:
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        if "decisions" not in page.parts and page.name != "architecture.md":  # for those who build fieldkit
            yield str(page.relative_to(ROOT)), page.read_text(encoding="utf-8")


def messages() -> Iterator[tuple[str, str]]:
    """Every string of the program with more than one word that is not a docstring."""
    rooms = [ROOT / name for name in ("fieldkit", "drivers", "sessions", "calibration")]
    for file in (file for room in rooms for file in sorted(room.rglob("*.py"))):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        alone = {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
        for one in ast.walk(tree):
            if isinstance(one, ast.Constant) and id(one) not in alone and " " in str(one.value).strip():
                yield f"{file.relative_to(ROOT)}:{one.lineno}", str(one.value)


def helps() -> Iterator[tuple[str, str]]:
    root = click.Context(main, info_name="fieldkit")
    for name in main.list_commands(root):
        command = main.get_command(root, name)
        for one in (command, *(command.commands.values() if isinstance(command, CommandGroup) else ())):
            yield f"fieldkit {name} {one.name}", one.get_help(click.Context(one, parent=root))


@pytest.mark.parametrize("source", [pages, messages, helps])
def test_words_of_our_own_are_in_no_help_message_or_page(source):
    found = {
        f"{place}: {line.strip()}"
        for place, text in source()
        if place.partition(":")[0] not in JUSTIFIED
        for line in text.splitlines()
        if OURS.search(line)
    }
    assert found == set()
