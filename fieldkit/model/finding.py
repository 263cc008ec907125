"""Findings of a check, and the worst of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fieldkit.model.next_step import Text


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at: `level` "ok", "warn" or "fail", `what` the thing, `fix` the next step."""

    level: str
    what: str
    text: str
    fix: Text = ""


def worst(findings: Sequence[Finding]) -> str:
    """The worst level among findings."""
    levels = {finding.level for finding in findings}
    return "fail" if "fail" in levels else "warn" if "warn" in levels else "ok"
