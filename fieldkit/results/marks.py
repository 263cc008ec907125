"""Correcting the marks of a session: taken back or edited, while the events themselves stay in it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from fieldkit.model.errors import ConfigError
from fieldkit.model.mark_times import parse_when, reject_outside, reject_unknown_region
from fieldkit.model.marks import SHADE_TEST_S, Mark, When, mark_event, marks_made, numbers_named, shade_test
from fieldkit.model.samples import Event
from fieldkit.model.site import known_zone
from fieldkit.model.units import HOUR_NS
from fieldkit.sessions.finished_file import add_later_events
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.time_map import mapped_event, recorded_event

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_TEXT_CHARS = 80


def withdrawal(session: SessionReader, name: int | str) -> Mark:
    """The mark that takes back the one of a session with that number or text; raises `ConfigError`."""
    number, mark = _mark_named(session, name)
    return Mark(f"taken back: {mark.text[:_TEXT_CHARS]}", corrects=number, takes_back=True)


def replacement(
    session: SessionReader,
    name: int | str,
    text: str | None = None,
    *,
    label: str | None = None,
    at: str | None = None,
    to: str | None = None,
) -> Mark:
    """The mark that replaces the one with that number or text: the same but for what is stated.

    Times are ISO 8601 or ``12:31`` at the site, the one nearest to the mark, or ``-30s`` before the session's
    last sample; with `at` alone the mark has no end any more. A mark that was taken back counts again. Raises
    `ConfigError`.
    """
    number, mark = _mark_named(session, name)
    # clocks show a time once in the half days around the mark
    latest_ns = min(session.end_ns, mark.time_ns + 12 * HOUR_NS)
    now = _utc(latest_ns).astimezone(known_zone(session.site.timezone) or UTC)
    start, end = _ends(mark) if at is None else (parse_when(at, now), parse_when(to, now) if to else None)
    new_label = str(mark.data.get("label", "")) if label is None else label
    longest_s = float(mark.data.get("for_s", SHADE_TEST_S))
    correction = Mark(text or mark.text, new_label, start, end, longest_s, number)
    reject_unknown_region(shade_test(correction.text), [region.name for region in session.regions])
    reject_outside(correction, session.start_ns, _utc(session.end_ns).astimezone(now.tzinfo))
    return correction


def correct(session: SessionReader, correction: Mark) -> None:
    """Add the correction of a mark to a finished session; an open one shows it once it is opened again.

    Raises `SessionError` where it is not finished, `StorageError` where it cannot be written.
    """
    now_ns = session.end_ns
    event = mark_event(correction, now_ns - session.anchor_ns, now_ns)
    add_later_events(session.path, [recorded_event(session.time_map(), event, session.anchor_ns)])


def every_mark(session: SessionReader) -> dict[int, Event]:
    """The marks by their numbers, as corrected last, or as they were made if they were taken back."""
    steps, marks = session.time_map(), marks_made(session.events(recorded=True))
    return {number: mapped_event(steps, mark) for number, mark in marks.items()} | session.marks()


def _mark_named(session: SessionReader, name: int | str) -> tuple[int, Event]:
    marks = every_mark(session)
    numbers = numbers_named(name, marks)
    if len(numbers) > 1:
        raise ConfigError(
            f"{len(numbers)} marks have the text {name!r}",
            place=session.path,
            fix=f"give a number: {', '.join(map(str, numbers))}",
        )
    return numbers[0], marks[numbers[0]]


def _ends(mark: Event) -> tuple[When, When | None]:
    end_ns = mark.data.get("end_ns")
    return _utc(mark.time_ns).isoformat(), None if end_ns is None else _utc(end_ns).isoformat()


def _utc(time_ns: int) -> datetime:
    return _EPOCH + timedelta(microseconds=time_ns // 1000)
