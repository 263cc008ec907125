"""Channels of a stream that measure the air: its temperature, its speed.

Streams of the quantities ``air_temperature`` and ``wind_speed`` do; of others, the channels named so, or the
only channel of a stream that is. Any other thermometer may be anywhere, so it is not used as air temperature.
"""

from __future__ import annotations

from fieldkit.model.device import StreamInfo
from fieldkit.model.radiation import UNKNOWN

AIR_TEMPERATURE, WIND_SPEED = "air_temperature", "wind_speed"

CELSIUS_UNITS = ("degC", "°C", "C")
_UNITS = {**dict.fromkeys(("K", *CELSIUS_UNITS), AIR_TEMPERATURE), "m s-1": WIND_SPEED}
# airtc and ws are the names that Campbell Scientific's programs give
_NAMES = {
    AIR_TEMPERATURE: {"air", "t_air", "tair", "air_t", "air_temp", "temp_air", "air_temperature", "airtc"},
    WIND_SPEED: {"wind", "wind_speed", "windspeed", "ws"},
}
_SUFFIXES = ("_avg", "_ms", "_m_s", "_c", "_f", "_k")


def of_air(info: StreamInfo) -> tuple[str, ...]:
    """For each channel `AIR_TEMPERATURE`, `WIND_SPEED` or `UNKNOWN`; empty for cameras."""
    if info.is_camera:
        return ()
    if info.quantity in _NAMES:
        return (info.quantity if _UNITS.get(info.unit) == info.quantity else UNKNOWN,) * info.shape[0]
    found = tuple(_named(name, info.unit) for name in info.channel_names)
    return found if any(found) or len(found) > 1 else (_named(info.name, info.unit),)


def is_air_temperature(channel: str) -> bool:
    """True if a thermometer's channel is named as air temperature: ``air``, ``T_air``, ``AirTC_Avg``."""
    return _named(channel, "K") == AIR_TEMPERATURE


def _named(name: str, unit: str) -> str:
    word = name.strip().lower().replace(" ", "_").replace("-", "_")
    for suffix in _SUFFIXES:
        word = word.removesuffix(suffix)
    quantity = _UNITS.get(unit, UNKNOWN)
    return quantity if word in _NAMES.get(quantity, ()) else UNKNOWN
