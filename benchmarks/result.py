"""What a benchmark reports."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Result:
    """One measured number: its name, value and unit, the goal in words, and what it was held against."""

    name: str
    value: float
    unit: str
    must: str
    note: str = ""
