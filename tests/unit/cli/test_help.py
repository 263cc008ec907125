"""The help of the command line: grouped, complete, and light."""

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from click.testing import CliRunner

from fieldkit.cli import COMMANDS, CommandEntry, CommandTable, main
from fieldkit.cli.common import Command, CommandGroup
from fieldkit.cli.export import KINDS
from fieldkit.workflows.export import Kind

HEAVY = ("numpy", "astropy", "h5py", "cv2", "pydantic", "rich", "scipy", "serial", "usb")
COMMAND_NAMES = [row.name for rows in COMMANDS.values() for row in rows]


def loaded_by(*arguments: str) -> set[str]:
    """Heavy packages that a command line loads, seen from inside a fresh interpreter."""
    code = (
        "import sys; from fieldkit.cli import main\n"
        f"try: main({list(arguments)!r})\n"
        "except SystemExit as end: assert end.code == 0, end.code\n"
        f"print('loaded:', *[name for name in {HEAVY!r} if name in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return set(out.rpartition("loaded:")[2].split())


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("--cite",)])
def test_what_needs_no_command_loads_nothing_heavy(arguments):
    assert loaded_by(*arguments) == set()


def test_importing_fieldkit_loads_nothing_heavy():
    code = f"import sys, fieldkit; print(*[name for name in {HEAVY!r} if name in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == []


def test_the_guard_against_heavy_imports_sees_a_heavy_import():
    assert "pydantic" in loaded_by("init", "--schema")


def test_cite_names_everybody_and_every_title_of_the_citation_file():
    told = " ".join(CliRunner().invoke(main, ["--cite"]).output.split())
    cited = (Path(__file__).parents[3] / "CITATION.cff").read_text()
    assert len(people := re.findall(r"family-names: (\w+), given-names: (\w+)", cited)) == 6
    assert all(f"{given} {family}" in told for family, given in people)
    assert all(title in told for title in re.findall(r'title: "(.+)"', cited))


def test_help_names_every_command_under_its_heading():
    out = CliRunner().invoke(main, ["--help"]).output
    for heading, rows in COMMANDS.items():
        assert f"\n{heading}:\n" in out
        assert all(f"  {row.name} " in out for row in rows)


@pytest.mark.parametrize("name", COMMAND_NAMES)
def test_every_command_takes_the_common_options(name):
    command = main.get_command(main.make_context("fieldkit", ["--help"], resilient_parsing=True), name)
    assert isinstance(command, Command | CommandGroup)
    for one in command.commands.values() if isinstance(command, CommandGroup) else [command]:
        options = {option for parameter in one.params for option in parameter.opts}
        assert {"-C", "--json", "-q", "--quiet", "-v", "--verbose", "--no-color", "--no-input"} <= options
        assert one.help


@pytest.mark.parametrize("name", COMMAND_NAMES)
def test_every_command_prints_its_help(name):
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0
    assert f"Usage: fieldkit {name}" in result.output.replace("main", "fieldkit", 1)


def test_python_m_fieldkit_is_fieldkit():
    out = subprocess.run(
        [sys.executable, "-m", "fieldkit", "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert out.startswith("Usage: fieldkit [OPTIONS] COMMAND")


def test_a_misspelled_command_names_the_nearest_and_exits_2():
    result = CliRunner().invoke(main, ["ini"])
    assert result.exit_code == 2
    assert "did you mean 'init'?" in result.stderr


def test_an_unknown_option_exits_2():
    assert CliRunner().invoke(main, ["init", "--nonsense"]).exit_code == 2


def test_a_command_is_imported_only_when_it_runs():
    table = CommandTable(
        {"Start": (CommandEntry("broken", "fieldkit.no_such_module", "Cannot be imported."),)}, name="x"
    )
    assert "Cannot be imported." in CliRunner().invoke(table, ["--help"]).output


@pytest.mark.parametrize("option", ["-C", "--json", "--quiet"])
def test_a_common_option_before_the_command_is_rejected_with_its_place(option):
    found = CliRunner().invoke(main, [option, ".", "ls"])
    assert found.exit_code == 2
    assert f"{option} goes after the command: fieldkit ls {option}" in found.stderr


def test_export_offers_every_kind_that_there_is():
    assert set(KINDS) == set(get_args(Kind))
