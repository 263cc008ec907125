"""Units that meters use, and how they become the SI unit of a stream."""

from __future__ import annotations

FOOT2_M2 = 0.09290304  # 1 ft = 0.3048 m exactly

STREAM_UNITS = {"°C": "K", "°F": "K", "fc": "lx", "W/m²": "W m-2"}
"""The unit a stream has for what a meter shows."""

TO_SI = {
    ("°C", "K"): (273.15, 1.0),
    ("°F", "K"): (459.67, 1.8),
    ("fc", "lx"): (0.0, FOOT2_M2),
    ("W/m²", "W m-2"): (0.0, 1.0),
}
"""(shown, wanted): what to add to a value, and what to divide the sum by; numbers, because they are quick."""
