"""What ``fieldkit check`` says of a session, in a line."""

from __future__ import annotations

from pathlib import Path

from fieldkit.sessions.check import check


def said(path: Path, what: str, *levels: str) -> str:
    """The findings on one thing, of the levels named (warnings and failures if none is)."""
    return " | ".join(
        one.text for one in check(path) if one.what == what and one.level in (levels or ("warn", "fail"))
    )
