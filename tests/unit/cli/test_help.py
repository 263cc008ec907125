"""The help of the command line: grouped, complete, and light."""

import re
from collections import defaultdict
from pathlib import Path

import click
import pytest

from fieldkit.cli import COMMANDS, main
from fieldkit.cli.common import Command, CommandGroup
from fieldkit.cli.types import RECORD_NAME
from tests.harness.command_line import fieldkit, succeed

COMMAND_NAMES = [name for summaries in COMMANDS.values() for name in summaries]


def test_cite_names_everybody_and_every_title_of_the_citation_file():
    told = " ".join(fieldkit("--cite").output.split())
    cited = (Path(__file__).parents[3] / "CITATION.cff").read_text()
    assert len(people := re.findall(r"family-names: (\w+), given-names: (\w+)", cited)) == 6
    assert all(f"{given} {family}" in told for family, given in people)
    assert all(title in told for title in re.findall(r'title: "(.+)"', cited))


@pytest.mark.parametrize("name", COMMAND_NAMES)
def test_every_command_prints_its_help_and_takes_the_common_options(name):
    assert f"Usage: fieldkit {name}" in succeed(name, "--help").output.replace("main", "fieldkit", 1)
    command = main.get_command(click.Context(main), name)
    assert isinstance(command, Command | CommandGroup)
    for one in command.commands.values() if isinstance(command, CommandGroup) else [command]:
        options = {option for parameter in one.params for option in parameter.opts}
        assert {"-C", "--json", "-q", "--quiet", "-v", "--verbose", "--no-color", "--no-input"} <= options
        assert one.help


def test_a_misspelled_command_names_the_nearest_and_exits_2():
    result = fieldkit("ini")
    assert result.exit_code == 2
    assert "'init'" in result.stderr


@pytest.mark.parametrize("option", ["-C", "--json", "--quiet"])
def test_a_common_option_before_the_command_is_rejected_with_its_place(option):
    found = fieldkit(option, ".", "ls")
    assert found.exit_code == 2
    assert f"fieldkit ls {option}" in found.stderr


DIFFERENT = {
    "--out": "a file, a folder, or a name that gets endings, as each command writes",
    "-o": "short for --out",
    "--set": "sweep takes several values of a key, the others one",
    "--start": "study starts at hours of the day, an import at a moment",
    "--unit": "tables have more units than a thermometer's display",
}
"""Options that take different things in different commands, and why."""


def contexts() -> dict[str, click.Context]:
    """Every command and subcommand, by what is typed, with a context of its own."""
    root, found = click.Context(main, info_name="fieldkit"), {}
    for name in COMMAND_NAMES:
        found[name] = click.Context(main.get_command(root, name), info_name=name, parent=root)
        if isinstance(group := found[name].command, CommandGroup):
            for word, one in group.commands.items():
                found[f"{name} {word}"] = click.Context(one, info_name=word, parent=found[name])
    return found


def test_an_option_takes_the_same_in_every_command():
    taken = defaultdict(set)
    for context in contexts().values():
        for option in (one for one in context.command.params if isinstance(one, click.Option)):
            for name in option.opts:
                taken[name].add("" if option.is_flag else option.make_metavar(context))
    assert {name for name, metavars in taken.items() if len(metavars) > 1} == set(DIFFERENT)


def test_no_option_of_a_number_takes_one_that_is_not_finite():
    options = {
        (name, one.opts[0]): kind
        for name, context in contexts().items()
        for one in context.command.params
        for kind in (one.type.types if isinstance(one.type, click.Tuple) else [one.type])
        if isinstance(kind, click.types.FloatParamType)
    }
    assert len(options) > 30
    for (name, option), kind in options.items():
        for text in ("nan", "inf", "-inf"):
            with pytest.raises(click.BadParameter, match="a number"):
                pytest.fail(f"{name} {option} takes {kind.convert(text, None, None)}")


def test_a_record_has_a_name_that_a_file_can_have():
    with pytest.raises(click.BadParameter, match="'sand-dry'"):
        RECORD_NAME.convert("sand/dry", None, None)


def test_help_names_every_command_under_its_heading():
    out = fieldkit("--help").output
    for heading, summaries in COMMANDS.items():
        assert all(f"  {name} " in out.partition(f"\n{heading}:\n")[2] for name in summaries)
