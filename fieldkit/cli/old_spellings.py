"""Spellings of options that the next version drops; until then they work, with a warning."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple


class Spelling(NamedTuple):
    """Today's name of an option; with a `unit`, of the old spelling with a bare number."""

    name: str
    unit: str | None = None


MINUTES_WINDOW = Spelling("--window", "m")
OPTION = Spelling("--option")
ADDRESS = Spelling("--address")
OLD = {
    "calibrate clock": {"--told": Spelling("--at")},
    "calibrate horizon": {"--at": Spelling("--place", ""), "--time": Spelling("--at")},
    "calibrate surface": {"--bed": Spelling("--region")},
    "decode": {"-o": OPTION},
    "estimate": {"--reference": Spelling("--reference-facet")},
    "import": {"--offset": Spelling("--clock-offset")},
    "init": {"--timezone": Spelling("--zone")},
    "mark": {"--to": Spelling("--until")},
    "page": {"--on": ADDRESS},
    "plan": {
        "--window": MINUTES_WINDOW, "--step": Spelling("--step", "m"), "--minutes": Spelling("--for", "m"),
    },
    "roi check": {"--on": Spelling("--session")},
    "selftest": {"--port": Spelling("--device"), "-o": OPTION},
    "service install": {"--on": ADDRESS},
    "study": {"--minutes": MINUTES_WINDOW},
}  # fmt: skip
"""By command: old spelling, new one."""

_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def respelt(command: str, args: Sequence[str]) -> tuple[list[str], list[str]]:
    """Arguments of a command with today's spellings, and a note on each old one."""
    old, notes = OLD.get(command, {}), []
    words = [
        part for word in args for part in (word.split("=", 1) if word.partition("=")[0] in old else [word])
    ]
    for index, (word, value) in enumerate(pairwise([*words, ""])):
        new = old.get(word)
        if new is None or (new.unit is not None and not _NUMBER.fullmatch(value)):
            continue
        words[index] = new.name
        if new.unit:
            words[index + 1] = value + new.unit
        now = " ".join(words[index : index + 2])
        notes.append(f"{word} {value} is now {now}; the next version drops the old spelling")
    return words, notes
