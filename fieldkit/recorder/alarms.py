"""The alarm engine: what the recorder knows goes in, alarms raised, acknowledged and cleared come out.

Nothing is measured or detected here: flags of samples, events, health and minutes say what is the case; the
engine adds how long it must last (`Rule.hold_s`), when it is over, and who has been reported already.

Live and replayed alarms are equal because each is a function of time stamps alone. Samples, events and health
are put in order of time and processed two seconds late, as minute bins are; minutes, which may arrive later
still, have a time line of their own. An alarm is stamped with the time at which it was due.
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.tilt_probability import tilt_probability
from fieldkit.model.alarm import Alarm, Condition, Phase, Rule
from fieldkit.model.samples import OUT_OF_RANGE, REPEATED, Event, EventKind, Health, Quality, Sample, Severity
from fieldkit.model.site import RegionRecord
from fieldkit.model.slope import SOLVED, WITH_SLOPE, SlopeEstimate, SlopeState
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS, SECOND_NS
from fieldkit.phrases import Words

LATE_NS = 2 * SECOND_NS
"""Time that samples, events and health wait for earlier ones."""

_WATCHED_FLAGS = OUT_OF_RANGE | REPEATED
BAND_K, BAND_DEG, BAND_SHARE = 0.5, 1.0, 0.1
"""Distance that a value must be back inside its limit: kelvin, degrees of tilt, a share of the limit."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one region, NaN for none; `tilt_probability` is that of P(tilt > `tilt_max_deg`)."""

    temperature_min_c: float = math.nan
    temperature_max_c: float = math.nan
    temperature_rate_k_min: float = math.nan
    tilt_min_deg: float = math.nan
    tilt_max_deg: float = math.nan
    tilt_probability: float = math.nan


@dataclass(frozen=True, slots=True)
class AlarmSettings:
    """Conditions that raise alarms.

    `intervals_s` is the expected time between samples of each stream that is watched, `garbled_per_min` the
    number of invalid records of a stream in a minute from which they are an alarm; `limits` holds those of
    single regions, `other_limits` those of all others.
    """

    rules: Mapping[Condition, Rule] = field(
        default_factory=lambda: {condition: condition.rule for condition in Condition}
    )
    intervals_s: Mapping[str, float] = field(default_factory=dict)
    garbled_per_min: int = 5
    other_limits: Limits = field(default_factory=Limits)
    limits: Mapping[str, Limits] = field(default_factory=dict)


