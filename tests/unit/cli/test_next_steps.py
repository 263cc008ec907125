"""Next steps are data: `str` writes what Python has, the command line what its commands have."""

import importlib
from pathlib import Path
from typing import Any

import click
import pytest

import fieldkit
from fieldkit.cli import main
from fieldkit.cli.next_steps import COMMANDS, RUNNING, in_commands
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action, Argument


@pytest.mark.parametrize("action", Action)
def test_every_action_is_a_call_that_exists(action):
    home, *names = action.value.partition("(")[0].split(".")
    thing = fieldkit.Campaign if home == "campaign" else importlib.import_module(home)
    for name in names:
        thing = fieldkit.Campaign if name == "open_campaign()" else member(thing, name)
    assert thing is not None


def member(thing: Any, name: str) -> Any:
    return (
        getattr(thing, name) if hasattr(thing, name) else importlib.import_module(f"{thing.__name__}.{name}")
    )


@pytest.mark.parametrize("action", Action)
def test_every_action_is_a_command_with_options_that_exist(action):
    context = click.Context(main)
    command: click.Command | None = main
    for word in COMMANDS[action].partition(" |")[0].split():
        if isinstance(command, click.Group):
            command = command.get_command(context, word)
        elif command is not None and word.startswith("--"):
            assert word in {name for option in command.params for name in option.opts}
    assert command is not main
    assert command is not None


@pytest.mark.parametrize(
    ("text", "python", "typed"),
    [
        (Action.CHECK(Path("/a/my b.h5")), "fieldkit.check('/a/my b.h5')", "fieldkit check '/a/my b.h5'"),
        (Action.STOP() + " ends it", "fieldkit.stop() ends it", "fieldkit stop ends it"),
        (
            Action.ESTIMATE(present=True),
            "fieldkit.estimate(session, present=True)",
            "fieldkit estimate --campaign",
        ),
        ("omit " + Argument("zone"), "omit zone", "omit --zone"),
        (Argument("zone", "Asia/Tokyo"), "zone='Asia/Tokyo'", "--zone Asia/Tokyo"),
        (Argument("name", "logger"), "name='logger'", "--as logger"),
        (Argument("offset_s", 12.0), "offset_s=12.0", "--clock-offset 12.0"),
    ],
)
def test_a_text_has_the_form_of_the_place_where_it_is_read(text, python, typed):
    with click.Context(main) as context:
        context.meta[RUNNING] = main.get_command(context, "import")
        assert (str(text), in_commands(text)) == (python, typed)


def test_an_error_has_its_place_and_next_step_as_data():
    error = ConfigError("holds counts", place=Path("a.tiff"), fix="omit " + Argument("unit"))
    assert error.fix == "omit " + Argument("unit")
    assert str(error) == "a.tiff: holds counts\n  fix: omit unit"


def test_a_setting_has_the_form_of_the_place_where_it_is_read():
    setting = Argument("settings", {"site.body": "moon"})
    assert str(setting) == "settings={'site.body': 'moon'}"
    with click.Context(main) as context:
        context.meta[RUNNING] = main.get_command(context, "estimate")
        assert (str(setting), in_commands(setting)) == (
            "settings={'site.body': 'moon'}",
            "--set site.body=moon",
        )
