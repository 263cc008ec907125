"""The next step after a problem, as data: an action with its values, and the arguments that it concerns.

An error has ``fix="check the path; " + Action.LIST_SESSIONS() + " shows the sessions"``: `str` writes calls
and arguments of Python, the command line commands and options.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias

from fieldkit.phrases import Words

KEYS = re.compile(r"(?:--[\w-]+|\w+\[\d+\](?:\.\w+)*): ")
"""Options and keys in front of what a text says about them."""
_COMMANDS = re.compile(r"--\w|\bfieldkit\b|\.toml\b")


class Phrase:
    """Part of a text that each reader sees in their own form; ``+`` joins it with others."""

    def __add__(self, other: Text) -> Sentence:
        return Sentence((*_parts(self), *_parts(other)))

    def __radd__(self, other: str) -> Sentence:
        return Sentence((other, *_parts(self)))


Text: TypeAlias = str | Phrase


@dataclass(frozen=True)
class Sentence(Phrase):
    """Words with actions and arguments between them."""

    parts: tuple[Text, ...]

    @classmethod
    def listing(cls, phrases: Sequence[Phrase]) -> Sentence:
        """The phrases with commas between them."""
        return cls(tuple(part for phrase in phrases for part in (", ", phrase))[1:])

    def __str__(self) -> str:
        return "".join(map(str, self.parts))


@dataclass(frozen=True)
class Argument(Phrase):
    """An argument of a function, which is an option of its command; None is without a value."""

    name: str
    value: Any = None

    def __str__(self) -> str:
        return self.name if self.value is None else f"{self.name}={_literal(self.value)}"


class Action(Enum):
    """A person's next action; the value is its call in Python. Called with values, it is a `Step`."""

    ADD_DEVICES = "campaign.add_devices()"
    ADD_REGION = "campaign.add_region(name, points=[...])"
    CALIBRATE = "fieldkit.calibrate"
    CHECK = "fieldkit.check(session)"
    CORRECT_CLOCK = "fieldkit.results.check.correct_clock(session)"
    CREATE_CAMPAIGN = "fieldkit.init_campaign(folder)"
    DOCTOR = "fieldkit.doctor()"
    ESTIMATE = "fieldkit.estimate(session)"
    EXPORT = "fieldkit.export(session)"
    FIND_DEVICES = "fieldkit.find_devices()"
    HOST_CLOCK = "fieldkit.calibrate.host_clock(config, host_ns=..., shown=...)"
    IMPORT = "fieldkit.import_recording(source)"
    IMPORT_INTO = "fieldkit.import_into(session, source)"
    INSTALL_SERVICE = "fieldkit.recording.service.install_service(unit)"
    LIST_SESSIONS = "fieldkit.open_campaign().sessions"
    RECORD = "fieldkit.record()"
    RECOVER = "fieldkit.sessions.recovery.recover(session)"
    REMOVE_SERVICE = "fieldkit.recording.service.remove_service()"
    STATUS = "fieldkit.status()"
    STOP = "fieldkit.stop()"
    UDEV_RULES = "fieldkit.recording.doctor.udev_rules(folder)"

    def __call__(self, *values: Any, **arguments: Any) -> Step:
        """The action with its values: of a session, its file."""
        return Step(self, values, tuple(Argument(*item) for item in arguments.items()))


@dataclass(frozen=True)
class Step(Phrase):
    """An action with its values."""

    action: Action
    values: tuple[Any, ...] = ()
    arguments: tuple[Argument, ...] = ()

    def __str__(self) -> str:
        call = self.action.value
        if not call.endswith(")"):
            return ".".join((call, *self.values))
        name, _, names = call.partition("(")
        positional = ", ".join(map(_literal, self.values)) or names.rstrip(")")
        inside = ", ".join(filter(None, (positional, *map(str, self.arguments))))
        return f"{name}({inside})"


def in_words(text: Text) -> str:
    """A text with its actions and arguments in plain words, for readers without commands and calls."""
    match text:
        case Sentence(parts):
            return "".join(map(in_words, parts))
        case Step(action):
            return Words(f"next.{action.name.lower()}")
        case Argument(name, value):
            return name.replace("_", " ") if value is None else Words("fix.value", value=str(value))
    return text if isinstance(text, str) else str(text)


def next_step(fix: Text | None) -> str:
    """A fix by the catalogue, for readers without commands: empty if only a command would do."""
    words = [word for part in _parts(fix or "") if isinstance(word := in_words(part), Words)]
    if words:
        return Words("text.all", texts=words)
    return Words("text.original", text=fix) if isinstance(fix, str) and not _COMMANDS.search(fix) else ""


def _parts(text: Text) -> tuple[Text, ...]:
    return text.parts if isinstance(text, Sentence) else (text,)


def _literal(value: Any) -> str:
    return repr(os.fspath(value) if isinstance(value, os.PathLike) else value)
