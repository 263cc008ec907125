"""Texts by their keys: one catalogue per language, ``languages/CODE.json``, with a slot for each value.

What is found or happens is a key with values, so that another language is one file with the keys and slots of
``en.json``; the command line writes English.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Any, Self

_FOLDER = resources.files("fieldkit") / "languages"
ENGLISH = "en"
LANGUAGES: tuple[str, ...] = tuple(sorted(file.name.removesuffix(".json") for file in _FOLDER.iterdir()))
"""Codes of the languages that have a catalogue (ISO 639-1)."""


@cache
def phrases(language: str = ENGLISH) -> dict[str, str]:
    """The texts of a language by their keys; ``{name}`` in them is a slot for a value."""
    texts: dict[str, str] = json.loads((_FOLDER / f"{language}.json").read_text(encoding="utf-8"))
    return texts


class Words(str):
    """An English text of the catalogue that keeps its key and its values, for other languages."""

    key: str
    data: dict[str, Any]

    def __new__(cls, key: str, **data: Any) -> Self:
        """The text of a key with its slots filled."""
        words = super().__new__(cls, phrases()[key].format_map(data))
        words.key, words.data = key, data
        return words

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Any]]:
        return (self.key,), self.data


def text_document(text: str) -> dict[str, Any]:
    """A text with its key and values, if it has them, as a JSON object."""
    return {"text": text} | ({"key": text.key, "data": text.data} if isinstance(text, Words) else {})
