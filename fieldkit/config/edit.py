"""Changes to a ``fieldkit.toml``, one at a time, that keep its comments and its order."""

from __future__ import annotations

import codecs
import shutil
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from fieldkit.config.files import KeyPath, is_toml, key_lines, toml_lines
from fieldkit.config.load import mistakes_in
from fieldkit.config.template import assignment
from fieldkit.config.validation import ConfigMistakesError
from fieldkit.disk import one_at_a_time, replacing
from fieldkit.model.errors import ConfigError, StorageError, os_errors_as
from fieldkit.model.next_step import Action
from fieldkit.model.spelling import did_you_mean
from fieldkit.model.text_file import parse_toml, read_text
from fieldkit.phrases import Words


@dataclass
class Draft:
    """The text of a ``fieldkit.toml`` while it is changed."""

    file: Path
    text: str

    def put(self, text: str, path: KeyPath, where: str) -> None:
        """Replace the text; raises `ConfigMistakesError` if the table at `path` has a mistake in it."""
        mistakes = [
            mistake for _, mistake in mistakes_in(text, self.file) if mistake.path[: len(path)] == path
        ]
        if mistakes:
            raise ConfigMistakesError(
                [(where, mistake) for mistake in mistakes],
                fix=Words("fix.unchanged"),
            )
        self.text = text


@contextmanager
def editing(file: Path) -> Iterator[Draft]:
    """A file to change: read once, and written at the end, unless what is done in between raises."""
    with one_at_a_time(file.resolve().parent):
        text = read_text(file, newline="")
        parse_toml(text, file)
        draft = Draft(file, text)
        yield draft
        if draft.text != text:
            _write(file, draft.text)


def add_region(draft: Draft, region: Mapping[str, Any]) -> None:
    """Append a ``[[region]]``; raises `ConfigMistakesError` if it is invalid."""
    text = draft.text.rstrip("\r\n") + "\n\n[[region]]\n" + _assignments(region)
    draft.put(text, ("region", len(_names(draft))), str(region["name"]))


def add_instrument(draft: Draft, path: Sequence[str], table: Mapping[str, Any]) -> None:
    """Add the table of an instrument, such as ``[lux]``: where it stands commented out, or else at the end.

    Raises `ConfigError` if there is one already, `ConfigMistakesError` if it is invalid.
    """
    before, header = draft.text, f"[{'.'.join(path)}]"
    section, lines = f"{header}\n{_assignments(table)}", toml_lines(before)
    place = next((place for place, line in enumerate(lines) if line.strip() == f"#{header}"), None)
    if place is None:
        lines.append(f"\n{section}" if before.endswith("\n") or not before else f"\n\n{section}")
    else:
        lines[place] = section
    draft.put("".join(lines), tuple(path), header)


def change_region(draft: Draft, name: str, changes: Mapping[str, Any]) -> None:
    """Change keys of the region `name`; None removes a key.

    Raises `ConfigError` if there is none, `ConfigMistakesError` if the result is invalid.
    """
    index = _find(draft, name)
    before, region, after = _around(draft.text, index)
    document = tomlkit.parse(region)
    document["region"][0].update({key: value for key, value in changes.items() if value is not None})
    redrawn = ["points_m"] if "points_px" in changes else []  # in pixels, no longer on the ground
    for key in [*redrawn, *(key for key, value in changes.items() if value is None)]:
        document["region"][0].pop(key, None)
    draft.put(before + tomlkit.dumps(document) + after, ("region", index), name)


def set_key(draft: Draft, table: str, key: str, value: Any) -> None:
    """Set a key of a table, such as ``[site]``; raises `ConfigError` if that is not a table of its own."""
    lines, where, entry = toml_lines(draft.text), key_lines(draft.text), f"{assignment(key, value)}\n"
    if (first := where.get((table, key))) is not None:
        lines[first - 1 : _end_of_value(lines, first)] = [entry]
    elif (header := where.get((table,))) is not None:
        lines.insert(header, entry)
    else:
        lines.append(f"\n[{table}]\n{entry}")
    changed = "".join(lines)
    if not is_toml(changed) or tomllib.loads(changed).get(table, {}).get(key) != value:
        what = f"has no [{table}] of its own to set {key} in"
        raise ConfigError(what, place=draft.file, fix=f"edit {draft.file} by hand")
    draft.text = changed


def remove_region(draft: Draft, name: str) -> None:
    """Remove the region `name`; raises `ConfigError` if there is none."""
    before, _, after = _around(draft.text, _find(draft, name))
    draft.text = before + after.lstrip("\r\n")


def _find(draft: Draft, name: str) -> int:
    names = _names(draft)
    if name not in names:
        fix = did_you_mean(name, map(str, names)) if names else "add it: " + Action.ADD_REGION()
        raise ConfigError(Words("error.no_region"), place=name, fix=fix)
    return names.index(name)


def _names(draft: Draft) -> list[Any]:
    """The name of every ``[[region]]``; raises `ConfigError` if the regions are written inline."""
    values, file = tomllib.loads(draft.text), draft.file
    if "region" in values and ("region", 0) not in key_lines(draft.text):
        raise ConfigError(
            Words("error.inline"),
            place=file,
            fix=f"edit {file}: write each region as its own [[region]] and remove region = ...",
        )
    return [region.get("name") for region in values.get("region", [])]


def _around(text: str, index: int) -> tuple[str, str, str]:
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
    while not is_toml("".join(lines[number - 1 : end])):
        end += 1
    return end


def _assignments(table: Mapping[str, Any]) -> str:
    return "".join(f"{assignment(key, value)}\n" for key, value in table.items() if value is not None)


def _write(file: Path, text: str) -> None:
    """Replace the file atomically: after a power cut it is either the old or the new one."""
    file = file.resolve()  # a link stays a link
    with os_errors_as(StorageError, "cannot write", place=file), replacing(file) as draft:
        draft.touch()
        shutil.copymode(file, draft)  # first: a file that may not be written is not replaced either
        draft.write_bytes(_encode(text, file.read_bytes()))


def _encode(text: str, before: bytes) -> bytes:
    """The text with the line ends and the byte order mark that the file had before."""
    if b"\r\n" in before and before.count(b"\r\n") == before.count(b"\n"):
        text = text.replace("\r\n", "\n").replace("\n", "\r\n")
    mark = codecs.BOM_UTF8 if before.startswith(codecs.BOM_UTF8) else b""
    return mark + text.encode()
