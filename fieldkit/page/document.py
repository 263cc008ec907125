"""The field page as one HTML document: markup, style, script and colour table joined, with one nonce."""

from __future__ import annotations

import base64
import functools
import json
from importlib import resources

from fieldkit.palettes import STOPS, palette

SCRIPTS = (
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
    "start.js",
)
"""The parts of the script, in the order in which they run."""


def document(nonce: str) -> str:
    """The document for one answer; `nonce` is what its content security policy names.

    The nonce must consist of letters, digits, ``-`` and ``_``, and must not be used twice.
    """
    return _document().replace("{{nonce}}", nonce)


@functools.cache
def _document() -> str:
    """The document but for its nonce."""
    script = "\n".join(_part(name) for name in SCRIPTS)
    colours = base64.b64encode(palette().tobytes()).decode()
    page = _part("page.html").replace("{{style}}", _part("page.css")).replace("{{script}}", script)
    return page.replace("{{inferno}}", colours).replace("{{palettes}}", json.dumps(STOPS))


def _part(name: str) -> str:
    return (resources.files("fieldkit.page") / "browser" / name).read_text(encoding="utf-8").rstrip("\n")
