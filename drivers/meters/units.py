"""Units that meters use, and how they become the SI unit of a stream."""

from __future__ import annotations

from collections.abc import Callable

LX_PER_FOOTCANDLE = 10.7639104  # 1 ft = 0.3048 m exactly

STREAM_UNITS = {"°C": "K", "°F": "K", "fc": "lx", "W/m²": "W m-2"}
"""The unit a stream has for what a meter shows."""

_TO_SI: dict[tuple[str, str], Callable[[float], float]] = {
    ("°C", "K"): lambda celsius: celsius + 273.15,
    ("°F", "K"): lambda fahrenheit: (fahrenheit + 459.67) / 1.8,
    ("fc", "lx"): lambda footcandle: footcandle * LX_PER_FOOTCANDLE,
    ("W/m²", "W m-2"): float,
}


def convert(value: float, unit: str, wanted: str) -> float | None:
    """`value` in the unit `wanted`, or None where no law leads there."""
    if unit == wanted:
        return value
    law = _TO_SI.get((unit, wanted))
    return law(value) if law else None
