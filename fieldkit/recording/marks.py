"""Marks as people write them, by the clock of the recording; those of any session taken back or edited."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import ConfigError
from fieldkit.model.mark_times import moment_of, parse_when, reject_outside, reject_unknown_region
from fieldkit.model.marks import Mark, shade_test
from fieldkit.model.next_step import Argument
from fieldkit.model.units import SECOND_NS
from fieldkit.recording.requests import STARTED_WITHIN_S, await_inbox, send_to_recorder
from fieldkit.recording.running import session_in_progress
from fieldkit.recording.status_request import recorder_status

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.sessions.reader import SessionReader


def mark_of(
    recordings: Path,
    config: Callable[[], Config],
    text: str,
    *,
    kind: str = "",
    at: str = "-0s",
    to: str | None = None,
    longest: str | None = None,
) -> tuple[Mark, str]:
    """A note with its time, or interval, and what a shade test does in words (else empty).

    Times are as people write them: ``-30s``, ``12:31`` at the site, ISO 8601.

    A shade test and a time other than now need the regions and times of what records into `recordings`;
    `config` loads the campaign's configuration where its recorder does not report them. Raises `ConfigError`
    for a time that cannot be read or is outside the recording, an end before its start, and for a shade test
    of an unknown region.
    """
    test = shade_test(text)
    now, start_ns = datetime.now(UTC), 0
    if test is not None or at != "-0s" or to is not None:
        regions, now, start_ns = _regions_and_times(recordings, config)
        reject_unknown_region(test, regions)
    mark = Mark(text, kind, parse_when(at, now), parse_when(to, now) if to else None)
    reject_outside(mark, start_ns, now)
    if longest is not None:
        if test is None or test[1] == "end" or to is not None:
            raise ConfigError(
                "only a shade test that begins, without an interval, has one", place=Argument("longest")
            )
        mark = replace(mark, longest_s=parse_duration(longest))
    return mark, "" if test is None else _effect(mark, *test, now)


def _effect(mark: Mark, region: str, phase: str, now: datetime) -> str:
    start = moment_of(mark.at, now)
    if mark.to is not None:
        return f"{region} counts as shaded from {start:%H:%M} until {moment_of(mark.to, now):%H:%M}"
    if phase == "end":
        return f"{region} counts as sunlit from {start:%H:%M}"
    latest = start + timedelta(seconds=mark.longest_s)
    return (
        f"{region} counts as shaded from {start:%H:%M} until you end it, at the latest until {latest:%H:%M}"
    )


def _regions_and_times(recordings: Path, config: Callable[[], Config]) -> tuple[list[str], datetime, int]:
    """Names of the regions, now in the site's zone by the clock of the recording, and its start, UTC ns."""
    session = session_in_progress(recordings)
    if session is not None and (status := recorder_status(session)) is not None:
        zone = ZoneInfo(status["timezone"])
        now = datetime.fromtimestamp(status["time_ns"] / SECOND_NS, zone)
        return status["regions"], now, status["start_ns"]
    configured = config()
    return [region.name for region in configured.regions], *_times(configured, session)


def _times(config: Config, session: Path | None) -> tuple[datetime, int]:
    """Now at the site, and the recording's start, 0 if unknown; a simulated field shows its scene's time."""
    from fieldkit.sessions.reader import open_session
    from fieldkit.views import formatting

    zone = formatting.zone(config.site)
    if session is None or config.tables.simulation is None:
        return datetime.now(zone), 0
    await_inbox(session)  # from then on there is a file
    deadline, start_ns, end_ns = time.monotonic() + STARTED_WITHIN_S, 0, 0
    while not end_ns and time.monotonic() < deadline:  # until the first sample
        with open_session(session) as opened:
            start_ns, end_ns = opened.start_ns, opened.end_ns
    return datetime.fromtimestamp(end_ns / SECOND_NS, zone) if end_ns else datetime.now(zone), start_ns


def correct_mark(path: Path, correction_of: Callable[[SessionReader], Mark]) -> Mark:
    """Correct a mark of any session: by its recorder while it records, else in its file; the correction.

    Raises `ConfigError` where no mark or more than one is meant, `SessionError` where the session is
    interrupted, `RefusedError` where its recording has just ended, `StorageError`.
    """
    from fieldkit.results.marks import correct
    from fieldkit.sessions.reader import open_session

    with open_session(path) as session:
        correction = correction_of(session)
        if session.state == "recording":
            send_to_recorder(session.path.parent, correction)
        else:
            correct(session, correction)
    return correction
