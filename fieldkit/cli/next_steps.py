"""Next steps as they are typed: commands and options in place of calls and arguments."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import click

from fieldkit.model.finding import Finding
from fieldkit.model.next_step import Action, Argument, Sentence, Step, Text

COMMANDS = {
    Action.ADD_DEVICES: "devices --add",
    Action.ADD_REGION: "roi add",
    Action.CALIBRATE: "calibrate",
    Action.CHECK: "check",
    Action.CORRECT_CLOCK: "check --apply",
    Action.CREATE_CAMPAIGN: "init DIR",
    Action.DOCTOR: "doctor",
    Action.ESTIMATE: "estimate",
    Action.EXPORT: "export",
    Action.FIND_DEVICES: "devices",
    Action.HOST_CLOCK: "calibrate clock --at",
    Action.IMPORT: "import",
    Action.IMPORT_INTO: "import --into SESSION",
    Action.INSTALL_SERVICE: "service install",
    Action.LIST_SESSIONS: "ls",
    Action.RECORD: "record",
    Action.RECOVER: "recover",
    Action.REMOVE_SERVICE: "service remove",
    Action.STATUS: "status",
    Action.STOP: "stop",
    Action.UDEV_RULES: "doctor --udev | sudo tee /etc/udev/rules.d/70-fieldkit.rules",
}
"""The command of each action."""
RUNNING = "fieldkit.command"
"""The key of the running command in ``ctx.meta``, whose options an argument names."""


def in_commands(text: Text) -> str:
    """A text with the commands and options that do what its steps and arguments do."""
    match text:
        case Sentence(parts):
            return "".join(map(in_commands, parts))
        case Step(action, values, arguments):
            words = COMMANDS[action]
            options = [_option(argument, _command(words)) for argument in arguments]  # imports the command
            return " ".join(["fieldkit", words, *map(_quote, values), *options])
        case Argument():
            context = click.get_current_context(silent=True)
            return _option(text, context.meta.get(RUNNING) if context else None)
    return str(text)


def finding_in_commands(finding: Finding) -> Finding:
    """A finding whose fix is for the terminal."""
    return replace(finding, fix=in_commands(finding.fix))


def _command(words: str) -> click.Command | None:
    context = click.get_current_context(silent=True)
    if context is None:
        return None
    command: click.Command | None = context.find_root().command
    for word in words.split():
        command = (isinstance(command, click.Group) and command.get_command(context, word)) or command
    return command


def _option(argument: Argument, command: click.Command | None) -> str:
    """An option and its value; one that the command lacks has the argument's name."""
    names = (option.opts[-1] for option in command.params if option.name == argument.name) if command else ()
    flag = next(iter(names), f"--{argument.name.replace('_', '-')}")
    return flag if argument.value in (None, True) else f"{flag} {_quote(argument.value)}"


def _quote(value: Any) -> str:
    """A value as it is typed; settings, and drivers of instruments, as ``KEY=VALUE``."""
    if isinstance(value, Mapping):
        return ",".join(f"{key}={_quote(setting)}" for key, setting in value.items()).replace("driver=", "")
    return shlex.quote(str(value))
