"""Alarms: what they are about, and how they travel as events of a session.

An alarm is raised, perhaps acknowledged, and cleared; each of these is an `Event` of kind ``ALARM`` whose
`data` holds the whole alarm. So the list of present alarms follows from the events alone.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, replace

from fieldkit.model.samples import Event, EventKind, Severity


class Condition(enum.StrEnum):
    """What an alarm is about; the values are the names in ``fieldkit.toml`` and in session files."""

    LOST = "lost"  # an instrument does not respond
    SILENT = "silent"  # a stream has no new sample
    FROZEN = "frozen"  # the camera repeats one frame
    OVERRANGE = "overrange"  # at the end of the range, or without a value
    GARBLED = "garbled"  # invalid records on a cable
    CLOCK = "clock"  # the system clock was stepped, or the computer slept
    DISK = "disk"  # little space, or a failed write
    ESTIMATOR = "estimator"  # no more estimates
    MOVED = "moved"  # the camera moved too far to be followed
    CLOUD = "cloud"  # unsteady light
    SHADE = "shade"  # one region alone has lost its sun
    DRIFT = "drift"  # one region alone is warmer than its trend
    TEMPERATURE = "temperature"  # outside the configured limits
    RATE = "rate"  # a temperature changes faster than configured
    TILT = "tilt"  # outside the configured limits
    TILT_PROBABILITY = "tilt-probability"  # P(tilt > limit) above the configured one
    HELD = "held"  # no slope of the present minute


class Phase(enum.StrEnum):
    """What happened to an alarm."""

    RAISED = "raised"
    ACKNOWLEDGED = "acknowledged"
    CLEARED = "cleared"


_WORDS = {Phase.RAISED: "alarm", Phase.ACKNOWLEDGED: "alarm acknowledged", Phase.CLEARED: "alarm over"}
_SEVERITIES = {severity.name.lower(): severity for severity in Severity}


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm: `subject` is a stream or a region, "" for the recording; `since_ns` its condition's begin.

    At most one alarm is present for a condition and a subject.
    """

    condition: str
    subject: str
    severity: Severity
    since_ns: int
    text: str
    acknowledged: bool = False

    @property
    def id(self) -> str:
        """Names the alarm among those present: ``lost:camera``."""
        return f"{self.condition}:{self.subject}" if self.subject else self.condition

    def event(self, phase: Phase, mono_ns: int, time_ns: int, stream: str = "") -> Event:
        """The event that reports a phase of this alarm."""
        data = {
            "alarm": self.id,
            "phase": phase.value,
            "condition": self.condition,
            "subject": self.subject,
            "severity": self.severity.name.lower(),
            "since_ns": self.since_ns,
            "text": self.text,
        }
        severity = self.severity if phase is Phase.RAISED else Severity.INFO
        return Event(
            EventKind.ALARM, mono_ns, time_ns, f"{_WORDS[phase]}: {self.text}", stream, severity, data
        )


def phase_of(event: Event) -> Phase | None:
    """What an event reports of an alarm; None for any other event, or a phase of a newer version."""
    if event.kind is not EventKind.ALARM or event.data.get("phase") not in tuple(Phase):
        return None
    return Phase(event.data["phase"])


def alarm_of(event: Event) -> Alarm:
    """The alarm that an event with a phase reports."""
    data = event.data
    return Alarm(
        str(data.get("condition", "")),
        str(data.get("subject", "")),
        _SEVERITIES.get(str(data.get("severity")), Severity.WARNING),
        int(data.get("since_ns", event.time_ns)),
        str(data.get("text", event.text)),
        acknowledged=phase_of(event) is Phase.ACKNOWLEDGED,
    )


def present_after(present: tuple[Alarm, ...], event: Event) -> tuple[Alarm, ...]:
    """The alarms present after an event, oldest first."""
    phase = phase_of(event)
    if phase is None:
        return present
    alarm = alarm_of(event)
    if phase is Phase.ACKNOWLEDGED:
        return tuple(replace(one, acknowledged=True) if one.id == alarm.id else one for one in present)
    others = tuple(one for one in present if one.id != alarm.id)
    return others if phase is Phase.CLEARED else (*others, alarm)


def present_alarms(events: Iterable[Event]) -> tuple[Alarm, ...]:
    """The alarms present after all events, in the order in which they were raised."""
    present: tuple[Alarm, ...] = ()
    for event in events:
        present = present_after(present, event)
    return present
