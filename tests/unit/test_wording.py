"""What to do next names calls and arguments in Python, commands and options at the command line."""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import fieldkit
from fieldkit.cli import main
from fieldkit.cli.common import CommandGroup
from fieldkit.model.errors import ConfigError
from fieldkit.model.wording import ARGUMENTS, CALLS, in_python, typed

ROOT = Path(__file__).parents[2]
OF_THE_TERMINAL = ("fieldkit/cli", "fieldkit/page", "fieldkit/study", "fieldkit/recording/service")
"""Places that no function of `fieldkit` reaches."""
ALSO = ("fieldkit/model/wording.py", "drivers/conformance.py", "fieldkit/config/secret_texts.py")


@pytest.mark.parametrize(
    ("typed_words", "python"),
    [
        ("--kelvin-per-count 0.01 (the maker's number)", "kelvin_per_count=0.01 (the maker's number)"),
        ("give it: --clock-offset +12s", "give it: offset_s=12"),
        ("give it: --zone Asia/Tokyo, or --zone UTC", 'give it: zone="Asia/Tokyo", or zone="UTC"'),
        ("--zone has no effect: the times are UTC", "zone has no effect: the times are UTC"),
        ("write it as --set surface.albedo=0.25", 'write it as settings={"surface.albedo": 0.25}'),
        ("fieldkit check /a/b.h5", 'fieldkit.check("/a/b.h5")'),
        ("fieldkit recover 'my day.h5'", 'fieldkit.sessions.recovery.recover("my day.h5")'),
        ("fieldkit check shows why", "fieldkit.check(session) shows why"),
        ("or create one: fieldkit init DIR", "or create one: fieldkit.init_campaign(folder)"),
        ("fieldkit roi check", "fieldkit roi check (in a terminal)"),
        ("edit /tmp/sand/fieldkit.toml", "edit /tmp/sand/fieldkit.toml"),
        (
            "fieldkit devices --add --instrument 10c4:ea60=text,unit=X",
            'campaign.add_devices({"10c4:ea60": {"driver": "text", "unit": X}})',
        ),
        ("fieldkit roi edit b15 --shrink 4", "fieldkit roi edit b15 --shrink 4 (in a terminal)"),
        ("fieldkit doctor --udev | sudo tee x", "fieldkit doctor --udev | sudo tee x"),
    ],
)
def test_commands_and_options_become_calls_and_arguments(typed_words, python):
    assert in_python(typed_words) == python
    assert in_python(python) == python  # an error that quotes another is worded once


def test_an_error_is_worded_for_where_it_is_read():
    error = ConfigError("--unit X is not a temperature", fix="--unit C; fieldkit ls")
    assert str(error) == 'unit="X" is not a temperature\n  fix: unit="C"; fieldkit.open_campaign().sessions'
    with typed():
        assert (error.message, error.fix) == ("--unit X is not a temperature", "--unit C; fieldkit ls")
    assert error.fix == 'unit="C"; fieldkit.open_campaign().sessions'


def strings() -> Iterator[tuple[str, str]]:
    """Every string that a function of `fieldkit` may raise, with ``{}`` for what it inserts."""
    for room in ("fieldkit", "drivers", "sessions", "calibration"):
        for file in sorted((ROOT / room).rglob("*.py")):
            place = str(file.relative_to(ROOT))
            if not place.startswith(OF_THE_TERMINAL) and place not in ALSO:
                yield from ((place, text) for text in strings_of(ast.parse(file.read_text("utf-8"))))


def strings_of(tree: ast.AST) -> Iterator[str]:
    alone = {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
    for joined in (one for one in ast.walk(tree) if isinstance(one, ast.JoinedStr)):
        alone |= {id(part) for part in joined.values}
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in joined.values)
    for one in ast.walk(tree):
        if isinstance(one, ast.Constant) and isinstance(one.value, str) and id(one) not in alone:
            yield one.value


def options() -> set[str]:
    root = click.Context(main, info_name="fieldkit")
    commands = [main.get_command(root, name) for name in main.list_commands(root)]
    every = [
        *commands,
        *(one for group in commands if isinstance(group, CommandGroup) for one in group.commands.values()),
    ]
    return {name for one in every for option in one.params for name in option.opts if name.startswith("--")}


def test_no_message_that_python_can_raise_is_left_with_a_command_or_an_option():
    names = "|".join(sorted((re.escape(name) for name in options()), key=len, reverse=True))
    commands = "|".join(call for call in CALLS)
    left = re.compile(rf"(?<![\w-])(?:{names})(?![\w-])|\bfieldkit (?:{commands})\b(?! --)")
    shell = ("--help", "python -m", "pip install", "sudo ", "gdalwarp", "rio edit-info", "--station")
    composed = ("roi edit {} --shrink {}", "--instrument {}X")  # tested above as they are raised
    found = [
        f"{place}: {text}"
        for place, text in strings()
        if left.search(in_python(text)) and "(in a terminal)" not in in_python(text)
        if " " in text and not any(one in text for one in (*shell, *composed))
    ]
    assert found == []


def test_every_call_exists():
    for call in CALLS.values():
        if path := re.match(r"fieldkit((?:\.\w+)+)", call):
            *modules, name = path[1].strip(".").split(".")
            home = importlib.import_module(".".join(["fieldkit", *modules]))
            assert callable(getattr(home, name)) or name == "calibrate"


def test_options_of_import_and_export_are_arguments_of_their_functions():
    context = click.Context(main)
    fields = {
        *inspect.signature(fieldkit.ImportOptions).parameters,
        *inspect.signature(fieldkit.export).parameters,
    }
    common = {"--json", "--quiet", "--verbose", "--no-color", "--no-input", "--into", "--out"}
    for name in ("import", "export"):
        given = {opt for one in main.get_command(context, name).params for opt in one.opts if opt[:2] == "--"}
        assert {ARGUMENTS[option] for option in given - common} <= fields
