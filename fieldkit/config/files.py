"""Text files that people write, with whatever editor."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.errors import ConfigError


def read_text(file: Path, *, newline: str | None = None) -> str:
    """The text of a file, without its byte order mark; `newline` as for `open`.

    Raises `ConfigError` if it cannot be read.
    """
    try:
        with file.open(encoding="utf-8-sig", newline=newline) as opened:
            return opened.read()
    except OSError as error:
        raise ConfigError(f"cannot read {file}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file} is not UTF-8 text: {error.reason}", fix="save it as UTF-8") from error
