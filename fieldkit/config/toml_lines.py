"""On which line of a TOML text each key stands; tomllib itself does not tell.

Statements are found by handing the text to tomllib piece by piece: a statement begins on a
line of its own and ends where the piece first parses.
"""

from __future__ import annotations

import io
import tomllib
from collections.abc import Iterator
from typing import Any

Path = tuple[str | int, ...]
"""Where a value stands in a document: keys, and indices of arrays of tables."""


def key_lines(text: str) -> dict[Path, int]:
    """Line number, from 1, of every key and table of a valid TOML document.

    Values inside an array have no line of their own: ask for the key that holds them.
    """
    lines: dict[Path, int] = {}
    counts: dict[Path, int] = {}
    table: Path = ()
    for number, statement in _statements(text):
        if statement.lstrip().startswith("["):
            table = _open_table(statement, counts)
            lines.setdefault(table[:-1] if isinstance(table[-1], int) else table, number)
            lines.setdefault(table, number)
        else:
            _note(tomllib.loads(statement), table, number, lines)
    return lines


def toml_lines(text: str) -> list[str]:
    """The lines of a TOML text, with their ends: only those of Windows and Unix end one.

    `str.splitlines` also ends a line at U+2028 and its like, which may stand in comments and strings.
    """
    return list(io.StringIO(text, newline=""))


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Every table header and assignment, with the number of its first line."""
    first, piece = 0, ""
    for number, ended in enumerate(toml_lines(text), start=1):
        line = ended.rstrip("\r\n")
        if not piece and (not line.strip() or line.lstrip().startswith("#")):
            continue
        first, piece = (first, f"{piece}\n{line}") if piece else (number, line)
        try:
            tomllib.loads(piece)
        except tomllib.TOMLDecodeError:
            continue
        yield first, piece
        piece = ""


def _open_table(header: str, counts: dict[Path, int]) -> Path:
    """The path a header opens; elements of ``[[name]]`` are counted, and ``[name.x]`` means the last one."""
    path: Path = ()
    value: Any = tomllib.loads(header)
    while isinstance(value, dict) and value:
        key, value = next(iter(value.items()))
        path += (key,)
        if isinstance(value, list):
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path += (counts[path],)
    return path


def _note(value: Any, path: Path, number: int, lines: dict[Path, int]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            lines.setdefault((*path, key), number)
            _note(item, (*path, key), number, lines)
