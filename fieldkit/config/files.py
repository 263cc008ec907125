"""Where a campaign's configuration is, and text files that people write with whatever editor."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action

FILE_NAME = "fieldkit.toml"


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


def find_campaign(start: Path) -> Path:
    """The ``fieldkit.toml`` of `start` or of the nearest folder above it.

    Raises `ConfigError` if there is none.
    """
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / FILE_NAME).is_file():
            return folder / FILE_NAME
    raise ConfigError(
        f"no {FILE_NAME} in {start.resolve()} or above it",
        fix="change to a campaign folder, name one, or create one: " + Action.CREATE_CAMPAIGN(),
    )
