"""The language of a page, what is wrong with a region or a session in it, and refusals of the page itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldkit.model.errors import RefusedError
from fieldkit.phrases import ENGLISH, LANGUAGES, Words, in_language, phrases, text_of


def preferred_language(accepted: str, chosen: str = "") -> str:
    """The language `chosen` on the page, or else the first known one of an ``Accept-Language`` header."""
    ordered = [part.partition(";")[0].strip()[:2].lower() for part in (chosen, *accepted.split(","))]
    return next((language for language in ordered if language in LANGUAGES), ENGLISH)


def issue_document(issue: Mapping[str, Any], language: str) -> dict[str, Any]:
    """What is wrong with a region or a session, in a language.

    The browser puts what happened, in its own words, into ``{event}``.
    """
    what, data = issue.get("what", ""), {**issue.get("data", {}), "event": "{event}"}
    text = text_of({"text": issue["text"], "key": issue.get("key"), "data": data})
    about = phrases(language).get(f"issue.about.{what}", what)
    return {"what": about, "text": in_language(text, language), "happened": data.get("happened")}


class PageError(RefusedError):
    """The page itself refuses, by the text ``refused.KEY`` with its values."""

    def __init__(self, key: str, **values: Any) -> None:
        super().__init__(Words(f"refused.{key}", **values))
