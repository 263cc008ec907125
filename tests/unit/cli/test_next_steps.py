"""Next steps are data: `str` writes what Python has, the command line what its commands have."""

import ast
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

import fieldkit
from fieldkit.cli import main
from fieldkit.cli.next_steps import COMMANDS, RUNNING, in_commands
from fieldkit.model.next_step import Action, Argument
from fieldkit.results.session import Stream

ROOT = Path(__file__).parents[3]
ROOMS = ("fieldkit", "drivers", "sessions", "calibration")


def call_of(action: Action) -> Any:
    home, *names = action.value.partition("(")[0].split(".")
    thing = fieldkit.Campaign if home == "campaign" else importlib.import_module(home)
    for name in ("Campaign" if name == "open_campaign()" else name for name in names):
        thing = getattr(thing, name, None) or importlib.import_module(f"{thing.__name__}.{name}")
    return thing


def command_of(action: Action) -> click.Command:
    command: click.Command = main
    for word in COMMANDS[action].split():
        if isinstance(command, click.Group):
            subcommand = command.get_command(click.Context(main), word)
            assert subcommand is not None
            command = subcommand
    return command


@pytest.mark.parametrize("action", Action)
def test_every_action_is_a_call_that_exists(action):
    assert call_of(action) is not None


@pytest.mark.parametrize("action", Action)
def test_every_action_is_a_command_with_options_that_exist(action):
    options = {name for option in command_of(action).params for name in option.opts}
    assert options >= {word for word in COMMANDS[action].partition(" |")[0].split() if word.startswith("--")}


def arguments_used() -> Iterator[tuple[str, str | None]]:
    """Every name that the product gives to an `Argument`, and to an action with the action's name."""
    for file in (file for room in ROOMS for file in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            match node:
                case ast.Call(ast.Name("Argument"), [ast.Constant(name), *_]):
                    yield name, None
                case ast.Call(ast.Attribute(ast.Name("Action"), action), _, keywords):
                    yield from ((str(keyword.arg), action) for keyword in keywords)


def commands_of(group: click.Group) -> Iterator[click.Command]:
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        assert command is not None
        yield from [command, *(commands_of(command) if isinstance(command, click.Group) else ())]


def parameters_in_python() -> set[str]:
    """The parameters of the public functions and classes, and of the methods of these classes."""
    public = [Stream, *(getattr(fieldkit, name) for name in fieldkit.__all__)]
    methods = [method for thing in public for _, method in inspect.getmembers(thing, inspect.isfunction)]
    return {
        name
        for thing in (*public, *methods)
        if callable(thing)
        for name in inspect.signature(thing).parameters
    }


def test_every_argument_of_a_text_exists_as_an_option_or_in_python():
    options = {option.name for command in commands_of(main) for option in command.params}
    arguments = list(arguments_used())
    assert len(arguments) > 50  # the product's sources are found
    assert {name for name, _ in arguments} <= options | parameters_in_python()


def test_every_argument_of_an_action_is_one_of_its_call_and_an_option_of_its_command():
    for name, action in arguments_used():
        if action is not None:
            assert name in inspect.signature(call_of(Action[action])).parameters, (action, name)
            assert name in {option.name for option in command_of(Action[action]).params}, (action, name)


PRESENT = Action.ESTIMATE(present=True)


@pytest.mark.parametrize(
    ("command", "text", "python", "typed"),
    [
        ("import", Action.CHECK(Path("/b c.h5")), "fieldkit.check('/b c.h5')", "fieldkit check '/b c.h5'"),
        ("import", Action.STOP() + " ends it", "fieldkit.stop() ends it", "fieldkit stop ends it"),
        ("import", PRESENT, "fieldkit.estimate(session, present=True)", "fieldkit estimate --campaign"),
        ("import", "omit " + Argument("zone"), "omit zone", "omit --zone"),
        ("import", Argument("zone", "Asia/Tokyo"), "zone='Asia/Tokyo'", "--zone Asia/Tokyo"),
        ("import", Argument("name", "logger"), "name='logger'", "--as logger"),
        ("import", Argument("offset_s", 12.0), "offset_s=12.0", "--clock-offset 12.0"),
        ("estimate", Argument("settings", {"a.b": "moon"}), "settings={'a.b': 'moon'}", "--set a.b=moon"),
    ],
)
def test_a_text_has_the_form_of_the_place_where_it_is_read(command, text, python, typed):
    with click.Context(main) as context:
        context.meta[RUNNING] = main.get_command(context, command)
        assert (str(text), in_commands(text)) == (python, typed)


# what one can be asked to do; a fact, a question or a key alone is no next step
IMPERATIVES = """
add allow begin calibrate change charge check chmod choose clean close compare configure connect
convert copy correct create declare delete describe do download draw edit end enlarge estimate
exchange export fetch fill free gdalwarp give heat import install join keep learn leave let level
look make mark measure mount move name omit open pip plug print put qualify quote raise read record
reduce remove rename repair report request resample run save see select send set shorten show shrink
split start state stop sudo switch take transform turn type uninstall unpack unplug update use wait
write
"""


def literal_fixes() -> Iterator[tuple[str, str]]:
    """Every next step that stands in the product as words alone, X in place of a value."""
    for file in (file for room in ROOMS for file in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "fix":
                for words in _literals(node.value):
                    yield f"{file.relative_to(ROOT)}:{node.value.lineno}", words


def _literals(value: ast.expr) -> Iterator[str]:
    if isinstance(value, ast.IfExp):
        yield from (*_literals(value.body), *_literals(value.orelse))
    elif isinstance(value, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in value.values)
    elif isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value


def test_every_next_step_can_be_done():
    """It begins with a verb that asks for something, which is named; a value of the error may stand first."""
    vague = [
        f"{place}: {words}"
        for place, words in literal_fixes()
        if not words.startswith("X")
        and (
            words.split()[0].strip(":,") not in IMPERATIVES.split()
            or len(words.replace("X", "X X").split()) < 3
        )
    ]
    assert not vague, "\n".join(vague)
