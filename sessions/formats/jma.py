"""What the files of the Japan Meteorological Agency have in common: Shift_JIS, and Japan's time."""

from __future__ import annotations

from datetime import timedelta, timezone
from pathlib import Path

from fieldkit.model.errors import ConfigError

JST = timezone(timedelta(hours=9), "JST")
VENDOR = "Japan Meteorological Agency"
_MOST_BYTES = 100_000_000


def japanese_text(path: Path) -> str:
    """The text of such a file, also of one that was saved again as UTF-8; raises `ConfigError`."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES)
        return _decoded(content)
    except (OSError, UnicodeDecodeError) as error:
        raise not_understood(path, str(error)) from error


def _decoded(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")  # Japanese in Shift_JIS is no UTF-8, so this comes first
    except UnicodeDecodeError:
        return content.decode("cp932")


def not_understood(path: Path, why: str) -> ConfigError:
    """The error of a file that is laid out otherwise."""
    return ConfigError(
        f"{path} is not as the {VENDOR} writes it: {why}",
        fix="download it anew and leave name and encoding (Shift_JIS) as they are",
    )
