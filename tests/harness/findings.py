"""What ``fieldkit check`` says of a session, in a line."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from fieldkit.model.finding import Finding
from fieldkit.sessions.check import check


def said(path: Path, what: str, *levels: str) -> str:
    """The findings on one thing, of the levels named (warnings and failures if none is)."""
    findings = _findings(path, path.stat().st_mtime_ns)
    return " | ".join(
        one.text for one in findings if one.what == what and one.level in (levels or ("warn", "fail"))
    )


@cache
def _findings(path: Path, _changed_ns: int) -> list[Finding]:
    """Of a file as it is: asked of one thing after the other, it is read once."""
    return check(path)
