"""Marks: notes on a recording, each of which becomes an event of its session.

A mark has a number in its session, counted from 1 in the order in which marks were made. A later mark that
`corrects` it by this number takes its place, or takes it back; the event itself stays in the session.

A mark's time is absolute (ISO 8601) or in seconds before now, where "now" is the time of the recording, which
differs from the wall clock in a simulated field.

A mark "shade-test b15", or "shade-test b15 end", informs the estimator that a board shades the region b15.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from fieldkit.model.clock import as_moment
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind
from fieldkit.model.units import SECOND_NS
from fieldkit.phrases import Words

_SHADE_TEST = re.compile(r"shade[ -]test (?:of )?(?P<region>.+?)(?: (?P<phase>begin|end))?", re.IGNORECASE)
_NO_NOTE = {"corrects", "acknowledge"}
"""Details of marks that are not notes: corrections of others, acknowledgements of alarms."""
SHADE_TEST_S = 1200.0
"""Time after which a shade test has ended that is not ended before, unless a mark states another."""
TEN_YEARS_S = 10 * 365.25 * 86_400
When = float | str
"""Seconds before now (zero or negative), or an ISO 8601 time with its zone."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A note on the recording at one time, or from `at` to `to`; `label` is one word to group by.

    `longest_s` is the time after which a shade test that it begins has ended. `corrects` is the number of the
    mark that it takes back, or else whose place it takes.
    """

    text: str
    label: str = ""
    at: When = 0.0
    to: When | None = None
    longest_s: float = SHADE_TEST_S
    corrects: int = 0
    takes_back: bool = False
    do: ClassVar[str] = "mark"


def mark_event(mark: Mark, now_mono_ns: int, now_ns: int) -> Event:
    """The event of a mark that was made now; raises `ValueError` or `TypeError` for an invalid time."""
    start_ns = _time_ns(mark.at, now_ns)
    data = mark_details(mark, now_ns if mark.to is None else _time_ns(mark.to, now_ns), now_ns)
    return Event(EventKind.MARK, now_mono_ns - (now_ns - start_ns), start_ns, mark.text, data=data)


def shade_test(text: str) -> tuple[str, str] | None:
    """Region and phase, "begin" or "end", of a mark about a shade test; None for any other text."""
    match = _SHADE_TEST.fullmatch(text.strip())
    return None if match is None else (match["region"], match["phase"] or "begin")


def mark_details(mark: Mark, end_ns: int, noted_ns: int) -> dict[str, str | int | float]:
    """Details of a mark in its event, besides its text: label, end of a span, shade test."""
    label: dict[str, str | int | float] = {"label": mark.label} if mark.label else {}
    span = label if mark.to is None else {**label, "end_ns": end_ns}
    if mark.corrects:
        span |= {"corrects": mark.corrects} | ({"takes_back": 1} if mark.takes_back else {})
    if (test := shade_test(mark.text)) is None:
        return span
    phase: dict[str, str | float] = {"phase": test[1]} if mark.to is None else {}
    if phase.get("phase") == "begin" and mark.longest_s != SHADE_TEST_S:
        phase["for_s"] = mark.longest_s
    # when it was noted: live estimates did not know it earlier, so later ones must not either
    noted = {} if mark.corrects else {"noted_ns": noted_ns}
    return {**span, "shade_test": test[0], **noted, **phase}


def marks_made(events: Iterable[Event]) -> dict[int, Event]:
    """The marks among a session's events by their numbers, as they were made."""
    marks_made = (event for event in events if event.kind is EventKind.MARK)
    return dict(enumerate((mark for mark in marks_made if not mark.data.keys() & _NO_NOTE), start=1))


def marks_now(events: Collection[Event]) -> dict[int, Event]:
    """The marks among a session's events by their numbers, as corrected last; without those taken back."""
    last = {event.data["corrects"]: event for event in events if isinstance(event.data.get("corrects"), int)}
    now = {number: last.get(number, mark) for number, mark in marks_made(events).items()}
    return {number: _as_made(mark) for number, mark in now.items() if "takes_back" not in mark.data}


def _as_made(mark: Event) -> Event:
    return replace(mark, data={name: value for name, value in mark.data.items() if name != "corrects"})


def corrected_events(events: Collection[Event]) -> list[Event]:
    """A session's events with every mark as corrected last, without those taken back."""
    now = marks_now(events)
    places = {id(mark): now.get(number) for number, mark in marks_made(events).items()}
    latest = (places.get(id(event), event) for event in events if "corrects" not in event.data)
    return [event for event in latest if event is not None]


def numbers_named(name: int | str, marks: Mapping[int, Event]) -> list[int]:
    """Numbers of the marks that a number or a text names; raises `ConfigError` if there are none."""
    numbers = [number for number, mark in marks.items() if str(name) in (str(number), mark.text)]
    if not numbers:
        choices = "; ".join(f"{number} {mark.text[:40]}" for number, mark in marks.items())
        fix = Words("fix.marks", marks=choices) if choices else None
        raise ConfigError(Words("error.no_mark"), place=repr(name), fix=fix)
    return numbers


def _time_ns(when: When, now_ns: int) -> int:
    if isinstance(when, int | float):
        _check_near(when, when)
        return now_ns + round(when * SECOND_NS)
    moment = as_moment(when)
    _check_near(when, moment.timestamp() - now_ns / SECOND_NS)
    return round(moment.timestamp() * 1e6) * 1000


def _check_near(when: When, away_s: float) -> None:
    """Raise `ConfigError` for a mistyped year: no recording is ten years long."""
    if not abs(away_s) <= TEN_YEARS_S:  # NaN is rejected too
        raise ConfigError(Words("error.decade"), place=str(when), fix=Words("fix.date"))
