"""Where a campaign's configuration is, text files that people write, and the lines of their TOML keys."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action

FILE_NAME = "fieldkit.toml"


class NoCampaignError(ConfigError):
    """There is no ``fieldkit.toml`` in a folder or above it."""


def find_campaign(start: Path) -> Path:
    """The ``fieldkit.toml`` of `start` or of the nearest folder above it.

    Raises `NoCampaignError` if there is none.
    """
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / FILE_NAME).is_file():
            return folder / FILE_NAME
    raise NoCampaignError(
        f"no {FILE_NAME} here or above",
        place=start.resolve(),
        fix="change to a campaign folder, name one, or create one: " + Action.CREATE_CAMPAIGN(),
    )


KeyPath = tuple[str | int, ...]
"""Place of a value in a document: keys, and indices of arrays of tables."""


def key_lines(text: str) -> dict[KeyPath, int]:
    """Line number, from 1, of every key and table of a valid TOML document.

    Values inside an array have no entry: look up the key that holds them.
    """
    lines: dict[KeyPath, int] = {}
    counts: dict[KeyPath, int] = {}
    table: KeyPath = ()
    for number, statement in _statements(text):
        if statement.lstrip().startswith("["):
            table = _open_table(statement, counts)
            lines.setdefault(table[:-1] if isinstance(table[-1], int) else table, number)
            lines.setdefault(table, number)
        else:
            _note(tomllib.loads(statement), table, number, lines)
    return lines


def table_in(document: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A table of a plain document; empty where there is none, or something else."""
    table = document.get(name)
    return table if isinstance(table, dict) else {}


def regions_in(document: Mapping[str, Any]) -> list[tuple[KeyPath, dict[str, Any]]]:
    """The tables of regions of a plain document with their places, malformed ones left out."""
    regions = document.get("region")
    listed = enumerate(regions if isinstance(regions, list) else ())
    return [(("region", index), region) for index, region in listed if isinstance(region, dict)]


def toml_lines(text: str) -> list[str]:
    """The lines of a TOML text with their line ends, which are LF or CRLF only.

    `str.splitlines` would also split at U+2028 and the like, which comments and strings may contain.
    """
    return list(io.StringIO(text, newline=""))


def is_toml(text: str) -> bool:
    """True if a text is TOML."""
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Every table header and assignment, with the number of its first line."""
    first, piece = 0, ""
    for number, ended in enumerate(toml_lines(text), start=1):
        line = ended.rstrip("\r\n")
        if not piece and (not line.strip() or line.lstrip().startswith("#")):
            continue
        first, piece = (first, f"{piece}\n{line}") if piece else (number, line)
        if is_toml(piece):
            yield first, piece
            piece = ""


def _open_table(header: str, counts: dict[KeyPath, int]) -> KeyPath:
    """The path a header opens; elements of ``[[name]]`` are counted, ``[name.x]`` belongs to the last."""
    path: KeyPath = ()
    value: Any = tomllib.loads(header)
    while isinstance(value, dict) and value:
        key, value = next(iter(value.items()))
        path += (key,)
        if isinstance(value, list):
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path += (counts[path],)
    return path


def _note(value: Any, path: KeyPath, number: int, lines: dict[KeyPath, int]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            lines.setdefault((*path, key), number)
            _note(item, (*path, key), number, lines)
