"""Secrets written into a configuration, which every session would store: found by their form and refused.

Passwords and tokens are read from files of their own. The address of an ntfy topic is a secret, too: who has
it can read and write.
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
_TOPIC = re.compile(r"\bntfy\.sh/\w|\btk_\w{20,}", re.IGNORECASE)
_HOST_AND_TOPIC = re.compile(r"([^:/@]+@)?[^:/@]+(:\d+)?/.*")
_OPTIONS = re.compile(
    rf"(?:^|\s)(?:--?{_WORD}[ =]|-u ?|--user[ =])\S|\b(?:bearer|basic) \S{{8}}|\bauthorization:",
    re.IGNORECASE,
)
"""A secret among the words of a command, such as curl's."""
_STORED = "which every session would store"
_NTFY = (
    f"an ntfy topic is a secret, {_STORED}; write its address into a file and name that: "
    'ntfy_file = "ntfy.txt", as ntfy_token_file does for a token'
)
_MQTT = (
    f"holds a password, {_STORED}; write mqtt://USER@HOST/TOPIC here, and the password into the file "
    "that mqtt_password_file names"
)
_COMMAND = f"holds a password, token or ntfy topic, {_STORED}; start a script that reads it from a file"
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
    is_found = _URL.search(text) or _TOPIC.search(text)
    if path == ("alarms", "ntfy"):
        return _NTFY
    if path == ("alarms", "mqtt"):
        return _MQTT if is_found or _has_password(text) else None
    if path == ("alarms", "command"):
        return _COMMAND if is_found or _OPTIONS.search(text) else None
    if key.endswith("_file"):
        return _FILE if is_found or "://" in text else None
    return _OTHER if is_found or _KEY.fullmatch(key) else None


def _has_password(address: str) -> bool:
    """True if an address has a colon before its last at sign that is not the one of ``HOST:PORT/``."""
    before = address.rpartition("://")[2].rpartition("@")[0]
    return ":" in before and not _HOST_AND_TOPIC.fullmatch(before)
