"""The documentation says what is: its commands run, and print what the page shows.

``docs/transcripts.py`` compares them, and writes the numbers of a run into the pages.
"""

import importlib.util
import re
import shlex
from pathlib import Path
from types import ModuleType

import click
import pytest

from fieldkit.cli import main

ROOT = Path(__file__).parents[2]


def loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"docs_{name}", ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


transcripts = loaded("transcripts")


# five seconds of computing and more each, but for the reference's, which the tests of its examples run
LONG = {
    "alarms",
    "api",
    "batch",
    "calibrate-beds-and-meters",
    "calibrate-emissivity",
    "export-recordings",
    "first-five-minutes",
    "first-session",  # its commands: test_stranger.py
    "from-python",
    "import-recordings",
    "sand-slope-day",
    "terrain-products",
    "two-experiments",
}


def all_pages():
    """The pages, the long ones for `make test-slow`."""
    return [
        pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else [])
        for page in transcripts.pages()
    ]


def assert_takes(words):
    """That a command has the options that stand after it."""
    command, name = main, "fieldkit"
    while isinstance(command, click.Group):
        name, *words = words
        command = command.get_command(click.Context(command), name)
        assert command is not None, f"there is no command {name!r}"
    command.make_parser(click.Context(command, info_name=name)).parse_args(words)


COMMAND = r"""\bfieldkit ((?:'[^'\n]*'|"[^"\n]*"|\\\n|[^|;&>\n'"])+)"""
"""The words of a command up to a redirection, a pipe or the next command; these may stand within quotes."""


@pytest.mark.parametrize("page", transcripts.pages(), ids=lambda page: page.stem)
def test_every_command_of_a_page_has_the_options_it_shows(page):
    for command, _ in transcripts.commands(page):
        if "<<'PYTHON'" in command:
            compile(command.split("\n", 1)[1].removesuffix("PYTHON"), page.name, "exec")
        else:
            for words in re.findall(COMMAND, command):
                assert_takes(shlex.split(words.replace("\\\n", " ")))


@pytest.mark.parametrize("page", all_pages(), ids=lambda page: page.stem)
def test_what_a_page_shows_is_what_is_printed(page, tmp_path):
    run = transcripts.shell(tmp_path)
    for command, shown in transcripts.commands(page):
        printed = run(command)
        wrong = None if shown is None else transcripts.differs(shown, printed)
        assert not any("Traceback" in line for line in printed), "\n".join(printed)
        assert wrong is None, f"$ {command}\n{wrong}\nrun: python docs/transcripts.py {page}\n\n" + "\n".join(
            printed
        )


def test_the_generated_parts_of_the_reference_are_up_to_date():
    generate = loaded("generate")
    for page, make in generate.PAGES.items():
        assert page.read_text(encoding="utf-8") == generate.refreshed(page, make()), (
            "run: python docs/generate.py"
        )
