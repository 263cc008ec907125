"""Play a recorded session as if it were live, through the same estimator and views."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.clock import HostClock
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, EventKind, Frame, Health, Reading
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, final_estimates
from fieldkit.recorder import View
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.workflows.estimate import estimates_of, estimator_for, minutes_of
from fieldkit.workflows.sources import config_for, marks_of


@dataclass(frozen=True)
class Replay:
    """What a replay found: the regions, the minutes that closed, the final estimate of each target."""

    regions: tuple[Region, ...]
    minutes: tuple[Minute, ...]
    estimates: dict[str, SlopeEstimate]

    @property
    def learnt(self) -> Learnt | None:
        """What the data taught up to the end, or None if nothing."""
        return next((minute.learnt for minute in reversed(self.minutes) if minute.learnt is not None), None)


def replay(
    path: str | Path,
    *,
    speed: float = math.inf,
    settings: Sequence[str] = (),
    view_of: Callable[[SessionReader, Estimator], View] | None = None,
) -> Replay:
    """Feed a recorded session to the estimator as if live.

    Parameters
    ----------
    path
        The session.
    speed
        Session seconds per real second; infinity shows nothing and only estimates.
    settings
        ``KEY=VALUE`` over the session's configuration.
    view_of
        Makes the view that shows samples, events and minutes.

    Raises
    ------
    SessionError
        The session cannot be read.
    ConfigError
        A setting is invalid.
    """
    with open_session(Path(path)) as session:
        estimator = estimator_for(session, config_for(session, settings))
        if view_of is None or math.isinf(speed):
            minutes = list(minutes_of(session, estimator))
        else:
            minutes = play(session, estimator, speed, view_of(session, estimator))
        estimates = final_estimates(estimates_of(minutes), estimator.schedule.latest)
        return Replay(estimator.schedule.latest, tuple(minutes), estimates)


def play(session: SessionReader, estimator: Estimator, speed: float, view: View) -> list[Minute]:
    """Show every sample and event in order, `speed` session seconds per real second; the closed minutes."""
    clock = HostClock()
    items = heapq.merge(session.samples(), _recorded_events(session), key=lambda item: item.mono_ns)
    minutes: list[Minute] = []
    for mark in marks_of(session):
        estimator.add(mark)
    began_ns, first_ns = clock.mono_ns(), None
    for item in items:
        first_ns = item.mono_ns if first_ns is None else first_ns
        due_ns = began_ns + round((item.mono_ns - first_ns) / speed)
        clock.sleep((due_ns - clock.mono_ns()) / 1e9)
        view.show(item)
        if isinstance(item, Frame | Reading):
            minutes += _closed(estimator.add(item), view)
    minutes += _closed(estimator.finish(), view)
    view.close()
    return minutes


def _closed(minutes: list[Minute], view: View) -> list[Minute]:
    for minute in minutes:
        for notice in minute.events:
            view.show(notice)
        view.show(minute)
    return minutes


def _recorded_events(session: SessionReader) -> list[Event | Health]:
    """Events and health of the recording, without those that the estimator will report again."""
    again = (EventKind.CLOUD, EventKind.ESTIMATOR, EventKind.MOVED)
    kept = [event for event in session.events() if event.kind not in again]
    return sorted([*kept, *session.health()], key=lambda item: item.mono_ns)
