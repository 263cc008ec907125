"""The language of a page, and refusals by the keys of its catalogue (`fieldkit.phrases`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldkit.model.errors import RefusedError
from fieldkit.phrases import ENGLISH, LANGUAGES, phrases


def preferred_language(accepted: str, chosen: str = "") -> str:
    """The language `chosen` on the page, or else the first known one of an ``Accept-Language`` header."""
    ordered = [part.partition(";")[0].strip()[:2].lower() for part in (chosen, *accepted.split(","))]
    return next((language for language in ordered if language in LANGUAGES), ENGLISH)


def issue_document(issue: Mapping[str, Any], language: str) -> dict[str, Any]:
    """What is wrong with a region or a session, in a language; the browser fills the slots of the text."""
    texts, what = phrases(language), issue.get("what", "")
    text = texts.get(issue.get("key", ""), issue["text"])
    return {"what": texts.get(f"issue.about.{what}", what), "text": text, "data": issue.get("data")}


class PageError(RefusedError):
    """The page itself refuses: `key` of the text ``refused.KEY``, and the values of its slots."""

    def __init__(self, key: str, **values: Any) -> None:
        super().__init__(phrases()[f"refused.{key}"].format_map(values))
        self.key = f"refused.{key}"
        self.values = values
