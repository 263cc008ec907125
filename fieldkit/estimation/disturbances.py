"""Disturbances: clouds, shade on one region, a frame that moved or froze; flags on the bins, and events.

Clouds begin and end by the light readings (`CloudMonitor`): a change by more than 15 % within two minutes is
faster than the sun can move. `Cusum` finds level shifts of a temperature without any light meter: on the
reference it confirms the weather, on one region against the reference it finds a shadow (`ShadeMonitor`).
A shadow with sharp edges, and one that was marked, is known to the minute (`shade`).
Where the camera moved the regions follow (`following`); here it is reported, and where they are lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from fieldkit.estimation.bins import MinuteBin, OpenBin
from fieldkit.estimation.instruments import MinuteIrradiance, mean_of
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.shade import ShadedMinutes, ShadeMarks, ShadeTest, ShadeTestMonitor
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Reading, Severity
from fieldkit.model.site import RegionKind
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.phrases import Words
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share

# more than the sun's own motion makes of the light in so short a time
SUDDEN_CHANGE = 0.15
SUDDEN_S = 120.0
# light that stays within this for so long is past the cloud's edge
STEADY_CHANGE = 0.05
STEADY_S = 60.0
NEW_WEATHER_S = 1200.0  # a level that lasts is the weather, no disturbance of it
MIN_VALUES = 10  # of fewer neither the parabola nor the scatter about it is known
SLOT_NS = 5 * SECOND_NS  # bounds what a fast meter costs
GUST_SD_K = 0.2
"""Scatter of a region's temperature from minute to minute by gusts outdoors: the least noise assumed."""
UNCOOLED_K = 2.0 * GUST_SD_K
"""Cooling within a minute and a half that a board exceeds even in thin sun, on dry sand by several times."""
MOVED_PX = 1.5
"""Growth of the correction that is worth an event."""
SLACK_SDS, ALARM_SDS, MEMORY_MINUTES = 0.5, 8.0, 30
"""Page's k and h, in standard deviations, and the minutes that a forecast is fitted to."""


