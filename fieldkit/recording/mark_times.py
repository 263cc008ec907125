"""The time of a mark as people write it: ``-30s``, ``12:31`` at the site, ISO 8601."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from datetime import time as time_of_day
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import ConfigError
from fieldkit.model.units import SECOND_NS
from fieldkit.recording.marks import Mark, When, shade_test
from fieldkit.recording.requests import STARTED_WITHIN_S, await_inbox
from fieldkit.recording.running import session_in_progress
from fieldkit.recording.status_request import recorder_status

if TYPE_CHECKING:
    from fieldkit.config import Config

CLOCKS_DIFFER = timedelta(minutes=5)
"""A clock time up to this far ahead means now, by a watch that is fast; beyond, it means yesterday."""
YEAR_S = 365.25 * 86_400.0
FAR_S = 10.0 * YEAR_S
"""A mark further from now is a typing error."""


def mark_of(
    recordings: Path,
    config: Callable[[], Config],
    text: str,
    *,
    kind: str = "",
    at: str = "-0s",
    to: str | None = None,
) -> Mark:
    """A note with its time, or interval, as people write them: ``-30s``, ``12:31`` at the site, ISO 8601.

    A shade test and a time of the site need the regions and the time of what records into `recordings`;
    `config` loads the campaign's configuration where its recorder does not report them. Raises `ConfigError`
    for a time that cannot be read, that is years away, or an end before its start, and for a shade test of an
    unknown region.
    """
    test = shade_test(text)
    now = datetime.now(UTC)
    if test is not None or not (at.startswith("-") and (to is None or to.startswith("-"))):
        regions, now = _regions_and_now(recordings, config)
        _reject_unknown_region(test, regions)
    mark = Mark(text, kind, parse_when(at, now), parse_when(to, now) if to else None)
    reject_impossible(mark, now)
    return mark


def _regions_and_now(recordings: Path, config: Callable[[], Config]) -> tuple[list[str], datetime]:
    """Names of the regions, and now in the site's zone by the clock of the recording."""
    session = session_in_progress(recordings)
    if session is not None and (status := recorder_status(session)) is not None:
        zone = ZoneInfo(status["timezone"])
        return status["regions"], datetime.fromtimestamp(status["time_ns"] / SECOND_NS, zone)
    configured = config()
    return [region.name for region in configured.regions], _now(configured, session)


def _now(config: Config, session: Path | None) -> datetime:
    """Now at the site; a simulated field shows the time of its scene."""
    from fieldkit.sessions.reader import open_session
    from fieldkit.views import formatting

    zone = formatting.zone(config.site)
    if session is None or config.simulation is None:
        return datetime.now(zone)
    await_inbox(session)  # from then on there is a file
    deadline, end_ns = time.monotonic() + STARTED_WITHIN_S, 0
    while not end_ns and time.monotonic() < deadline:  # until the first sample
        with open_session(session) as opened:
            end_ns = opened.end_ns
    return datetime.fromtimestamp(end_ns / SECOND_NS, zone) if end_ns else datetime.now(zone)


def _reject_unknown_region(test: tuple[str, str] | None, names: list[str]) -> None:
    if test is not None and test[0] not in names:
        raise ConfigError(
            f"no region is called {test[0]!r}", fix=f"shade-test and one of {', '.join(names) or 'none'}"
        )


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
        raise ConfigError(
            f"{text!r} is not a valid time; use -30s, 12:31 or 2026-12-11T12:31+09:00"
        ) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=now.tzinfo)).isoformat()


def _last(shown: time_of_day, now: datetime) -> datetime:
    """When clocks last showed a time, in its own zone if it has one."""
    own_zone = shown.tzinfo or now.tzinfo
    latest = (now + CLOCKS_DIFFER).timestamp()
    day = now.astimezone(own_zone).date()
    moments = [datetime.combine(day + timedelta(days), shown, own_zone) for days in (1, 0, -1)]
    return next(moment for moment in moments if moment.timestamp() <= latest)


def reject_impossible(mark: Mark, now: datetime) -> None:
    """Raise `ConfigError` for a time further than `FAR_S` from now, or an end before its start."""
    ends = [mark.at] if mark.to is None else [mark.at, mark.to]
    after_s = [_after_s(end, now) for end in ends]
    for end, seconds in zip(ends, after_s, strict=True):
        if abs(seconds) > FAR_S:
            shown = f"{seconds:g} s" if isinstance(end, float) else end
            raise ConfigError(f"{shown} is more than {FAR_S / YEAR_S:.0f} years from now; correct the time")
    if after_s[-1] < after_s[0]:
        raise ConfigError("the end lies before the start; give the earlier time to --from")


def _after_s(when: When, now: datetime) -> float:
    return datetime.fromisoformat(when).timestamp() - now.timestamp() if isinstance(when, str) else when
