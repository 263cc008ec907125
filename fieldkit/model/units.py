"""Unit conversions that every room uses; physical constants stand beside the law that needs them."""

from __future__ import annotations

CELSIUS_ZERO_K = 273.15
"""0 °C on the kelvin scale."""
SECOND_NS = 1_000_000_000
MINUTE_NS = 60 * SECOND_NS
HOUR_NS = 3600 * SECOND_NS
DAY_S = 86_400
DAY_NS = DAY_S * SECOND_NS
