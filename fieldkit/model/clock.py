"""The clock of a session: UTC anchored at its start to the monotonic counter, and the ways to wait.

Nothing else in fieldkit reads the system's time or sleeps, so a day of field work can be tested in
seconds by passing another clock. Checks against the system clock are
recorded, never applied while recording.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Protocol

from fieldkit.model.errors import ConfigError

YEARS = range(1700, 2251)
"""64 bits of nanoseconds since 1970 reach from 1677 to 2262."""


def require_storable(when: date) -> None:
    """Raise `ValueError` unless the year lies within `YEARS`."""
    if when.year not in YEARS:
        raise ValueError(f"the year must lie within {YEARS[0]}..{YEARS[-1]}")


def as_moment(at: datetime | str) -> datetime:
    """A time with its zone, also from ISO 8601; raises `ConfigError`, or `ValueError` outside `YEARS`."""
    try:
        moment = at if isinstance(at, datetime) else datetime.fromisoformat(at)
    except ValueError as error:
        raise ConfigError("not a time", place=repr(at), fix="write it as 2017-08-30T12:00+09:00") from error
    if moment.tzinfo is None:
        raise ConfigError("has no time zone", place=str(at), fix="add its offset from UTC, such as +09:00")
    require_storable(moment)
    return moment


def as_day(day: date | str) -> date:
    """A day of the calendar, also from ISO 8601; raises `ConfigError`, or `ValueError` outside `YEARS`."""
    try:
        day = day if isinstance(day, date) else date.fromisoformat(day)
    except ValueError as error:
        raise ConfigError("not a day", place=repr(day), fix="write it as 2017-08-30") from error
    require_storable(day)
    return day


def utc_ns(moment: datetime) -> int:
    """UTC nanoseconds since 1970 of a moment with a zone, exact to the microsecond.

    Raises `ValueError` outside `YEARS`.
    """
    require_storable(moment)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


@dataclass(frozen=True, slots=True)
class ClockCheck:
    """One comparison of the system's UTC with the monotonic counter.

    `utc_minus_mono_ns` as found; `error_ns` is half the time the comparison took;
    `suspended_ns` is how long the computer has slept since it booted, which the monotonic
    counter does not see.
    """

    mono_ns: int
    utc_minus_mono_ns: int
    error_ns: int
    source: str = "system"
    suspended_ns: int = 0


class Clock(Protocol):
    """The clock of a session. Times are int64 nanoseconds.

    `is_real`: time passes by itself, so that waiting in the kernel is waiting by this clock.
    """

    is_real: bool

    def mono_ns(self) -> int:
        """Monotonic time, never steps."""

    def to_utc_ns(self, mono_ns: int) -> int:
        """UTC of a monotonic time by the anchor that was taken last."""

    def take_anchor(self) -> None:
        """Anchor UTC anew, at the start of a session."""

    def check(self) -> ClockCheck:
        """Compare the system's UTC with the monotonic counter now."""

    def sleep(self, seconds: float) -> None:
        """Wait."""

    def wait_readable(self, fd: int, timeout_s: float) -> bool:
        """Wait until `fd` has bytes to read; False if it has none within `timeout_s`."""

    def taking_part(self) -> AbstractContextManager[None]:
        """Context of a thread that waits by this clock."""

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Hold simulated time until work is done; real time cannot be held and ignores it.

        `settled(timeout_s)` waits until it is, at most that long, and returns whether it is.
        """


def time_left(clock: Clock, timeout_s: float) -> Iterator[float]:
    """The seconds left of a time-out, again and again until none are."""
    deadline_ns = clock.mono_ns() + int(timeout_s * 1e9)
    while (left_ns := deadline_ns - clock.mono_ns()) > 0:
        yield left_ns / 1e9


class HostClock:
    """The computer's own clock; `mono_ns` is CLOCK_MONOTONIC in nanoseconds."""

    is_real = True
    mono_ns: staticmethod[[], int] = staticmethod(time.monotonic_ns)

    def __init__(self) -> None:
        self.take_anchor()

    def take_anchor(self) -> None:
        """Anchor UTC by the system clock as it is now."""
        self.anchor: ClockCheck = self.check()

    def to_utc_ns(self, mono_ns: int) -> int:
        """UTC nanoseconds since 1970 by the anchor that was taken last."""
        return mono_ns + self.anchor.utc_minus_mono_ns

    def check(self) -> ClockCheck:
        """Tightest of eight comparisons (monotonic, wall, monotonic)."""
        return min((self._compare() for _ in range(8)), key=lambda check: check.error_ns)

    @staticmethod
    def _compare() -> ClockCheck:
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        middle = (before + after) // 2
        return ClockCheck(middle, wall - middle, (after - before) // 2, suspended_ns=_suspended_ns())

    def sleep(self, seconds: float) -> None:
        """Wait in real time; nothing to do for zero or less."""
        if seconds > 0:
            time.sleep(seconds)

    def wait_readable(self, fd: int, timeout_s: float) -> bool:
        """`poll` on the descriptor."""
        poll = select.poll()
        poll.register(fd, select.POLLIN | select.POLLERR | select.POLLHUP)
        return bool(poll.poll(max(0.0, timeout_s) * 1000.0))

    def taking_part(self) -> AbstractContextManager[None]:
        """Nothing to do: real time passes for all threads."""
        return nullcontext()

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Nothing to do: real time cannot be held."""


def _suspended_ns() -> int:
    if not hasattr(time, "CLOCK_BOOTTIME"):  # only Linux counts the time asleep
        return 0
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)
