"""Files of text that people write: UTF-8, perhaps TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from fieldkit.model.errors import ConfigError


def read_text(file: Path, *, newline: str | None = None) -> str:
    """The text of a file, without its byte order mark; `newline` as for `open`.

    Raises `ConfigError` if it cannot be read.
    """
    try:
        with file.open(encoding="utf-8-sig", newline=newline) as opened:
            return opened.read()
    except OSError as error:
        fix = "check its path, and who may read it"
        raise ConfigError(f"cannot read: {error.strerror}", place=file, fix=fix) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"not UTF-8 text: {error.reason}", place=file, fix="save it as UTF-8") from error


def parse_toml(text: str, file: Path | str) -> dict[str, Any]:
    """The plain document of a file's text; raises `ConfigError` if that is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not valid TOML: {error}", place=file, fix=f"edit {file}") from error
