"""Durations and times of day as people write them: ``3h``, ``90m``, ``45s``, ``2h30``; ``15:05``."""

from __future__ import annotations

import re
from datetime import datetime, time, timedelta

from fieldkit.model.errors import ConfigError
from fieldkit.phrases import Words

UNIT_S = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86_400.0}
LONGEST_S = 100 * 365.25 * 86_400.0
"""A hundred years: more is a typing error."""
_UNIT_AFTER = {"m": "s", "h": "m", "d": "h"}
"""The unit of a bare number, by the unit in front of it: ``2h30`` is two hours and thirty minutes."""


def parse_duration(text: str) -> float:
    """A duration in seconds, such as ``3h``, ``90m``, ``10min``, ``45s``, ``2h30m`` or ``2h30``.

    Raises `ConfigError` for anything else, also for a number without any unit or more than a hundred years.
    """
    if not re.fullmatch(r"(\d+(\.\d+)?(min|[dhms]))+((?<!s)\d+(\.\d+)?)?", text):
        raise ConfigError(Words("error.duration"), place=repr(text), fix=Words("fix.duration"))
    total, last_unit = 0.0, ""
    for number, unit in re.findall(r"(\d+(?:\.\d+)?)([dhms]?)", text.replace("min", "m")):
        total += float(number) * UNIT_S[unit or _UNIT_AFTER[last_unit]]
        last_unit = unit
    if total > LONGEST_S:
        raise ConfigError(Words("error.century"), place=repr(text[:20]), fix=Words("fix.duration"))
    return total


def parse_offset(text: str) -> float:
    """A signed difference of time in seconds, such as ``+12s``, ``-0.5s`` or ``2m``; seconds without a unit.

    Raises `ConfigError`.
    """
    sign, size = (text[0], text[1:]) if text[:1] in ("+", "-") else ("+", text)
    if re.fullmatch(r"\d+(\.\d+)?", size):
        size += "s"
    try:
        return float(f"{sign}1") * parse_duration(size)
    except ConfigError:
        raise ConfigError("is not a valid offset", place=repr(text), fix="use +12s or -2m") from None


def as_seconds(duration: str | float) -> float:
    """Seconds of a duration that may be given as text or as a number of seconds; raises `ConfigError`."""
    if isinstance(duration, str):
        return parse_duration(duration)
    if not 0.0 <= duration <= LONGEST_S:
        fix = "use seconds, or text such as 3h, 90m or 45s"
        raise ConfigError("is not a valid duration", place=str(duration), fix=fix)
    return float(duration)


def precise_duration(seconds: float) -> str:
    """``4.2 s``, ``12 min 30 s`` or ``3 h 09 min``: of a recording, a gap, a nap of the computer."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02} min"


def rounded_duration(seconds: float) -> str:
    """``14 s``, ``9 min`` or ``3 h 09 min``: how long something has lasted, at a glance."""
    if seconds < 90:
        return f"{max(0.0, seconds):.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def parse_time_of_day(text: str) -> time:
    """A time of day ``HH:MM``; raises `ConfigError`."""
    try:
        hour, minute = (int(part) for part in text.split(":"))
        return time(hour, minute)
    except ValueError:
        raise ConfigError(Words("error.time"), place=repr(text), fix=Words("fix.time_of_day")) from None


def times_of_day(text: str) -> tuple[time, ...]:
    """The times of day that a text names: ``09:00``, or every ``1d``, ``6h`` or ``30m`` from midnight on.

    None for an empty one. Raises `ConfigError` for anything else.
    """
    if not text:
        return ()
    if ":" in text:
        return (parse_time_of_day(text),)
    step = timedelta(seconds=parse_duration(text))
    if not step or step % timedelta(minutes=1) or timedelta(days=1) % step:
        fix = "use 1d, 6h or a time of day such as 09:00"
        raise ConfigError("does not divide the day", place=repr(text), fix=fix)
    return tuple((datetime.min + step * number).time() for number in range(timedelta(days=1) // step))