class DisturbanceMonitor:
    """Flags bins with clouds, shade on one region, and frames that moved or froze; reports what changes.

    A region that is redrawn is watched anew, and so are all against a reference that is.
    """

    def __init__(self) -> None:
        self._schedule = RegionSchedule.of(())
        self._first_drawn: set[int] = set()
        self._references: tuple[int, ...] = ()
        self._light = CloudMonitor()
        self._reference = Cusum(least_sd=GUST_SD_K)
        self._shade: dict[int, ShadeMonitor] = {}
        self._drift: dict[int, ShadeMonitor] = {}
        self._drifting: set[int] = set()
        self._steady_from = -1
        self._tests = ShadeTestMonitor()
        self._marks = ShadeMarks()
        self._minutes = ShadedMinutes()
        self._marked: set[ShadeTest] = set()
        self._shaded: set[int] = set()
        self._shift_px = 0.0
        self._is_lost = False
        self._outside: set[int] = set()
        self._settled_ns = -(2**62)  # long past, and far from the end of 64 bits
        self._last_sums: dict[str, tuple[int, list[int]]] = {}
        self._events: list[Event] = []  # of the present bin, which ends at these monotonic and UTC times
        self._at_ns = (0, 0)

    def add(self, mark: Event) -> None:
        """Take a note on the recording, which may be about the shade of a region."""
        self._marks.add(mark)

    def update(
        self,
        entry: MinuteBin,
        minute: OpenBin,
        light: MinuteIrradiance,
        settings: EstimatorSettings,
        schedule: RegionSchedule,
        *,
        is_last: bool = False,
    ) -> tuple[MinuteBin, list[Event]]:
        """The bin with its flags, and the events to report; `is_last` at the end of a recording."""
        self._follow(schedule, minute)
        self._events, self._at_ns = [], end_of(minute)
        self._clouds(light, settings)
        if self._light.cloudy or self._events or entry.start_ns < self._settled_ns:
            entry = replace(entry, flags=entry.flags | Quality.CLOUD)
        reference_k = mean_of(entry.temperature_k[list(self._references)])
        self._jumps(entry, reference_k)
        entry = self._shades(entry, reference_k, self._below_horizon(entry, settings), is_last=is_last)
        self._drifts(entry, reference_k)
        if minute.last_frame is not None:
            entry = self._frozen(entry, minute)
            self._leaving(minute)
            self._movement(minute)
        return entry, self._events

    def _report(
        self,
        text: str,
        severity: Severity = Severity.INFO,
        kind: EventKind = EventKind.ESTIMATOR,
        **data: Any,
    ) -> None:
        self._events.append(Event(kind, *self._at_ns, text, severity=severity, data=data))

    def _name(self, column: int) -> str:
        return self._schedule.columns[column].name

    def _follow(self, schedule: RegionSchedule, minute: OpenBin) -> None:
        """Watch the regions that hold in this minute."""
        kinds = {int(column): schedule.columns[column].kind for column in minute.columns}
        if not self._first_drawn & kinds.keys():  # all were redrawn, on the frames as they are now
            self._first_drawn, self._shift_px, self._is_lost = set(kinds), 0.0, False
        references = tuple(column for column, kind in kinds.items() if kind is RegionKind.REFERENCE)
        if references != self._references:
            self._reference, self._shade, self._drift = Cusum(least_sd=GUST_SD_K), {}, {}
        targets = [column for column, kind in kinds.items() if kind is RegionKind.TARGET]
        self._shade = {column: self._shade.get(column) or ShadeMonitor() for column in targets}
        self._drift = {column: self._drift.get(column) or ShadeMonitor() for column in targets}
        self._schedule, self._references = schedule, references

    def _clouds(self, light: MinuteIrradiance, settings: EstimatorSettings) -> None:
        for reading, clearness in zip(light.readings, light.clearness.tolist(), strict=True):
            if (change := self._light.update(reading.time_ns, clearness)) is None:
                continue
            phase, why = change
            if phase == "end":
                self._settled_ns = reading.time_ns + round(settings.settle_s * 1e9)
            at_ns, text = (reading.mono_ns, reading.time_ns), f"cloud {phase}s: {why}"
            severity = Severity.WARNING if phase == "begin" else Severity.INFO
            data = {"phase": phase}
            self._events.append(Event(EventKind.CLOUD, *at_ns, text, reading.stream, severity, data))

    def _jumps(self, entry: MinuteBin, reference_k: float) -> None:
        if (jump := self._reference.update(entry.minute, reference_k)) is None:
            return
        off_k, is_clouded = jump.found - jump.expected, bool(entry.flags & Quality.CLOUD)
        why = ", and so does the light" if is_clouded else " in steady light: wind, shade or a drift"
        text = f"the reference's temperature deviates from its trend by {off_k:+.1f} K{why}"
        self._report(text, reference_k=round(float(off_k), 2))

    def _shades(self, entry: MinuteBin, reference_k: float, below: set[int], *, is_last: bool) -> MinuteBin:
        # a ridge's shadow is known already, and no board
        kelvin = entry.temperature_k.copy()
        kelvin[list(below)] = np.nan
        ended = self._tests.update(entry.minute, kelvin, self._light.cloudy)
        marked = self._marks.tests(entry.minute, self._schedule, is_last=is_last)
        tested = self._tests.columns | {test.column for test in (*ended, *(set(marked) ^ self._marked))}
        self._marked = set(marked)
        slow = self._slow_shades(entry, reference_k, tested | below) | below
        shaded, reflagged = self._minutes.update(entry.minute, self._tests.shaded, slow, marked)
        self._report_shades(shaded, ended)
        if not (entry.flags & (Quality.CLOUD | Quality.LOW_SUN)):
            self._report_uncooled(entry.minute, marked)
        flags = [
            flag | Quality.SHADED if column in shaded else flag
            for column, flag in enumerate(entry.region_flags)
        ]
        return replace(entry, region_flags=tuple(flags), reflagged=reflagged)

    def _below_horizon(self, entry: MinuteBin, settings: EstimatorSettings) -> set[int]:
        """Regions whose horizon hides some of the sun; below the level horizon none is shaded alone."""
        if entry.sun[2] <= 0.0:
            return set()
        return {
            column
            for column in (*self._references, *self._shade)
            if sunlit_share(settings.horizon_of(self._name(column)), entry.sun, MINUTE_EDGE_DEG) < 1.0
        }

    def _slow_shades(self, entry: MinuteBin, reference_k: float, tested: set[int]) -> set[int]:
        """Targets that have cooled against the reference, apart from regions in a shade test."""
        if tested & set(self._references):
            self._reference, tested = Cusum(least_sd=GUST_SD_K), set(self._shade)
        # a forecast must be fitted neither to the shaded minutes nor to those before
        self._shade.update({column: ShadeMonitor() for column in tested & set(self._shade)})
        # a cloud is not a shadow: while the light changes no single region is shaded
        lit_k = np.nan if entry.flags & Quality.CLOUD else reference_k
        over_k = entry.temperature_k - lit_k
        return {
            column
            for column, monitor in self._shade.items()
            if column not in tested and monitor.update(entry.minute, float(over_k[column]))
        }

    def _report_shades(self, shaded: set[int], ended: list[ShadeTest]) -> None:
        changed, self._shaded = shaded ^ self._shaded, shaded
        for column in sorted(changed - {test.column for test in ended}):
            name, phase = self._name(column), "begin" if column in shaded else "end"
            text = Words(f"event.estimator.shaded.{phase}", shaded=name)
            self._report(text, Severity.WARNING, shaded=name, phase=phase)
        for test in ended:
            name = self._name(test.column)
            lasted = f"shade test of {name}, {(test.end_ns - test.begin_ns) / MINUTE_NS:.0f} min"
            self._report(lasted, shade_test=name, begin_ns=test.begin_ns, end_ns=test.end_ns)

    def _report_uncooled(self, minute: int, marked: list[ShadeTest]) -> None:
        """Shade tests, marked in the minute before, that cool nothing in a whole minute."""
        whole = {test.column for test in marked if test.end_ns >= (minute + 1) * MINUTE_NS}
        for column in sorted(whole & self._marks.just_begun(minute, self._schedule)):
            if self._tests.cooling_k(minute, column) < UNCOOLED_K:
                name = self._name(column)
                text = Words("event.estimator.uncooled", uncooled=name)
                self._report(text, Severity.WARNING, uncooled=name)

    def _drifts(self, entry: MinuteBin, reference_k: float) -> None:
        """Targets that begin or end to be warmer than their trend: the opposite of a shade."""
        if entry.flags & Quality.CLOUD or self._shaded:
            self._steady_from = entry.minute + round(NEW_WEATHER_S / 60.0)
        unsteady = entry.minute < self._steady_from
        if unsteady:  # forecasts must not be fitted to these minutes, nor to the sand's recovery
            self._drift = {column: ShadeMonitor() for column in self._drift}
        over_k = entry.temperature_k - (np.nan if unsteady else reference_k)
        drifts = {
            column
            for column, monitor in self._drift.items()
            # a shade monitor sees falls: with the sign changed it sees what grows warmer
            if monitor.update(entry.minute, -float(over_k[column]))
        }
        changed, self._drifting = drifts ^ self._drifting, drifts
        for column in sorted(changed):
            name, phase = self._name(column), "begin" if column in drifts else "end"
            text = Words(f"event.estimator.drift.{phase}", drift=name)
            severity = Severity.WARNING if phase == "begin" else Severity.INFO
            self._report(text, severity, drift=name, phase=phase)

    def _frozen(self, entry: MinuteBin, minute: OpenBin) -> MinuteBin:
        """The bin, flagged and without temperatures where its frames are those of the bin before."""
        for name, frames in minute.cameras.items():
            last, sums = self._last_sums.get(name), (frames.sums.frames, frames.sums.totals)
            self._last_sums[name] = sums
            # no two bins of a camera that lives have equal sums over thousands of noisy pixels
            if sums == last and frames.sums.frames:
                kelvin = entry.temperature_k.copy()
                kelvin[frames.camera.columns] = np.nan
                entry = replace(entry, flags=entry.flags | Quality.FROZEN, temperature_k=kelvin)
        return entry

    def _leaving(self, minute: OpenBin) -> None:
        """Single regions that leave the frame, and that are back."""
        if not minute.frames:
            return
        before, self._outside = self._outside, minute.not_whole
        for column in sorted(before ^ self._outside):
            name, phase = self._name(column), "lost" if column in self._outside else "back"
            if phase == "lost" or column in minute.columns:
                text = Words(f"event.moved.region.{phase}", region=name)
                severity = Severity.WARNING if phase == "lost" else Severity.INFO
                self._report(text, severity, EventKind.MOVED, phase=phase, region=name)

    def _movement(self, minute: OpenBin) -> None:
        """Regions that are lost, are found again, or followed by `MOVED_PX` more."""
        was_lost, self._is_lost = self._is_lost, bool(minute.loss)
        if minute.loss and not was_lost:
            text = f"{minute.loss}: regions are lost, such minutes enter no slope"
            self._report(text, Severity.WARNING, EventKind.MOVED, phase="lost")
        if minute.loss or not (was_lost or minute.shift_px > self._shift_px + MOVED_PX):
            return
        self._shift_px = max(minute.shift_px, self._shift_px)
        shift = {"shift_px": round(minute.shift_px, 2)}
        text = Words("event.moved.corrected", **shift)
        self._report(text, Severity.INFO, EventKind.MOVED, phase="corrected", **shift)


