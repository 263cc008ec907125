"""Changes to a ``fieldkit.toml`` that keep its comments and its order."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT

from fieldkit.config.load import mistakes_in
from fieldkit.config.mistakes import ConfigMistakesError
from fieldkit.config.template import assignment
from fieldkit.errors import ConfigError, StorageError


def add_region(file: Path, region: Mapping[str, Any]) -> None:
    """Append a ``[[region]]``; raises `ConfigMistakesError` if the new one makes a mistake."""
    lines = [assignment(key, value) for key, value in region.items()]
    text = "\n".join([_read(file).rstrip("\n"), "", "[[region]]", *lines, ""])
    index = len(tomllib.loads(text)["region"]) - 1
    _write_sound(file, text, index, f"the new region {region['name']!r}")


def change_region(file: Path, name: str, changes: Mapping[str, Any]) -> None:
    """Give keys of the region called `name` other values.

    Raises `ConfigError` if there is none, `ConfigMistakesError` if it would be wrong then.
    """
    document = tomlkit.parse(_read(file))
    regions, index = _find(document, name)
    regions[index].update(changes)
    _write_sound(file, tomlkit.dumps(document), index, f"region {name!r}")


def remove_region(file: Path, name: str) -> None:
    """Take out the region called `name`; raises `ConfigError` if there is none."""
    document = tomlkit.parse(_read(file))
    regions, index = _find(document, name)
    del regions[index]
    if not regions:
        del document["region"]
    _write(file, tomlkit.dumps(document))


def _find(document: tomlkit.TOMLDocument, name: str) -> tuple[AoT, int]:
    regions = document.get("region")
    names = [region.get("name") for region in regions] if isinstance(regions, AoT) else []
    if not isinstance(regions, AoT) or name not in names:
        there = f"there are {', '.join(map(str, names))}" if names else "there is none"
        raise ConfigError(f"no region is called {name!r}", fix=there)
    return regions, names.index(name)


def _write_sound(file: Path, text: str, index: int, where: str) -> None:
    """Write, unless region number `index` has a mistake in it."""
    found = [said for _, said in mistakes_in(text, file) if said.path[:2] == ("region", index)]
    if found:
        raise ConfigMistakesError([(where, said) for said in found], fix="nothing was changed")
    _write(file, text)


def _read(file: Path) -> str:
    text = file.read_text(encoding="utf-8")
    mistakes_in(text, file)  # raises where the text is no TOML
    return text


def _write(file: Path, text: str) -> None:
    """Replace the file as a whole, so that a power cut leaves the old or the new one."""
    draft = file.with_name(f".{file.name}.new")
    try:
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, file)
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error
