"""The name that a misspelt one was meant to be: the one place of suggestions."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from fieldkit.phrases import Words


def nearest(name: str, names: Iterable[str]) -> str | None:
    """The one of `names` that is spelled most like `name`, whatever its capitals; None if none is."""
    by_letters = {known.casefold(): known for known in names}
    near = get_close_matches(name.casefold(), by_letters, n=1)
    return by_letters[near[0]] if near else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """``did you mean camera?``, or else the names there are."""
    listed = list(names)
    if near := nearest(name, listed):
        return Words("fix.near", name=near)
    return Words("fix.names", names=", ".join(listed[:50])) if listed else Words("fix.none")
