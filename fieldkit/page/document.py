"""The field page as one HTML document: markup, style, script and colour table joined, with one nonce."""

from __future__ import annotations

import base64
import functools
import json
import re
from html import escape
from importlib import resources

from fieldkit.palettes import STOPS, palette
from fieldkit.phrases import ENGLISH, LANGUAGES, phrases

SCRIPTS = (
    "phrases.js",
    "dom.js",
    "socket.js",
    "units.js",
    "cards.js",
    "plot.js",
    "overlay.js",
    "picture.js",
    "drawing.js",
    "suggest.js",
    "status.js",
    "alarms.js",
    "actions.js",
    "marks.js",
    "past.js",
    "sessions.js",
    "compare.js",
    "appearance.js",
    "start.js",
)
"""The parts of the script, in the order in which they run."""
SENT = ("done.", "error.", "fix.", "issue.", "next.", "text.")
"""Texts of answers, which the server sends in the browser's language."""
_GROUP = re.compile(r'(?:wordFor\("|`)([\w.]+?)(?:"|\.\$)')
"""A group of texts that scripts choose from by a name."""
_SLOT = re.compile(r"\{\{([\w.-]+)\}\}")


def document(nonce: str, language: str = ENGLISH) -> str:
    """The document for one answer, in one of the `LANGUAGES`; `nonce` is what its security policy names.

    The nonce must consist of letters, digits, ``-`` and ``_``, and must not be used twice.
    """
    return _document(language).replace("{{nonce}}", nonce)


@functools.cache
def _document(language: str) -> str:
    """The document but for its nonce."""
    texts = phrases(language)
    languages = {code: phrases(code)["language.name"] for code in LANGUAGES}
    markup, code = _part("page.html"), "\n".join(map(_part, SCRIPTS))
    groups = tuple(_GROUP.findall(code))
    unnamed = {key for key in _SLOT.findall(markup) if f'"{key}"' not in code and not key.startswith(groups)}
    shown = {key: texts[key] for key in texts if key not in unnamed and not key.startswith(SENT)}
    data = {"texts": shown, "palettes": STOPS, "languages": languages}
    slots = {name: json.dumps(value, ensure_ascii=False) for name, value in data.items()}
    slots["inferno"] = base64.b64encode(palette().tobytes()).decode()
    script = _fill(code, slots)
    page = {"nonce": "{{nonce}}", "style": _part("page.css"), "script": script}
    return _fill(markup, {key: escape(text) for key, text in texts.items()} | page)


def _fill(text: str, slots: dict[str, str]) -> str:
    return _SLOT.sub(lambda slot: slots[slot[1]], text)


def _part(name: str) -> str:
    """A part without its lines of comment and its indentation, which no browser needs."""
    text = (resources.files("fieldkit.page") / "browser" / name).read_text(encoding="utf-8")
    return "\n".join(line.strip() for line in text.splitlines() if not line.lstrip().startswith(("//", "/*")))
