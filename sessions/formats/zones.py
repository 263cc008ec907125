"""The zone that a table states for its times, in words that state one; what leaves it open is asked.

Open are an abbreviation (CST, BST), a number without a unit, and Windows' name of a zone by its cities, with
the offset of winter: each of them stands in tables whose times are of another zone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import NamedTuple
from zoneinfo import ZoneInfo

from fieldkit.model.site import known_zone

_LABEL = re.compile(
    r"(?i)zone|zona|\bzon\b|\btz\b|fuseau|huso|fuso|vyöhyke|strefa|пояс|時間帯|タイムゾーン|时区|時區"
    r"|(offset|diff\w*|hours?)\W+(\w+\W+)?(utc|gmt)\b|\b(utc|gmt)[\W_]*(offset|diff\w*)"
    r"|summer.?time|daylight.?saving|\bdst|sommerzeit|heure d.été|horario de verano|ora legale|夏時間|夏令时"
)
_MENTION = re.compile(r"(?i)\W*(all )?(times?|timestamps?|zeit\w*|heures?|horas?)\b\D*\b(utc|gmt)\b")
_SUMMER = re.compile(r"(?i)daylight|dst|summer|sommer|été|verano|legale|夏")
_NO = re.compile(r"(?i)\W(no|non?e?|nein|off|aus|false|disabled|inactive|0)\W*$")
_NAME = re.compile(r"[A-Za-z]+(?:/[\w+-]+)+")
_OFFSET = re.compile(
    r"(?i)(?<![A-Z])(?:GMT|UTC)\s*([+\-−±])\s*(\d{1,2}(?!\d)|\d\d)(?::?([0-5]\d))?(?![\d.:]|,\d)"
)
_VALUE = re.compile(r"([+\-−])(\d{1,2}(?=:)|\d\d):?([0-5]\d)")  # MySQL's, in a field of a zone
_GREENWICH = re.compile(r"(?i)(?<![^\W_])(GMT|UTC|Z|Coordinated Universal Time)(?![^\W_]|\s*[+\-−±\d])")
_JOINED = re.compile(r"(?i)(?<=date|time)(?=utc|gmt)|(?<=utc|gmt)(?=date|time)")
_LOCAL = re.compile(r"(?i)loca[lt]|lokal|system|offset|since|from|mean")
_NO_SUMMER = re.compile(r"(?i)\b(no|without|ohne|sans|sin)\s+(dst|daylight \w+|summer time|sommerzeit)")
_OPEN = re.compile(
    r"(?i)\b(not|no|nicht|kein\w*|ohne|without|sans|sin|senza|pas|geen|niet|dst|minus|behind|west)\b"
    r"|to_?utc|非|/\s*[+\-−]?\d|\([^()]*\)\s*[^\W\d_]{3}",  # (UTC+01:00) Amsterdam, Berlin, ...
    re.IGNORECASE,
)
_ABBREVIATION = re.compile(
    r"(?i)\b([A-Z]{1,4}[SD]T|[CEWM]E[SD]?T|MS[KD]|MESZ|MEZ|GST|HKT|ICT|PKT|SGT|UTC|GMT)\b"
)
_UNITS_S = {"s": 1, "sec": 1, "seconds": 1, "min": 60, "minutes": 60, "h": 3600, "hr": 3600, "hours": 3600}
_UNIT = rf"({'|'.join(_UNITS_S)})"
_NUMBER = re.compile(rf"(?i)[\W_]*{_UNIT}?\W*:\s*([+\-]?\d+(?:\.\d+)?)\s*{_UNIT}?\W*")
_MOST_S = 14 * 3600  # Kiribati


class Statement(NamedTuple):
    """Words about a zone, and the zones that they may mean: none where they leave it open."""

    words: str
    zones: tuple[tzinfo, ...]


def statements(head: Sequence[str], fields: Sequence[str]) -> list[Statement]:
    """What the cells above the times state, and fields around the table, as ``Time zone: UTC+9``."""
    stated = [Statement(cell, tuple(_zones(cell, is_head=True))) for cell in dict.fromkeys(head)]
    stated = [
        statement
        for statement in stated
        if statement.zones or _ABBREVIATION.search(statement.words) or is_label(statement.words)
    ]
    for field in dict.fromkeys(fields):
        zones = tuple(_of_field(field))
        is_without = _NO_SUMMER.search(field) or (_SUMMER.search(field) and _NO.search(field))
        if zones or (is_label(field) and not is_without):
            stated.append(Statement(field, zones))
    sure = [statement for statement in stated if statement.zones]
    summer = [statement for statement in stated if not statement.zones and _SUMMER.search(statement.words)]
    if summer and not any(isinstance(zone, ZoneInfo) for statement in sure for zone in statement.zones):
        return summer  # an offset may have summer time in it, or not
    return sure or stated


def is_label(cell: str) -> bool:
    """True if a cell names a zone, an offset or summer time, or says of times that they are in UTC."""
    return _LABEL.search(cell) is not None or _MENTION.match(cell) is not None


def example(stated: Sequence[Statement]) -> str:
    """A zone that was meant, as far as the words name one."""
    zones = (zone.key for statement in stated for zone in statement.zones if isinstance(zone, ZoneInfo))
    return next(zones, "Asia/Tokyo")


def _of_field(field: str) -> Iterator[tzinfo]:
    label = _LABEL.search(field)
    value = field[label.end() :] if label else field
    yield from _zones(value)
    if match := _VALUE.fullmatch(value.strip(" :='\"()[];/*")):
        yield from _ahead(*match.groups())
    is_number = re.search("time|zeit|utc|gmt|tz|hora", field, re.IGNORECASE) and not _OPEN.search(value)
    number = _NUMBER.fullmatch(value) if is_number else None
    unit_s = number and _UNITS_S.get((number[1] or number[3] or "").lower(), 0)
    if number and (unit_s or float(number[2]) == 0.0):  # nothing is nothing in any unit
        yield from _fixed(float(number[2]) * (unit_s or 0))


def _zones(words: str, *, is_head: bool = False) -> Iterator[tzinfo]:
    for name in _NAME.findall(words):
        if zone := known_zone(name):
            yield zone
            words = words.replace(name, "")
    plain = _JOINED.sub(" ", _NO_SUMMER.sub("", words))
    if re.search("(standard|daylight) time", plain, re.IGNORECASE):
        yield from _of_windows(plain)
    elif not _OPEN.search(plain.replace("Coordinated Universal Time", "")):
        for match in _OFFSET.finditer(plain):
            yield from _ahead(*match.groups())
        bare = _GREENWICH.search(plain) if is_head else _GREENWICH.fullmatch(plain.strip(" :='\"()[];/*,_"))
        if bare and not (is_head and _LOCAL.search(plain)):
            yield UTC


def _of_windows(words: str) -> Iterator[tzinfo]:
    """The zone of a name of Windows by CLDR's table, and the offset alone that its words name."""
    from tzlocal.windows_tz import win_tz

    is_summer = "daylight" in words.lower()
    plain = words.lower().replace("daylight", "standard")
    names = [name for name in win_tz if name.endswith("Time") and name.lower() in plain]
    if names and (zone := known_zone(win_tz[max(names, key=len)])):
        offsets = [datetime(2026, month, 1, tzinfo=zone).utcoffset() or timedelta() for month in (1, 7)]
        yield zone
        yield timezone(max(offsets) if is_summer else min(offsets))
    for match in _OFFSET.finditer(words):
        yield from _ahead(*match.groups())


def _ahead(sign: str, hours: str, minutes: str | None) -> Iterator[tzinfo]:
    seconds = int(hours) * 3600 + int(minutes or 0) * 60
    if sign != "±" or not seconds:
        yield from _fixed(-seconds if sign in "-−" else seconds)


def _fixed(seconds: float) -> Iterator[tzinfo]:
    if abs(seconds) <= _MOST_S and seconds % 900 == 0:  # no zone has other minutes
        yield timezone(timedelta(seconds=seconds))
