"""Unit conversions that every room uses; physical constants stand beside the law that needs them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fieldkit.model.arrays import FloatArray

CELSIUS_ZERO_K = 273.15
"""0 °C on the kelvin scale."""
FAHRENHEIT_TO_K = (459.67, 1.8)
"""Kelvin of a temperature in °F: add the first, divide the sum by the second."""
FOOT2_M2 = 0.09290304
"""One square foot, for foot-candles; a foot is 0.3048 m exactly."""

SECOND_NS = 1_000_000_000
MINUTE_NS = 60 * SECOND_NS
HOUR_NS = 3600 * SECOND_NS
DAY_S = 86_400
DAY_NS = DAY_S * SECOND_NS


def kelvin_if_fahrenheit(kelvin: FloatArray) -> FloatArray:
    """Kelvin of a reading that was converted as °C although the instrument showed °F."""
    return (kelvin - CELSIUS_ZERO_K - 32.0) / 1.8 + CELSIUS_ZERO_K
