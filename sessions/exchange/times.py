"""Times as other programs write them, to UTC nanoseconds; a missing zone is never guessed."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, tzinfo

from fieldkit.errors import ConfigError

_EPOCH = datetime.fromtimestamp(0, UTC)
_WORDS = {"yyyy": "%Y", "mm": "%m", "dd": "%d", "HH": "%H", "MM": "%M", "SS": "%S"}


def parse_time_ns(text: str, zone: tzinfo | None, time_format: str | None = None) -> int:
    """UTC nanoseconds of a time: ISO 8601, Unix seconds, or as `time_format` says.

    `time_format` is written for strptime (``%Y-%m-%d``) or in plain letters (``yyyy/mm/dd
    HH:MM:SS``). Raises `ConfigError` where the text is no such time, or has no offset and
    no `zone` is given.
    """
    if time_format is None and re.fullmatch(r"\d{9,11}(\.\d+)?", text):
        seconds, _, fraction = text.partition(".")
        return plausible_ns(int(seconds) * 10**9 + int(fraction[:9].ljust(9, "0")))
    moment = _parsed(text, time_format)
    if moment.tzinfo is None:
        if zone is None:
            raise ConfigError(
                f"the time {text!r} has no zone", fix="say which: --zone Asia/Tokyo, or --zone UTC"
            )
        moment = moment.replace(tzinfo=zone)
    return utc_ns(moment)


def utc_ns(moment: datetime) -> int:
    """UTC nanoseconds since 1970 of a moment with a zone, exact to the microsecond; raises `ConfigError`."""
    return plausible_ns((moment - _EPOCH) // timedelta(microseconds=1) * 1000)


def plausible_ns(time_ns: int) -> int:
    """The same; raises `ConfigError` before 1970, and after 2262, where 64 bits end."""
    if not 0 <= time_ns < 2**63:
        raise ConfigError(
            f"a time {time_ns / 1e9:.0f} s after 1970 is none of a recording",
            fix="check its clock and format",
        )
    return time_ns


def _parsed(text: str, time_format: str | None) -> datetime:
    try:
        if time_format is None:
            return datetime.fromisoformat(text)
        pattern = time_format if "%" in time_format else _plain(time_format)
        return datetime.strptime(text, pattern)
    except ValueError as error:
        expected = time_format or "ISO 8601, such as 2026-12-11T12:00:00+09:00"
        example = "%m/%d/%y %I:%M:%S %p" if text.endswith(("AM", "PM")) else "%d.%m.%Y %H:%M:%S"
        raise ConfigError(
            f"{text!r} is not a time as expected: {expected}",
            fix=f'say how times are written, such as --time-format "{example}"',
        ) from error


def _plain(words: str) -> str:
    """``yyyy/mm/dd HH:MM:SS`` as strptime has it."""
    return re.sub("|".join(_WORDS), lambda found: _WORDS[found[0]], words)
