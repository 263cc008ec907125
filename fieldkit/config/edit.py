"""Changes to a ``fieldkit.toml`` that keep its comments and its order."""

from __future__ import annotations

import codecs
import os
import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT, Table

from fieldkit.config.load import mistakes_in, read_text
from fieldkit.config.mistakes import ConfigMistakesError
from fieldkit.config.template import assignment
from fieldkit.errors import ConfigError, StorageError


def add_region(file: Path, region: Mapping[str, Any]) -> None:
    """Append a ``[[region]]``; raises `ConfigMistakesError` if the new one makes a mistake."""
    before = _read(file)
    _regions(file, tomlkit.parse(before))
    lines = [assignment(key, value) for key, value in region.items()]
    text = "\n".join([before.rstrip("\r\n"), "", "[[region]]", *lines, ""])
    index = len(tomllib.loads(text)["region"]) - 1
    _write_sound(file, text, index, f"the new region {region['name']!r}")


def change_region(file: Path, name: str, changes: Mapping[str, Any]) -> None:
    """Give keys of the region called `name` other values.

    Raises `ConfigError` if there is none, `ConfigMistakesError` if it would be wrong then.
    """
    document = tomlkit.parse(_read(file))
    regions, index = _find(file, document, name)
    _change(regions[index], changes)
    _write_sound(file, tomlkit.dumps(document), index, f"region {name!r}")


def remove_region(file: Path, name: str) -> None:
    """Take out the region called `name`; raises `ConfigError` if there is none."""
    document = tomlkit.parse(_read(file))
    regions, index = _find(file, document, name)
    del regions[index]
    if not regions:
        del document["region"]
    _write(file, tomlkit.dumps(document))


def _find(file: Path, document: tomlkit.TOMLDocument, name: str) -> tuple[AoT, int]:
    regions = _regions(file, document)
    names = [region.get("name") for region in regions]
    if name not in names:
        there = f"there are {', '.join(map(str, names))}" if names else "there is none"
        raise ConfigError(f"no region is called {name!r}", fix=there)
    return regions, names.index(name)


def _regions(file: Path, document: tomlkit.TOMLDocument) -> AoT:
    """Every ``[[region]]``; raises `ConfigError` where regions are written in another way."""
    regions = document.get("region", tomlkit.aot())
    if not isinstance(regions, AoT):
        raise ConfigError(
            f"{file} has its regions inline, as region = ...: these can only be changed by hand",
            fix=f"edit {file}: write each as a [[region]] of its own, and take out region = ...",
        )
    return regions


def _change(region: Table, changes: Mapping[str, Any]) -> None:
    """Set keys; new ones come after the last, before what already belongs to the next table."""
    body, after = region.value.body, []
    while body and body[-1][0] is None:
        after.append(body.pop())
    region.update(changes)
    body.extend(reversed(after))


def _write_sound(file: Path, text: str, index: int, where: str) -> None:
    """Write, unless region number `index` has a mistake in it."""
    found = [said for _, said in mistakes_in(text, file) if said.path[:2] == ("region", index)]
    if found:
        raise ConfigMistakesError([(where, said) for said in found], fix="nothing was changed")
    _write(file, text)


def _read(file: Path) -> str:
    text = read_text(file, newline="")
    mistakes_in(text, file)  # raises where the text is no TOML
    return text


def _write(file: Path, text: str) -> None:
    """Replace the file as a whole, so that a power cut leaves the old or the new one."""
    file = file.resolve()  # a link stays a link
    draft = file.with_name(f".{file.name}.new")
    try:
        draft.touch()
        shutil.copymode(file, draft)
        draft.write_bytes(_encoded(text, file.read_bytes()))
        os.replace(draft, file)
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error


def _encoded(text: str, before: bytes) -> bytes:
    """The text with the line ends and the byte order mark that the file had before."""
    if b"\r\n" in before and before.count(b"\r\n") == before.count(b"\n"):
        text = text.replace("\r\n", "\n").replace("\n", "\r\n")
    mark = codecs.BOM_UTF8 if before.startswith(codecs.BOM_UTF8) else b""
    return mark + text.encode()
