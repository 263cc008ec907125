"""Play a recorded session as if it were live, through the same estimator and view."""

from __future__ import annotations

import heapq

from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.clock import HostClock
from fieldkit.model.samples import Event, EventKind, Frame, Health, Reading
from fieldkit.recorder import View
from fieldkit.sessions.reader import Session


def play(session: Session, estimator: Estimator, speed: float, view: View) -> list[Minute]:
    """Show every sample and event in order, `speed` session seconds per real second; the closed minutes."""
    clock = HostClock()
    items = heapq.merge(session.samples(), _recorded_events(session), key=lambda item: item.mono_ns)
    minutes: list[Minute] = []
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


def _recorded_events(session: Session) -> list[Event | Health]:
    """Events and health of the recording, without those that the estimator will report again."""
    again = (EventKind.CLOUD, EventKind.ESTIMATOR, EventKind.MOVED)
    kept = [event for event in session.events() if event.kind not in again]
    return sorted([*kept, *session.health()], key=lambda item: item.mono_ns)
