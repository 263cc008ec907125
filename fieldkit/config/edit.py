"""Changes to a ``fieldkit.toml``, one at a time, that keep its comments and its order."""

from __future__ import annotations

import codecs
import shutil
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomlkit

from fieldkit.config.files import read_text
from fieldkit.config.load import mistakes_in
from fieldkit.config.template import assignment
from fieldkit.config.toml_lines import KeyPath, key_lines, toml_lines
from fieldkit.config.validation import ConfigMistakesError
from fieldkit.disk import one_at_a_time, replacing
from fieldkit.model.errors import ConfigError, StorageError


def add_region(file: Path, region: Mapping[str, Any]) -> None:
    """Append a ``[[region]]``; raises `ConfigMistakesError` if it is invalid."""
    with one_at_a_time(file.resolve().parent):
        before = _read(file)
        index = len(_names(file, before))
        text = before.rstrip("\r\n") + "\n\n[[region]]\n" + _assignments(region)
        _write_checked(file, text, ("region", index), f"the new region {region['name']!r}")


def add_instrument(file: Path, path: Sequence[str], table: Mapping[str, Any]) -> None:
    """Add the table of an instrument, such as ``[lux]``: where it stands commented out, or else at the end.

    Raises `ConfigError` if there is one already, `ConfigMistakesError` if it is invalid.
    """
    with one_at_a_time(file.resolve().parent):
        before, header = _read(file), f"[{'.'.join(path)}]"
        added, lines = f"{header}\n{_assignments(table)}", toml_lines(before)
        place = next((place for place, line in enumerate(lines) if line.strip() == f"#{header}"), None)
        if place is None:
            lines.append(f"\n{added}" if before.endswith("\n") or not before else f"\n\n{added}")
        else:
            lines[place] = added
        _write_checked(file, "".join(lines), tuple(path), header)


def change_region(file: Path, name: str, changes: Mapping[str, Any]) -> None:
    """Change keys of the region `name`; None removes a key.

    Raises `ConfigError` if there is none, `ConfigMistakesError` if the result is invalid.
    """
    with one_at_a_time(file.resolve().parent):
        text = _read(file)
        index = _find(file, text, name)
        before, region, after = _cut(text, index)
        document = tomlkit.parse(region)
        document["region"][0].update({key: value for key, value in changes.items() if value is not None})
        redrawn = ["points_m"] if "points_px" in changes else []  # in pixels, no longer on the ground
        for key in [*redrawn, *(key for key, value in changes.items() if value is None)]:
            document["region"][0].pop(key, None)
        text = before + tomlkit.dumps(document) + after
        _write_checked(file, text, ("region", index), f"region {name!r}")


def set_key(file: Path, table: str, key: str, value: Any) -> None:
    """Set a key of a table, such as ``[site]``; raises `ConfigError` if that is not a table of its own."""
    with one_at_a_time(file.resolve().parent):
        text = _read(file)
        lines, where, entry = toml_lines(text), key_lines(text), f"{assignment(key, value)}\n"
        if (first := where.get((table, key))) is not None:
            lines[first - 1 : _end_of_value(lines, first)] = [entry]
        elif (header := where.get((table,))) is not None:
            lines.insert(header, entry)
        else:
            lines.append(f"\n[{table}]\n{entry}")
        changed = "".join(lines)
        if not _is_toml(changed) or tomllib.loads(changed).get(table, {}).get(key) != value:
            what = f"{file} has no [{table}] of its own to set {key} in"
            raise ConfigError(what, fix=f"edit {file} by hand")
        _write(file, changed)


def remove_region(file: Path, name: str) -> None:
    """Remove the region `name`; raises `ConfigError` if there is none."""
    with one_at_a_time(file.resolve().parent):
        text = _read(file)
        before, _, after = _cut(text, _find(file, text, name))
        _write(file, before + after.lstrip("\r\n"))


@contextmanager
def restoring(file: Path) -> Iterator[None]:
    """Put the file back as it was if what is done in between raises."""
    before = _read(file)
    try:
        yield
    except BaseException:
        with one_at_a_time(file.resolve().parent):
            if _read(file) != before:
                _write(file, before)
        raise


def _find(file: Path, text: str, name: str) -> int:
    names = _names(file, text)
    if name not in names:
        known = f"the regions are {', '.join(map(str, names))}" if names else "add it with: fieldkit roi add"
        raise ConfigError(f"there is no region {name!r}", fix=known)
    return names.index(name)


def _names(file: Path, text: str) -> list[Any]:
    """The name of every ``[[region]]``; raises `ConfigError` if the regions are written inline."""
    values = tomllib.loads(text)
    if "region" in values and ("region", 0) not in key_lines(text):
        raise ConfigError(
            f"{file} defines its regions inline (region = ...), which can only be edited by hand",
            fix=f"edit {file}: write each region as its own [[region]] and remove region = ...",
        )
    return [region.get("name") for region in values.get("region", [])]


def _cut(text: str, index: int) -> tuple[str, str, str]:
    """The text before region number `index`, the region from header to last key, and the text after it.

    Comments below its last key are not part of it: they usually belong to the next table.
    """
    own = [line for path, line in key_lines(text).items() if path[:2] == ("region", index)]
    lines = toml_lines(text)
    first, end = min(own) - 1, _end_of_value(lines, max(own))
    return "".join(lines[:first]), "".join(lines[first:end]), "".join(lines[end:])


def _end_of_value(lines: list[str], number: int) -> int:
    """The number of the last line of the assignment that begins in line `number`."""
    end = number
    while not _is_toml("".join(lines[number - 1 : end])):
        end += 1
    return end


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _assignments(table: Mapping[str, Any]) -> str:
    return "".join(f"{assignment(key, value)}\n" for key, value in table.items())


def _write_checked(file: Path, text: str, path: KeyPath, where: str) -> None:
    """Write, unless the table at `path` has a mistake in it."""
    found = [mistake for _, mistake in mistakes_in(text, file) if mistake.path[: len(path)] == path]
    if found:
        raise ConfigMistakesError([(where, mistake) for mistake in found], fix="nothing was changed")
    _write(file, text)


def _read(file: Path) -> str:
    text = read_text(file, newline="")
    mistakes_in(text, file)  # raises if the text is not TOML
    return text


def _write(file: Path, text: str) -> None:
    """Replace the file atomically: after a power cut it is either the old or the new one."""
    file = file.resolve()  # a link stays a link
    try:
        with replacing(file) as draft:
            draft.touch()
            shutil.copymode(file, draft)  # first: a file that may not be written is not replaced either
            draft.write_bytes(_encoded(text, file.read_bytes()))
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error


def _encoded(text: str, before: bytes) -> bytes:
    """The text with the line ends and the byte order mark that the file had before."""
    if b"\r\n" in before and before.count(b"\r\n") == before.count(b"\n"):
        text = text.replace("\r\n", "\n").replace("\n", "\r\n")
    mark = codecs.BOM_UTF8 if before.startswith(codecs.BOM_UTF8) else b""
    return mark + text.encode()
