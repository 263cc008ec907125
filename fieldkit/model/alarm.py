"""Alarms: what they are about, and how they travel as events of a session.

An alarm is raised, perhaps acknowledged, and cleared; each of these is an `Event` of kind ``ALARM`` whose
`data` holds the whole alarm. So the list of present alarms follows from the events alone.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import reduce
from typing import Self

from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.phrases import Words


@dataclass(frozen=True, slots=True)
class Rule:
    """Times that a condition must last to raise its alarm, and be over to clear it, s; `off`: never."""

    severity: Severity
    hold_s: float
    clear_s: float
    off: bool = False


_INFO, _WARNING, _ERROR = Severity.INFO, Severity.WARNING, Severity.ERROR


class Condition(enum.StrEnum):
    """Condition of an alarm; the values are the names in ``fieldkit.toml`` and in session files.

    `rule` is that of a campaign that configures none, `meaning` says when the alarm is raised, in the words
    of the documentation; `by_minute` are judged minute by minute, the others every second.
    """

    rule: Rule
    meaning: str
    by_minute: bool

    LOST = "lost", Rule(_ERROR, 5.0, 10.0), "an instrument does not respond"
    SILENT = (
        "silent",
        Rule(_ERROR, 30.0, 0.0),
        "a stream has no new sample, beyond its interval: no news is an alarm",
    )
    FROZEN = "frozen", Rule(_ERROR, 0.0, 10.0), "the camera repeats one frame"
    OVERRANGE = (
        "overrange",
        Rule(_WARNING, 10.0, 10.0),
        "a meter or the camera is at the end of its range, shows no value, or one that cannot be",
    )
    GARBLED = (
        "garbled",
        Rule(_WARNING, 10.0, 60.0),
        "`garbled_per_min` invalid records of an instrument within a minute",
    )
    CLOCK = "clock", Rule(_WARNING, 0.0, 300.0), "the system clock was stepped, or the computer slept"
    DISK = "disk", Rule(_ERROR, 0.0, 60.0), "less than 15 minutes of space are left, or a write failed"
    ESTIMATOR = "estimator", Rule(_ERROR, 0.0, 0.0), "live estimates have stopped"
    LATE = "late", Rule(_WARNING, 60.0, 0.0), "live estimates are more than a minute late"
    MOVED = (
        "moved",
        Rule(_ERROR, 60.0, 120.0),
        "the camera moved too far to be followed; such minutes enter no slope",
        True,
    )
    CLOUD = "cloud", Rule(_INFO, 0.0, 0.0), "the light is unsteady", True
    SHADE = "shade", Rule(_INFO, 60.0, 0.0), "one region alone is shaded", True
    DRIFT = "drift", Rule(_WARNING, 60.0, 0.0), "one region alone became warmer than its trend", True
    TEMPERATURE = (
        "temperature",
        Rule(_WARNING, 0.0, 60.0),
        "a region is outside `temperature_min_c` … `temperature_max_c`",
        True,
    )
    RATE = "rate", Rule(_WARNING, 60.0, 60.0), "a region changes by more than `temperature_rate_k_min`", True
    TILT = (
        "tilt",
        Rule(_WARNING, 120.0, 120.0),
        "the estimated tilt is outside `tilt_min_deg` … `tilt_max_deg`",
        True,
    )
    TILT_PROBABILITY = (
        "tilt-probability",
        Rule(_WARNING, 120.0, 120.0),
        "P(tilt > `tilt_max_deg`) is above `tilt_probability`",
        True,
    )
    HELD = "held", Rule(_WARNING, 1800.0, 0.0), "there was a slope, but none of the present minutes", True

    def __new__(cls, value: str, rule: Rule, meaning: str, by_minute: bool = False) -> Self:
        """A member of that value, with what belongs to it."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.rule, member.meaning, member.by_minute = rule, meaning, by_minute
        return member


class Phase(enum.StrEnum):
    """Phase of an alarm."""

    RAISED = "raised"
    ACKNOWLEDGED = "acknowledged"
    CLEARED = "cleared"


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

    def event(self, phase: Phase, mono_ns: int, time_ns: int) -> Event:
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
        text = Words(f"event.alarm.{phase}", alarm=self.text)
        return Event(EventKind.ALARM, mono_ns, time_ns, text, severity=severity, data=data)


def phase_of(event: Event) -> Phase | None:
    """Phase of an alarm in an event; None for any other event, or a phase of a newer version."""
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
    if (phase := phase_of(event)) is None:
        return present
    alarm = alarm_of(event)
    if phase is Phase.ACKNOWLEDGED:
        return tuple(replace(a, acknowledged=True) if a.id == alarm.id else a for a in present)
    others = tuple(other for other in present if other.id != alarm.id)
    return others if phase is Phase.CLEARED else (*others, alarm)


def present_alarms(events: Iterable[Event]) -> tuple[Alarm, ...]:
    """The alarms present after all events, in the order in which they were raised."""
    nothing: tuple[Alarm, ...] = ()
    return reduce(present_after, events, nothing)
