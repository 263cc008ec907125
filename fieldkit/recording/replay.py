"""Play a recorded session as if it were live, through the same estimator and views."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.alarm import phase_of
from fieldkit.model.clock import HostClock
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, EventKind, Frame, Health, Reading, Severity
from fieldkit.model.site import Region, RegionRecord
from fieldkit.model.slope import SlopeEstimate, final_estimates
from fieldkit.phrases import counted
from fieldkit.recorder import View
from fieldkit.recorder.alarms import AlarmEngine
from fieldkit.recorder.recorder import Shown
from fieldkit.recording.alarms import alarm_settings
from fieldkit.results.estimate import estimates_of, estimator_for
from fieldkit.results.sources import SessionOrFile, Settings, config_for, marks_of, reading, settings_from
from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True, repr=False)
class Replay:
    """Result of a replay: the regions, the minutes that closed, the final estimate of each target.

    `alarms`: the events of all alarms, as the recording had them unless ``[alarms]`` is set otherwise.
    """

    regions: tuple[Region, ...]
    minutes: tuple[Minute, ...]
    estimates: dict[str, SlopeEstimate]
    alarms: tuple[Event, ...] = ()

    def __repr__(self) -> str:
        contents = f"{counted(len(self.minutes), 'minute')}, {counted(len(self.alarms), 'alarm event')}"
        return f"<Replay: {contents}; targets {', '.join(self.estimates) or 'none'}>"

    @property
    def learnt(self) -> Learnt | None:
        """Parameters learnt up to the end, or None if nothing."""
        return next((minute.learnt for minute in reversed(self.minutes) if minute.learnt is not None), None)


def replay(
    session: SessionOrFile,
    *,
    speed: float = math.inf,
    settings: Settings = (),
    view_of: Callable[[SessionReader, Estimator], View] | None = None,
) -> Replay:
    """Feed a recorded session to estimator and alarms as if live; no alarm is sent anywhere.

    Parameters
    ----------
    session
        The session, or its file.
    speed
        Session seconds per real second; infinity shows nothing and only estimates.
    settings
        Other values for keys of the session's configuration, as in `fieldkit.slope_map`.
    view_of
        Makes the view that shows samples, events and minutes.

    Raises
    ------
    SessionError
        The session cannot be read.
    ConfigError
        A setting is invalid.

    Examples
    --------
    >>> fieldkit.replay(session, settings={"estimator.model": "paper"})
    <Replay: 21 minutes, 0 alarm events; targets b05, b15, b25>
    """
    with reading(session) as opened:
        config = config_for(opened, settings_from(settings))
        estimator = estimator_for(opened, config)
        alarms = AlarmEngine(alarm_settings(config, tuple(opened.streams.values())))
        view = None if view_of is None or math.isinf(speed) else view_of(opened, estimator)
        minutes, raised = play(opened, estimator, alarms, speed, view)
        estimates = final_estimates(estimates_of(minutes), estimator.schedule.latest)
        return Replay(estimator.schedule.latest, tuple(minutes), estimates, tuple(raised))


def play(
    session: SessionReader, estimator: Estimator, alarms: AlarmEngine, speed: float, view: View | None
) -> tuple[list[Minute], list[Event]]:
    """Show everything in order, `speed` session seconds per real second; the minutes, the alarms' events."""
    minutes: list[Minute] = []
    raised: list[Event] = []
    for item in _at_pace(_items(session, estimator), speed):
        events = alarms.update(item)
        raised += events
        minutes += [item] if isinstance(item, Minute) else []
        if view is not None:
            for shown in (item, *events):
                view.show(shown)
    if view is not None:
        view.close()
    return minutes, raised


def _items(session: SessionReader, estimator: Estimator) -> Iterator[Shown]:
    """Items that the recorder showed, in order, with the minutes estimated again."""
    for mark in marks_of(session):
        estimator.add(mark)
    items = heapq.merge(session.samples(), _recorded_events(session), key=lambda item: item.mono_ns)
    for item in items:
        yield item
        if isinstance(item, Frame | Reading):
            yield from _with_events(estimator.add(item))
    yield from _with_events(estimator.finish())


def _at_pace(items: Iterator[Shown], speed: float) -> Iterator[Shown]:
    """The items, samples and stored events at the pace of the recording times `speed`."""
    clock = HostClock()
    began_ns, first_ns = clock.mono_ns(), None
    for item in items:
        if not isinstance(item, Minute | RegionRecord):
            first_ns = item.mono_ns if first_ns is None else first_ns
            due_ns = began_ns + round((item.mono_ns - first_ns) / speed)
            clock.sleep((due_ns - clock.mono_ns()) / 1e9)
        yield item


def _with_events(minutes: list[Minute]) -> Iterator[Shown]:
    for minute in minutes:
        yield from minute.events
        yield minute


def _recorded_events(session: SessionReader) -> list[Event | Health]:
    """Events and health of the recording, without what estimator and alarms will report again."""
    events = [event for event in session.events() if not _comes_again(event)]
    return sorted([*events, *session.health()], key=lambda item: item.mono_ns)


def _comes_again(event: Event) -> bool:
    if event.kind is EventKind.ESTIMATOR:
        # an error or a delay is of the recorder's estimator, not of the data
        return event.severity is not Severity.ERROR and "late" not in event.data
    return event.kind in (EventKind.CLOUD, EventKind.MOVED) or phase_of(event) is not None
