"""The texts of the page: one catalogue per language, ``languages/CODE.json``, whose keys the browser uses.

What happened travels to browsers as a key with values, never as a sentence. A language is one file with the
keys and slots of ``en.json``.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Any

from fieldkit.model.errors import RefusedError

_FOLDER = resources.files("fieldkit.page") / "languages"
ENGLISH = "en"
LANGUAGES: tuple[str, ...] = tuple(sorted(file.name.removesuffix(".json") for file in _FOLDER.iterdir()))
"""Codes of the languages that have a catalogue (ISO 639-1)."""


@cache
def phrases(language: str = ENGLISH) -> dict[str, str]:
    """The texts of a language by their keys; ``{name}`` in them is a slot for a value."""
    texts: dict[str, str] = json.loads((_FOLDER / f"{language}.json").read_text(encoding="utf-8"))
    return texts


def preferred_language(accepted: str, chosen: str = "") -> str:
    """The language `chosen` on the page, or else the first known one of an ``Accept-Language`` header."""
    ordered = [part.partition(";")[0].strip()[:2].lower() for part in (chosen, *accepted.split(","))]
    return next((language for language in ordered if language in LANGUAGES), ENGLISH)


class PageError(RefusedError):
    """The page itself refuses: `key` of the text ``refused.KEY``, and the values of its slots."""

    def __init__(self, key: str, **values: Any) -> None:
        super().__init__(phrases()[f"refused.{key}"].format_map(values))
        self.key = f"refused.{key}"
        self.values = values
