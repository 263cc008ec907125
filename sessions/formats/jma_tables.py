"""Radiation tables of the Japan Meteorological Agency: one quantity of one month, a row a day.

A row has the day, 24 hourly sums in 0.01 MJ/m² without a decimal point, and their sum; ``XXX`` is
missing, ``]`` marks an incomplete sum. The hours end at the full hour of Japan's time; means are put
at half past. What a table holds stands in its name: DR direct, DF diffuse, DL downward long wave.
(JMA: env/radiation/format_rad, and the names of the tables there, as ``DR202406_tat.txt``.)
"""

from __future__ import annotations

import re
from calendar import monthrange
from datetime import datetime, timedelta
from pathlib import Path

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Reading, Severity
from fieldkit.sessions.formats.imported import Foreign
from fieldkit.sessions.formats.jma import JST, VENDOR, japanese_text, not_understood
from fieldkit.sessions.formats.times import utc_ns

_NAME = re.compile(r"(DR|DF|DL)(\d{4})(0[1-9]|1[0-2])_(\w+)\.txt", re.IGNORECASE)
_QUANTITIES = {
    "DR": ("direct", "irradiance", "dni"), "DF": ("diffuse", "irradiance", "dhi"),
    "DL": ("longwave-down", "longwave_irradiance", "longwave_down"),
}  # fmt: skip
_HOURS = [f"{hour:02}" for hour in range(1, 25)]  # a heading, not the first of the month
_W_PER_M2 = 1e4 / 3600.0  # of 0.01 MJ/m² in an hour


def is_radiation_table(path: Path) -> bool:
    """Whether a file has the name of such a table."""
    return _NAME.fullmatch(path.name) is not None


def read_radiation_table(path: Path, name: str) -> Foreign:
    """A table as a stream ``NAME-direct``, ``NAME-diffuse`` or ``NAME-longwave-down`` in W/m².

    Raises `ConfigError` where the file is not laid out as the agency says.
    """
    named = _NAME.fullmatch(path.name)
    if named is None:
        raise not_understood(path, "its name does not say which quantity and month, like DR202406_tat.txt")
    word, quantity, component = _QUANTITIES[named[1].upper()]
    try:
        first = datetime(int(named[2]), int(named[3]), 1, tzinfo=JST)
        days = [day for line in japanese_text(path).splitlines() if (day := _day(path, line)) is not None]
        readings = _readings(path, f"{name}-{word}", first, days)
    except OverflowError as error:
        raise not_understood(path, str(error)) from error
    info = StreamInfo(
        f"{name}-{word}", quantity, "W m-2", (1,), measures=(component,), rate_hz=1 / 3600, driver="import",
        vendor=VENDOR, model=f"station {named[4]}",
    )  # fmt: skip
    said = f"{path.name}: hourly sums of {len(days)} days as means, stamped at half past, from Japan's time"
    return Foreign((info,), readings, ((Severity.INFO, said),))


def _readings(path: Path, stream: str, first: datetime, days: list[tuple[int, list[float]]]) -> list[Reading]:
    if not days or [number for number, _ in days] != list(range(1, len(days) + 1)):
        raise not_understood(path, "there are no rows of days, one after another from the first of the month")
    if days[-1][0] > monthrange(first.year, first.month)[1]:
        raise not_understood(path, f"it has {days[-1][0]} days, more than its month {first:%Y-%m}")
    readings = []
    for number, hours in days:
        for hour, value in enumerate(hours):
            time_ns = utc_ns(first + timedelta(days=number - 1, hours=hour, minutes=30))
            readings.append(Reading(stream, time_ns, time_ns, (value,)))
    return readings


def _day(path: Path, line: str) -> tuple[int, list[float]] | None:
    """Number of the day and its hours in W/m², of a row of the table; None for any other line.

    The row's own daily sum proves that the numbers were taken for the right hours.
    """
    words = line.replace("]", " ").split()
    if not words or not re.fullmatch(r"[1-9]|[0-3]\d", words[0]) or words[:24] == _HOURS:
        return None
    if len(words) != 26 or not all(re.fullmatch(r"\d+|X+", word) for word in words[1:]):
        raise not_understood(path, f"the row {line.strip()[:40]!r} has not 24 hours and their sum")
    hours = [float("nan") if "X" in word else float(word) for word in words[1:25]]
    known = [hour for hour in hours if hour == hour]
    if "X" not in words[25] and abs(sum(known) - float(words[25])) > 0.5 * len(known) + 1:
        raise not_understood(path, f"the hours of day {words[0]} do not add up to its sum")
    return int(words[0]), [hour * _W_PER_M2 for hour in hours]
