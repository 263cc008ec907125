"""Texts by their keys: one catalogue per language, ``languages/CODE.json``, with a slot for each value.

What is found or happens is a key with values, so that another language is one file with the keys and slots of
``en.json``; the command line writes English.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any, Self

_FOLDER = Path(__file__).with_name("languages")
ENGLISH = "en"
LANGUAGES: tuple[str, ...] = tuple(sorted(file.stem for file in _FOLDER.iterdir()))
"""Codes of the languages that have a catalogue (ISO 639-1)."""


@cache
def phrases(language: str = ENGLISH) -> dict[str, str]:
    """The texts of a language by their keys.

    ``{name}`` in them is a slot for a value, ``{name:sample|samples}`` one for a count with its noun.
    """
    texts: dict[str, str] = json.loads((_FOLDER / f"{language}.json").read_text(encoding="utf-8"))
    return texts


def counted(count: Any, noun: str, nouns: str = "") -> str:
    """A count with its noun: ``1 session``, ``2 sessions``; `nouns` is the plural of an irregular one."""
    return f"{count} {noun if str(count) == '1' else nouns or noun + 's'}"


class _Filler(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        """The text of a value, before its noun where the slot has one."""
        return counted(value, *format_spec.split("|")) if format_spec else str(value)


class Words(str):
    """An English text of the catalogue that keeps its key and its values, for other languages.

    A value may be another such text, or a list of them.
    """

    key: str
    data: dict[str, Any]

    def __new__(cls, key: str, **data: Any) -> Self:
        """The text of a key with its slots filled."""
        words = super().__new__(cls, _filled(key, data, ENGLISH))
        words.key, words.data = key, data
        return words

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Any]]:
        return (self.key,), self.data


def _filled(key: str, data: Mapping[str, Any], language: str) -> str:
    values = {name: in_language(value, language) for name, value in data.items()}
    return _Filler().vformat(phrases(language)[key], (), values)


def in_language(text: Any, language: str) -> Any:
    """A text, or a list of them as one, in a language; what has no key stays as it is."""
    if isinstance(text, list):
        return phrases(language)["language.between"].join(in_language(part, language) for part in text)
    return _filled(text.key, text.data, language) if isinstance(text, Words) else text


def text_document(text: Any) -> Any:
    """A text with its key and values, if it has them, or a list of texts, as JSON objects."""
    if isinstance(text, list):
        return [text_document(part) for part in text]
    if not isinstance(text, Words):
        return {"text": text}
    texts = {name: text_document(part) for name, part in text.data.items() if isinstance(part, Words | list)}
    return {"text": str(text), "key": text.key, "data": text.data | texts}


def text_of(document: Any) -> Any:
    """The text, or texts, of what `text_document` made; in English if its key is of a later version."""
    if isinstance(document, list):
        return [text_of(part) for part in document]
    if not isinstance(document, Mapping) or not {"text"} <= document.keys() <= {"text", "key", "data"}:
        return document
    if document.get("key") not in phrases():
        return document["text"]
    return Words(document["key"], **{name: text_of(value) for name, value in document["data"].items()})
