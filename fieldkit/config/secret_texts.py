"""Secrets written into a configuration, which every session would store: found by their form and refused.

Passwords and tokens are read from files of their own. The addresses of alarm services hold tokens, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from fieldkit.config.toml_lines import KeyPath
from fieldkit.config.validation import Mistake

_WORD = (
    r"[\w.-]*(?:password|passwd|passphrase|token|secret|api[_-]?key|access[_-]?key|credentials?|signature)"
)
_KEY = re.compile(rf"{_WORD}|pwd|auth", re.IGNORECASE)
_URL = re.compile(
    rf"://[^\s/?#]*:[^\s/?#]*@|https?://[^\s/?#]+@|://\S*[?&;#](?:{_WORD}|auth|key|pwd|pw|pass|sig)=[^\s&]",
    re.IGNORECASE,
)
"""A password or token in front of the host, or in the query."""
_SERVICE = re.compile(
    r"\b(?:tgram|signals?|matrixs?|msteams|workflows?|slack|discord|ntfys?|mailtos?|pover|gotifys?|jsons?)://"
    r"|\bntfy\.sh/\w|\btk_\w{20,}|api\.telegram\.org/bot|hooks\.slack\.com/|/api/webhooks/|webhook\.office",
    re.IGNORECASE,
)
"""Addresses of services that alarms are sent to, which hold tokens or are secret themselves."""
_OPTIONS = re.compile(
    rf"(?:^|\s)(?:--?{_WORD}[ =]|-u ?|--user[ =])\S|\b(?:bearer|basic) \S{{8}}|\bauthorization:",
    re.IGNORECASE,
)
"""A secret among the words of a command, such as curl's."""
_STORED = "which every session would store"
_SERVICES = f"can hold a token, {_STORED}; write addresses into a private file, which services_file names"
_COMMAND = f"holds a password or token, {_STORED}; start a script that reads it from a file"
_FILE = "holds the secret itself; write it into a file, and here that file's name"
_OTHER = f"looks like a password or token, {_STORED}; keep it in a file of its own"


def secrets_in(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Texts of a configuration that look like a secret: where, and what to do instead, without the secret."""
    for path, value in _values(document, ()):
        if value != "" and (message := _message(path, value)):
            yield Mistake(path, message)


def _values(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, str | int]]:
    """Every text and whole number with its path; the words of a command as one text."""
    if path == ("alarms", "command") and isinstance(value, list):
        yield path, " ".join(map(str, value))
    elif isinstance(value, Mapping | list):
        parts = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, part in parts:
            yield from _values(part, (*path, key))
    elif isinstance(value, str | int) and not isinstance(value, bool):
        yield path, value


def _message(path: KeyPath, value: str | int) -> str | None:
    text, key = str(value), str(path[-1])
    is_secret = _URL.search(text) or _SERVICE.search(text)
    if path == ("alarms", "command"):
        return _COMMAND if is_secret or _OPTIONS.search(text) else None
    if key.endswith("_file"):
        return _FILE if is_secret or "://" in text else None
    if path[0] == "alarms" and "://" in text:
        return _SERVICES
    return _OTHER if is_secret or _KEY.fullmatch(key) else None