def end_of(minute: OpenBin) -> tuple[int, int]:
    """Monotonic and UTC nanoseconds of the last sample of a bin."""
    samples: list[Frame | Reading] = [r for readings in minute.readings.values() for r in readings]
    if minute.last_frame is not None:
        samples.append(minute.last_frame)
    last = max(samples, key=lambda sample: sample.time_ns, default=None)
    return (last.mono_ns, last.time_ns) if last is not None else (0, minute.time_ns)


CloudChange = tuple[Literal["begin", "end"], str]
"""The light became unsteady or steady again, with the reason in words."""


class CloudMonitor:
    """Begin and end of clouds, from light readings in order of time.

    Each reading is relative to what the sun's elevation alone explains. A change of 15 % within two minutes
    begins a cloud. It ends when the light has been steady (5 %) for one minute near its old level, or for 20
    minutes at a new one, which then counts as the weather.
    """

    def __init__(self) -> None:
        self._recent: deque[tuple[int, float, float]] = deque()
        self._level = float("nan")
        self._steady_since = 0
        self._steady_at = float("nan")
        self.cloudy: bool = False

    def update(self, time_ns: int, clearness: float) -> CloudChange | None:
        """Take one reading relative to its clear-sky expectation; NaN and values <= 0 are skipped."""
        if not np.isfinite(clearness) or clearness <= 0.0:
            return None
        self._remember(time_ns // SLOT_NS, clearness)
        if self.cloudy:
            return self._ending(time_ns, clearness)
        lowest = min(low for _, low, _ in self._recent)
        highest = max(high for _, _, high in self._recent)
        change = max(clearness / highest - 1.0, clearness / lowest - 1.0, key=abs)
        if abs(change) <= SUDDEN_CHANGE:
            return None
        self.cloudy = True
        self._level = highest if change < 0 else lowest
        self._steady_since, self._steady_at = time_ns, clearness
        return "begin", f"light changed by {change:+.0%} within 2 min"

    def _remember(self, slot: int, clearness: float) -> None:
        """Keep the lowest and highest of every 5 s, to bound the cost of a fast meter."""
        while self._recent and (slot - self._recent[0][0]) * SLOT_NS > SUDDEN_S * 1e9:
            self._recent.popleft()
        if self._recent and self._recent[-1][0] == slot:
            _, low, high = self._recent.pop()
            self._recent.append((slot, min(low, clearness), max(high, clearness)))
        else:
            self._recent.append((slot, clearness, clearness))

    def _ending(self, time_ns: int, clearness: float) -> CloudChange | None:
        if abs(clearness / self._steady_at - 1.0) > STEADY_CHANGE:
            self._steady_since, self._steady_at = time_ns, clearness
            return None
        steady_s = (time_ns - self._steady_since) / 1e9
        back = abs(clearness / self._level - 1.0) <= SUDDEN_CHANGE
        if steady_s < (STEADY_S if back else NEW_WEATHER_S):
            return None
        self.cloudy = False
        self._recent.clear()  # the level of before may be another weather's
        text = "light is back" if back else f"light steady at {clearness / self._level:.0%} of its old level"
        return "end", text


@dataclass(frozen=True, slots=True)
class Jump:
    """A value off its forecast: expected and found."""

    expected: float
    found: float


@dataclass(slots=True)
class Cusum:
    """Two-sided cumulative sum on the residuals of a quadratic forecast of one-minute values.

    With a limit of 8 seven clear hours raise no false alarm. The forecast is fitted to the last
    `MEMORY_MINUTES`; its residual is scaled by the scatter of past ones, at least `least_sd`.

    References
    ----------
    E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954.
    """

    least_sd: float = 0.03
    _high: float = 0.0
    _low: float = 0.0
    _values: deque[tuple[float, float]] = field(default_factory=deque)
    _errors: deque[float] = field(default_factory=lambda: deque(maxlen=MEMORY_MINUTES))

    def update(self, minute: int, value: float) -> Jump | None:
        """Take the value of a minute; returns a `Jump` on alarm. NaN is skipped.

        An alarm clears the past: new weather cannot be forecast from the old.
        """
        if not np.isfinite(value):
            return None
        while self._values and minute - self._values[0][0] > MEMORY_MINUTES:
            self._values.popleft()
        jump = None
        if len(self._values) >= MIN_VALUES:
            expected, leverage = _forecast(self._values, minute)
            if self._accumulate((value - expected) / np.sqrt(1.0 + leverage)):
                jump = Jump(expected, value)
                self._values.clear()
                self._errors.clear()
        self._values.append((minute, value))
        return jump

    def _accumulate(self, error: float) -> bool:
        """True if a sum passes the limit; both begin anew then."""
        scatter = float(np.std(self._errors)) if len(self._errors) >= MIN_VALUES else 0.0
        score = error / max(self.least_sd, scatter)
        self._errors.append(error)
        self._high = max(0.0, self._high + score - SLACK_SDS)
        self._low = max(0.0, self._low - score - SLACK_SDS)
        if max(self._high, self._low) <= ALARM_SDS:
            return False
        self._high = self._low = 0.0
        return True


def _forecast(values: Sequence[tuple[float, float]], minute: int) -> tuple[float, float]:
    """Quadratic forecast for a minute, and its own variance relative to the noise."""
    past = np.array(values)
    design = np.vander((past[:, 0] - minute) / 30.0, 3)
    inverse = np.linalg.inv(design.T @ design)
    return float((inverse @ design.T @ past[:, 1])[2]), float(inverse[2, 2])


class ShadeMonitor:
    """Shade on one region alone: its temperature over the reference's falls below the forecast.

    The shade ends when half the fall is recovered, and after 20 minutes, when the new level counts as normal.
    """

    def __init__(self) -> None:
        self._cusum = Cusum(least_sd=GUST_SD_K)
        self._fall: Jump | None = None
        self._since = 0

    def update(self, minute: int, over_reference_k: float) -> bool:
        """True if the region is shaded in this minute."""
        jump = self._cusum.update(minute, over_reference_k)
        if self._fall is None:
            if jump is not None and jump.found < jump.expected:
                self._fall, self._since = jump, minute
            return self._fall is not None
        half = 0.5 * (self._fall.expected + self._fall.found)
        if over_reference_k > half or (minute - self._since) * 60.0 >= NEW_WEATHER_S:
            # forecasts must not be fitted to the shaded minutes
            self._fall, self._cusum = None, Cusum(least_sd=GUST_SD_K)
        return self._fall is not None
