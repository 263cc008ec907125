"""Units of a table's columns: as they are written, and what they become in a stream."""

from __future__ import annotations

import re
from typing import NamedTuple

from fieldkit.model.units import CELSIUS_ZERO_K, FAHRENHEIT_TO_K, FOOT2_M2


class Unit(NamedTuple):
    """A stream's unit and quantity; a written number becomes ``(number + add) / by``."""

    unit: str
    quantity: str
    add: float = 0.0
    by: float = 1.0


_TEMPERATURE, _LIGHT, _POWER = ("K", "temperature"), ("lx", "illuminance"), ("W m-2", "irradiance")
_SPEED = ("m s-1", "speed")
_UNITS = {  # in small letters
    **dict.fromkeys(
        ("c", "°c", "℃", "degc", "deg c", "degree c", "celsius"), Unit(*_TEMPERATURE, CELSIUS_ZERO_K)
    ),
    **dict.fromkeys(
        ("f", "°f", "℉", "degf", "deg f", "degree f", "fahrenheit"), Unit(*_TEMPERATURE, *FAHRENHEIT_TO_K)
    ),
    **dict.fromkeys(("k", "kelvin"), Unit(*_TEMPERATURE)),
    **dict.fromkeys(("lx", "lux"), Unit(*_LIGHT)),
    **dict.fromkeys(("klx", "klux", "kilolux"), Unit(*_LIGHT, by=1e-3)),
    **dict.fromkeys(("fc", "ftc", "ft-cd", "foot-candle", "foot-candles"), Unit(*_LIGHT, by=FOOT2_M2)),
    **dict.fromkeys(("w m-2", "w/m2", "w/m²", "w/m^2"), Unit(*_POWER)),
    **dict.fromkeys(("kw m-2", "kw/m2", "kw/m²", "kw/m^2"), Unit(*_POWER, by=1e-3)),
    **dict.fromkeys(("m/s", "m s-1", "meters/second"), Unit(*_SPEED)),
}
KNOWN = "C, F, K, lx, klx, fc, W/m2, kW/m2, m/s"

# in round brackets anything may stand, such as a place or a number: short words and signs of units are units
_BRACKETS = re.compile(r"\s*(?:\[\s*(?P<square>[^\[\]]+?)\s*\]|\(\s*(?P<round>[^()]+?)\s*\))\s*$")
_LIKE_A_UNIT = re.compile(r"[A-Za-zµμΩ]{1,4}|[^%°/²³µμΩ^]*[%°/²³µμΩ^].*|volts|knots|degrees|percent|counts")

_SHORT_CUT = {
    "AirTC": "C", "AirTF": "F", "_C": "C", "_F": "F", "SlrkW": "kW/m2", "SlrW": "W/m2", "_ms": "m/s"
}  # fmt: skip


def known_unit(written: str) -> Unit | None:
    """Meaning of a written unit; None if it is not one that is read."""
    return _UNITS.get(written.lower())


def split_head(head: str) -> tuple[str, str]:
    """Name and unit of a header's cell: ``T1 [C]``, ``light (lx)``; the unit ``""`` where it has none."""
    found = _BRACKETS.search(head)
    if found is None or not head[: found.start()]:
        return head, ""
    unit = found["square"] or found["round"]
    is_unit = found["square"] or known_unit(unit) or _LIKE_A_UNIT.fullmatch(unit)
    return (head[: found.start()], unit) if is_unit and not unit.isdigit() else (head, "")


def short_cut_unit(name: str) -> str:
    """The unit in a name of Campbell Scientific's Short Cut, such as ``T109_C`` or ``SlrW``."""
    return next((unit for end, unit in _SHORT_CUT.items() if name.endswith(end)), "")
