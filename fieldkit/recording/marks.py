"""Marks: notes made while a recording runs, each of which becomes an event of its session.

A mark's time is absolute (ISO 8601) or in seconds before now, where "now" is the time of the recording, which
differs from the wall clock in a simulated field.

A mark "shade-test b15", or "shade-test b15 end", informs the estimator that a board shades the region b15.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, ClassVar

from fieldkit.model.errors import ConfigError
from fieldkit.model.units import SECOND_NS

if TYPE_CHECKING:
    from fieldkit.model.samples import Event

_SHADE_TEST = re.compile(r"shade[ -]test (?:of )?(?P<region>.+?)(?: (?P<phase>begin|end))?", re.IGNORECASE)
TEN_YEARS_S = 10 * 365.25 * 86_400
When = float | str
"""Seconds before now (zero or negative), or an ISO 8601 time with its zone."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A note on the recording at one time, or from `at` to `to`; `label` is one word to group by."""

    text: str
    label: str = ""
    at: When = 0.0
    to: When | None = None
    do: ClassVar[str] = "mark"


def mark_event(mark: Mark, now_mono_ns: int, now_ns: int) -> Event:
    """The event of a mark that was made now; raises `ValueError` or `TypeError` for an invalid time."""
    from fieldkit.model.samples import Event, EventKind  # numpy comes with it, which a sender does without

    start_ns = _time_ns(mark.at, now_ns)
    data = mark_details(mark, now_ns if mark.to is None else _time_ns(mark.to, now_ns), now_ns)
    return Event(EventKind.MARK, now_mono_ns - (now_ns - start_ns), start_ns, mark.text, data=data)


def shade_test(text: str) -> tuple[str, str] | None:
    """Region and phase, "begin" or "end", of a mark about a shade test; None for any other text."""
    found = _SHADE_TEST.fullmatch(text.strip())
    return None if found is None else (found["region"], found["phase"] or "begin")


def mark_details(mark: Mark, end_ns: int, noted_ns: int) -> dict[str, str | int]:
    """What an event keeps of a mark besides its text: its label, a span's end, what it says of shade."""
    label: dict[str, str | int] = {"label": mark.label} if mark.label else {}
    span = label if mark.to is None else {**label, "end_ns": end_ns}
    if (test := shade_test(mark.text)) is None:
        return span
    phase = {"phase": test[1]} if mark.to is None else {}
    # when it was noted: live estimates did not know it earlier, so later ones must not either
    return {**span, "shade_test": test[0], "noted_ns": noted_ns, **phase}


def _time_ns(when: When, now_ns: int) -> int:
    if isinstance(when, int | float):
        _check_near(when, when)
        return now_ns + round(when * SECOND_NS)
    moment = datetime.fromisoformat(when)
    if moment.tzinfo is None:
        raise ValueError(f"{when!r} has no time zone")
    _check_near(when, moment.timestamp() - now_ns / SECOND_NS)
    return round(moment.timestamp() * 1e6) * 1000


def _check_near(when: When, away_s: float) -> None:
    """Raise `ConfigError` for a mistyped year: no recording is ten years long."""
    if not abs(away_s) <= TEN_YEARS_S:  # NaN is rejected too
        raise ConfigError(
            f"{when!r} is more than ten years away", fix="give the time again: fieldkit mark --at"
        )