@dataclass(slots=True)
class _Watch:
    """One condition of one subject: whether it is the case, since when, and the alarm that was raised."""

    condition: Condition
    subject: str
    rule: Rule
    is_on: bool = False
    since_ns: int = 0
    text: str = ""
    alarm: Alarm | None = None

    def observe(self, is_on: bool, time_ns: int, text: str = "") -> Iterator[tuple[Alarm, Phase, int]]:
        """Set the condition from a time on; yields what that, and the time until then, leads to."""
        yield from self.until(time_ns)
        if is_on != self.is_on:
            self.is_on, self.since_ns = is_on, time_ns
            self.text = text or Words(f"alarm.{self.condition}", subject=self.subject)
        yield from self.until(time_ns)

    def until(self, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        """Alarms due up to a time: an alarm with its phase, and when."""
        wait_s = self.rule.hold_s if self.is_on else self.rule.clear_s
        due_ns = self.since_ns + round(wait_s * SECOND_NS)
        if self.rule.off or time_ns < due_ns or self.is_on == (self.alarm is not None):
            return
        if self.is_on:
            self.alarm = Alarm(
                self.condition.value, self.subject, self.rule.severity, self.since_ns, self.text
            )
            yield self.alarm, Phase.RAISED, due_ns
        elif self.alarm is not None:
            over, self.alarm = self.alarm, None
            yield over, Phase.CLEARED, due_ns


_Waiting = tuple[int, bool, str, int, Event | Quality]
"""An event, or the flags of a sample, with its time; at equal times events come first."""


class AlarmEngine:
    """Watches one recording, live or replayed; give it every stored sample and event, health and minutes."""

    def __init__(self, settings: AlarmSettings | None = None) -> None:
        self._settings = settings or AlarmSettings()
        self._watches: dict[tuple[Condition, str], _Watch] = {}
        self._waiting: list[_Waiting] = []
        self._flags: dict[str, Quality] = {}
        self._minutes = _MinuteConditions(self._settings)
        self._garbled: dict[str, deque[int]] = {}
        self._mono_minus_utc, self._latest_ns, self._number = 0, -(2**62), 0
        self._started = False

    @property
    def present(self) -> tuple[Alarm, ...]:
        """The alarms that are present now, oldest first."""
        alarms = [watch.alarm for watch in self._watches.values() if watch.alarm is not None]
        return tuple(sorted(alarms, key=lambda alarm: alarm.since_ns))

    def update(self, item: Sample | Event | Health | Minute | RegionRecord) -> list[Event]:
        """Take what was recorded; returns the alarms raised, acknowledged and cleared, as events."""
        if isinstance(item, Minute):
            return self._events(self._minute(item))
        if isinstance(item, RegionRecord):
            return []
        if isinstance(item, Event):
            self._wait(item.time_ns, item.stream, item)
            return self._events(self._process(item.time_ns)) if item.kind is EventKind.STOP else []
        self._mono_minus_utc = item.mono_ns - item.time_ns
        if isinstance(item, Health):
            return self._events(self._tick(item))
        self._latest_ns = max(self._latest_ns, item.time_ns)
        self._wait(item.time_ns, item.stream, item.quality & _WATCHED_FLAGS)
        return []

    def _events(self, changes: Iterator[tuple[Alarm, Phase, int]]) -> list[Event]:
        return [alarm.event(phase, at + self._mono_minus_utc, at) for alarm, phase, at in changes]

    # --- samples, events and health, in order of time

    def _wait(self, time_ns: int, stream: str, what: Event | Quality) -> None:
        self._number += 1
        heapq.heappush(self._waiting, (time_ns, isinstance(what, Quality), stream, self._number, what))

    def _tick(self, health: Health) -> Iterator[tuple[Alarm, Phase, int]]:
        if not self._started:
            self._started = True
            for stream in self._settings.intervals_s:
                yield from self._arm(stream, health.time_ns)
        until_ns = health.time_ns - LATE_NS
        if any(status.queued for status in health.streams):  # what waits to be stored is no silence
            until_ns = min(until_ns, self._latest_ns)
        yield from self._process(until_ns)
        for status in health.streams:
            yield from self._count_garbled(status.stream, status.rejected, health.time_ns - LATE_NS)

    def _process(self, until_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        while self._waiting and self._waiting[0][0] <= until_ns:
            time_ns, _, stream, _, what = heapq.heappop(self._waiting)
            yield from self._due(time_ns)
            yield from self._event(what) if isinstance(what, Event) else self._sample(stream, what, time_ns)
        yield from self._due(until_ns)

    def _due(self, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        """Alarms due in these streams without anything new: dead-man and hold times."""
        for (condition, _), watch in tuple(self._watches.items()):
            if not condition.by_minute:
                yield from watch.until(time_ns)
                if condition is Condition.LOST and watch.is_on and watch.alarm is not None:
                    # explains the silence
                    yield from self._observe(Condition.SILENT, watch.subject, False, time_ns)

    def _sample(self, stream: str, flags: Quality, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        yield from self._observe(Condition.LOST, stream, False, time_ns)
        if stream in self._settings.intervals_s:
            yield from self._arm(stream, time_ns)
        if flags == self._flags.get(stream, Quality.GOOD):
            return
        self._flags[stream] = flags
        yield from self._observe(Condition.OVERRANGE, stream, bool(flags & OUT_OF_RANGE), time_ns)
        is_frozen = Quality.FROZEN in flags
        if is_frozen or Quality.DUPLICATE not in flags:
            yield from self._observe(Condition.FROZEN, stream, is_frozen, time_ns)

    def _arm(self, stream: str, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        """From now on, no sample within the hold time is an alarm."""
        watch = self._watch(Condition.SILENT, stream)
        yield from watch.observe(False, time_ns)
        yield from watch.observe(True, time_ns)

    def _event(self, event: Event) -> Iterator[tuple[Alarm, Phase, int]]:
        at, stream = event.time_ns, event.stream
        if event.kind is EventKind.LOST and event.severity is not Severity.ERROR:
            yield from self._observe(Condition.LOST, stream, True, at, f"{stream} does not respond")
        elif event.kind is EventKind.BACK:
            yield from self._observe(Condition.LOST, stream, False, at)
            if not self._watch(Condition.SILENT, stream).is_on and stream in self._settings.intervals_s:
                yield from self._arm(stream, at)
        elif event.kind in (EventKind.CLOCK_STEP, EventKind.SLEPT):
            yield from self._pulse(Condition.CLOCK, event)
        elif event.kind is EventKind.DISK:
            yield from self._disk(event)
        elif "late" in event.data:
            yield from self._observe(Condition.LATE, "", event.data["late"] == "begin", at, event.text)
        elif event.kind is EventKind.ESTIMATOR and event.severity is Severity.ERROR:
            yield from self._observe(Condition.LATE, "", False, at)
            yield from self._observe(Condition.ESTIMATOR, "", True, at, event.text)
        elif "acknowledge" in event.data:
            yield from self._acknowledge(str(event.data["acknowledge"]), at)

    def _disk(self, event: Event) -> Iterator[tuple[Alarm, Phase, int]]:
        if (phase := event.data.get("phase")) is not None:
            yield from self._observe(Condition.DISK, "", phase == "begin", event.time_ns, event.text)
        elif event.severity is not Severity.INFO and not self._watch(Condition.DISK, "").is_on:
            yield from self._pulse(Condition.DISK, event)

    def _pulse(self, condition: Condition, event: Event) -> Iterator[tuple[Alarm, Phase, int]]:
        """An event without an end: over at once, cleared after the clear time."""
        yield from self._observe(condition, "", True, event.time_ns, event.text)
        yield from self._observe(condition, "", False, event.time_ns)

    def _count_garbled(self, stream: str, rejected: int, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        """Invalid records within the last minute, from the counts of each second."""
        counts = self._garbled.setdefault(stream, deque(maxlen=61))
        counts.append(rejected)
        is_on = rejected - counts[0] >= self._settings.garbled_per_min
        if is_on or (Condition.GARBLED, stream) in self._watches:
            text = f"{stream} sends garbled records: {self._settings.garbled_per_min} or more in a minute"
            yield from self._observe(Condition.GARBLED, stream, is_on, time_ns, text)

    def _acknowledge(self, name: str, time_ns: int) -> Iterator[tuple[Alarm, Phase, int]]:
        for watch in self._watches.values():
            alarm = watch.alarm
            if alarm is not None and alarm.id == name and not alarm.acknowledged:
                watch.alarm = replace(alarm, acknowledged=True)
                yield watch.alarm, Phase.ACKNOWLEDGED, time_ns

    # --- minutes, on a time line of their own

    def _minute(self, minute: Minute) -> Iterator[tuple[Alarm, Phase, int]]:
        end_ns = minute.time_ns - minute.time_ns % MINUTE_NS + MINUTE_NS
        if end_ns > self._latest_ns:  # cut short by the end of the recording
            return
        for state in self._minutes.update(minute):
            yield from self._watch(state.condition, state.subject).observe(state.is_on, end_ns, state.text)

    def _observe(
        self, condition: Condition, subject: str, is_on: bool, time_ns: int, text: str = ""
    ) -> Iterator[tuple[Alarm, Phase, int]]:
        if is_on or (condition, subject) in self._watches:
            yield from self._watch(condition, subject).observe(is_on, time_ns, text)

    def _watch(self, condition: Condition, subject: str) -> _Watch:
        key = (condition, subject)
        if key not in self._watches:
            rule = self._settings.rules[condition]
            if condition is Condition.SILENT:
                rule = replace(rule, hold_s=rule.hold_s + self._settings.intervals_s.get(subject, 0.0))
            self._watches[key] = _Watch(condition, subject, rule)
        return self._watches[key]


class _Found(NamedTuple):
    """State of a condition in a minute."""

    condition: Condition
    subject: str
    is_on: bool
    text: str = ""


_OF_REGIONS = {
    "shaded": Condition.SHADE,
    "shade_test": Condition.SHADE,  # reported when it has ended
    "drift": Condition.DRIFT,
}
"""Entries of an estimator's event in its data about a region, and the condition it begins or ends."""


class _MinuteConditions:
    """State of the conditions in each minute, of those that are judged minute by minute."""

    def __init__(self, settings: AlarmSettings) -> None:
        self._settings = settings
        self._was: dict[tuple[Condition, str], bool] = {}
        self._kelvin: dict[str, tuple[int, float]] = {}
        self._solved: set[str] = set()

    def update(self, minute: Minute) -> Iterator[_Found]:
        """The conditions at the end of a minute."""
        observations = [*self._disturbances(minute), *self._temperatures(minute)]
        for estimate in minute.estimates:
            observations += self._slopes(estimate)
        states = {(state.condition, state.subject): state for state in observations}  # the last of a minute
        self._was.update({subject: state.is_on for subject, state in states.items()})
        yield from states.values()

    def _disturbances(self, minute: Minute) -> Iterator[_Found]:
        """Clouds, shade and drift go on until they are reported to be over, or the frame has moved."""
        has_moved = bool(minute.flags & Quality.MOVED)
        yield _Found(Condition.MOVED, "", has_moved, "the camera cannot be followed: regions are lost")
        for (condition, subject), was_on in self._was.items():
            if condition in (Condition.CLOUD, Condition.SHADE, Condition.DRIFT):
                yield _Found(condition, subject, was_on and not (has_moved and subject))
        for event in minute.events:
            begins = event.data.get("phase") == "begin"
            if event.kind is EventKind.CLOUD:
                yield _Found(Condition.CLOUD, "", begins, "the light is unsteady: clouds")
            for name, condition in _OF_REGIONS.items():
                if name in event.data:
                    yield _Found(condition, str(event.data[name]), begins and not has_moved, event.text)

    def _temperatures(self, minute: Minute) -> Iterator[_Found]:
        at = minute.time_ns // MINUTE_NS
        for region, kelvin in minute.temperature_k.items():
            if not math.isfinite(kelvin):
                continue
            limits, celsius = self._limits(region), kelvin - CELSIUS_ZERO_K
            subject = (Condition.TEMPERATURE, region)
            span = (limits.temperature_min_c, limits.temperature_max_c)
            yield self._judge(subject, celsius, span, BAND_K, f"{region} has {celsius:.1f} °C")
            before, self._kelvin[region] = self._kelvin.get(region), (at, kelvin)
            if before is not None and at > before[0]:
                rate = (kelvin - before[1]) / (at - before[0])
                limit = limits.temperature_rate_k_min
                text = f"the temperature of {region} changes by {rate:+.1f} K a minute"
                yield self._judge((Condition.RATE, region), rate, (-limit, limit), BAND_SHARE * limit, text)

    def _slopes(self, estimate: SlopeEstimate) -> Iterator[_Found]:
        region, limits = estimate.region, self._limits(estimate.region)
        if estimate.state in SOLVED:
            self._solved.add(region)
        is_held = region in self._solved and estimate.state not in (*SOLVED, SlopeState.LOW_SUN)
        state = estimate.state.name.lower().replace("_", " ")
        yield _Found(Condition.HELD, region, is_held, f"no new slope of {region}: {state}")
        if estimate.state not in WITH_SLOPE:
            return
        span = (limits.tilt_min_deg, limits.tilt_max_deg)
        text = f"the tilt of {region} is {estimate.tilt_deg:.1f}°"
        yield self._judge((Condition.TILT, region), estimate.tilt_deg, span, BAND_DEG, text)
        share, limit = tilt_probability(estimate, limits.tilt_max_deg), limits.tilt_probability
        text = f"P(tilt of {region} > {limits.tilt_max_deg:g}°) is {share:.2f}"
        subject = (Condition.TILT_PROBABILITY, region)
        yield self._judge(subject, share, (math.nan, limit), BAND_SHARE * limit, text)

    def _judge(
        self,
        subject: tuple[Condition, str],
        value: float,
        span: tuple[float, float],
        band: float,
        text: str,
    ) -> _Found:
        """True if a value is outside its limits; once it is, until it is back inside by the band."""
        (low, high), was_on = span, self._was.get(subject, False)
        slack = band if was_on else 0.0
        is_on = was_on if math.isnan(value) else value > high - slack or value < low + slack
        return _Found(*subject, is_on, f"{text}, limit {high if value > high else low:g}")

    def _limits(self, region: str) -> Limits:
        return self._settings.limits.get(region, self._settings.other_limits)
