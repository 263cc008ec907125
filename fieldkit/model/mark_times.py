"""The time of a mark as people write it: ``-30s``, ``12:31`` at the site, ISO 8601."""

from __future__ import annotations

from datetime import datetime, timedelta
from datetime import time as time_of_day

from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import ConfigError
from fieldkit.model.marks import Mark, When
from fieldkit.model.next_step import Argument
from fieldkit.model.spelling import did_you_mean
from fieldkit.model.units import MINUTE_NS
from fieldkit.phrases import Words

CLOCKS_DIFFER = timedelta(minutes=5)
"""A clock time up to this far ahead means now, by a watch that is fast; beyond, it means yesterday."""
HASTE = timedelta(seconds=30)
"""Marks of a moment ago may be of just before the recording."""
FAR = timedelta(days=3653)
"""A mark further from now is a typing error, also where the recording's start is not known."""


def parse_when(text: str, now: datetime) -> When:
    """Seconds before `now` from ``-30s``, ``-5m``, ``-1h``; else ISO 8601, by default in the zone of `now`.

    ``12:31`` is the last time that clocks showed it. Raises `ConfigError` for anything else.
    """
    try:
        if text.startswith("-"):
            return -parse_duration(text[1:])
        if ":" in text[:3]:
            return _last(time_of_day.fromisoformat(text), now).isoformat()
        moment = datetime.fromisoformat(text)
    except ValueError:  # also a `ConfigError`
        raise ConfigError(Words("error.time"), place=repr(text), fix=Words("fix.time")) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=now.tzinfo)).isoformat()


def moments_of(shown: time_of_day, now: datetime) -> list[datetime]:
    """When clocks in the zone of `now` show a time, from yesterday to tomorrow."""
    return [  # an hour that clocks show twice has two moments, the later of them with a fold
        datetime.combine(now.date() + timedelta(days), shown.replace(fold=fold), now.tzinfo)
        for days in (-1, 0, 1)
        for fold in (0, 1)
    ]


def _last(shown: time_of_day, now: datetime) -> datetime:
    """When clocks last showed a time, in its own zone if it has one."""
    latest_s = now.timestamp() + CLOCKS_DIFFER.total_seconds()
    moments = moments_of(shown, now.astimezone(shown.tzinfo) if shown.tzinfo else now)
    return next(moment for moment in reversed(moments) if moment.timestamp() <= latest_s)


def reject_outside(mark: Mark, start_ns: int, now: datetime) -> None:
    """Raise `ConfigError` for a mark outside its recording, or with an end before its start.

    The recording goes from the minute of `start_ns`, UTC nanoseconds or 0 if unknown, to `now`, by a
    watch that may be wrong.
    """
    ends = [mark.at] if mark.to is None else [mark.at, mark.to]
    moments = [moment_of(end, now) for end in ends]
    start = datetime.fromtimestamp(start_ns // MINUTE_NS * 60, now.tzinfo) if start_ns else now - FAR
    for end, moment in zip(ends, moments, strict=True):
        if not start - HASTE <= moment <= now + CLOCKS_DIFFER:
            text = f"{end:g} s" if isinstance(end, float) else str(end)
            what = Words("error.outside", start=f"{start:%Y-%m-%d %H:%M}", end=f"{now:%Y-%m-%d %H:%M}")
            raise ConfigError(what, place=text, fix=Words("fix.within"))
    if moments[-1] < moments[0]:
        raise ConfigError(Words("error.end_before"), place=Argument("to"), fix=Words("fix.exchange"))


def moment_of(when: When, now: datetime) -> datetime:
    """The time of a mark, in the zone of `now`."""
    if isinstance(when, str):
        return datetime.fromisoformat(when).astimezone(now.tzinfo)
    return datetime.fromtimestamp(now.timestamp() + when, now.tzinfo)  # also where the clocks change before


def reject_unknown_region(test: tuple[str, str] | None, names: list[str]) -> None:
    """Raise `ConfigError` for a shade test of a region that there is not."""
    if test is not None and test[0] not in names:
        raise ConfigError(Words("error.no_region"), place=test[0], fix=did_you_mean(test[0], names))
