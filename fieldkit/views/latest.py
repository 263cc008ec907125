"""The latest state of a recording, for views that redraw at their own pace.

The recorder's thread calls `Latest.update`, another thread reads. Every attribute is replaced as a whole
and never changed in place, so that a reader needs no lock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from fieldkit.model.alarm import Alarm, Phase, phase_of, present_after
from fieldkit.model.device import StreamInfo, find_camera
from fieldkit.model.samples import Event, EventKind, Frame, Health, Quality, Reading, Severity, StreamHealth
from fieldkit.model.site import Region, RegionRecord, Site
from fieldkit.views import formatting

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute

Item: TypeAlias = "Frame | Reading | Event | RegionRecord | Minute | Health"
"""What a recording passes to its views."""
EVENTS_KEPT = 50
RATE_OVER_S = 60
TILTS = ("tilt_deg", "tilt_low_deg", "tilt_high_deg")


@dataclass(frozen=True)
class Trend:
    """One value per minute and region, NaN where there is none; `times_ns` are UTC nanoseconds.

    `columns` are as long as `times_ns`, by quantity (``temperature_k``, the `TILTS`, ``shaded``: 1 or 0) and
    the region's name.
    """

    times_ns: list[int] = field(default_factory=list)
    cloudy: list[bool] = field(default_factory=list)
    columns: dict[str, dict[str, list[float]]] = field(default_factory=dict)

    def plus(self, minute: Minute) -> Trend:
        """The same with a minute's values at its end; a minute that it has already changes nothing."""
        if minute.time_ns in self.times_ns[-1:]:
            return self
        slopes = {slope.region: slope for slope in minute.estimates}
        values = {
            "temperature_k": minute.temperature_k,
            **{key: {name: getattr(slope, key) for name, slope in slopes.items()} for key in TILTS},
            "shaded": {name: float(Quality.SHADED in slope.flags) for name, slope in slopes.items()},
        }
        columns = {key: self._extend(self.columns.get(key, {}), column) for key, column in values.items()}
        cloudy = Quality.CLOUD in minute.flags
        return Trend([*self.times_ns, minute.time_ns], [*self.cloudy, cloudy], columns)

    def _extend(
        self, columns: Mapping[str, list[float]], values: Mapping[str, float]
    ) -> dict[str, list[float]]:
        """Columns with one value more; a region that is new has none for the minutes before."""
        names, unknown = {**columns, **values}, [math.nan] * len(self.times_ns)
        return {name: [*columns.get(name, unknown), values.get(name, math.nan)] for name in names}


class Latest:
    """The latest frame, readings, minute, health and events of a recording, and its trend.

    `title` names the recording, `planned_end_ns` (UTC) is its planned end, None for an open end. `items`
    counts the updates, so that a view can detect changes; `alarms` are the present ones, oldest first,
    `raised` counts all of them by severity;
    `clock_event` is the last time the clock was stepped or the computer slept.
    """

    def __init__(
        self,
        site: Site,
        regions: Sequence[Region],
        streams: Sequence[StreamInfo],
        title: str = "",
        planned_end_ns: int | None = None,
    ) -> None:
        self.site = site
        self.title: str = title
        self.planned_end_ns = planned_end_ns
        self.regions: tuple[Region, ...] = tuple(regions)
        self.streams: Mapping[str, StreamInfo] = {info.name: info for info in streams}
        self.frames: Mapping[str, Frame] = {}
        self.readings: Mapping[str, Reading] = {}
        self.minute: Minute | None = None
        self.trend: Trend = Trend()
        self.events: tuple[Event, ...] = ()
        self.alarms: tuple[Alarm, ...] = ()
        self.raised: Mapping[Severity, int] = {}
        self.gaps: Mapping[str, int] = {}
        self.clock_event: Event | None = None
        self.items: int = 0
        self.start_ns: int = 0
        self.time_ns: int = 0
        self._healths: tuple[Health, ...] = ()

    def update(self, item: Item) -> None:
        """Replace the previous item of the same kind."""
        if isinstance(item, RegionRecord):
            self.regions = item.changed(self.regions)
            return
        self.time_ns = max(self.time_ns, item.time_ns)
        self.start_ns = self.start_ns or item.time_ns
        self.items += 1
        if isinstance(item, Frame):
            self.frames = {**self.frames, item.stream: item}
        elif isinstance(item, Reading):
            self.readings = {**self.readings, item.stream: item}
        elif isinstance(item, Event):
            self._add_event(item)
        elif isinstance(item, Health):
            self._healths = (*self._healths, item)[-RATE_OVER_S - 1 :]
        else:
            self.minute, self.trend = item, self.trend.plus(item)

    def _add_event(self, event: Event) -> None:
        self.events = tuple(formatting.by_time((*self.events, event))[-EVENTS_KEPT:])
        self.alarms = present_after(self.alarms, event)
        if phase_of(event) is Phase.RAISED:
            self.raised = {**self.raised, event.severity: self.raised.get(event.severity, 0) + 1}
        if event.kind is EventKind.GAP:
            self.gaps = {**self.gaps, event.stream: self.gaps.get(event.stream, 0) + 1}
        if event.kind is EventKind.START:  # another session goes on with the recording
            self.title = str(event.data.get("session", self.title))
        if event.kind in (EventKind.CLOCK_STEP, EventKind.SLEPT):
            self.clock_event = event

    @property
    def frame(self) -> Frame | None:
        """The latest frame of the first camera."""
        return self.frame_of("")

    def frame_of(self, camera: str) -> Frame | None:
        """The latest frame of a camera, by the name that regions give it."""
        info = find_camera(self.streams.values(), camera)
        return None if info is None else self.frames.get(info.name)

    @property
    def health(self) -> Health | None:
        """Health of the recording in the last second."""
        return self._healths[-1] if self._healths else None

    def stream_health(self, name: str) -> StreamHealth | None:
        """Health of one stream in the last second."""
        streams = self.health.streams if self.health else ()
        return next((stream for stream in streams if stream.stream == name), None)

    def troubles(self, name: str) -> dict[str, int]:
        """Samples of a stream that were lost, garbled, implausible, and its gaps; empty before the first."""
        if (stream := self.stream_health(name)) is None:
            return {}
        return {
            "lost": stream.dropped,
            "garbled": stream.rejected,
            "implausible": stream.implausible,
            "gaps": self.gaps.get(name, 0),
        }

    def rate_hz(self, name: str) -> float:
        """Samples a second of a stream over the last minute; NaN until two seconds are known."""
        counts = [
            (health.mono_ns, stream.received)
            for health in self._healths
            for stream in health.streams
            if stream.stream == name
        ]
        seconds = (counts[-1][0] - counts[0][0]) / 1e9 if counts else 0.0
        return (counts[-1][1] - counts[0][1]) / seconds if seconds > 0 else float("nan")

    def age_s(self, name: str) -> float:
        """Age of the last sample of a stream, seconds; 0 before the first."""
        sample = self.frames.get(name) or self.readings.get(name)
        return (self.time_ns - sample.time_ns) / 1e9 if sample else 0.0

    def of_quantity(self, quantity: str) -> list[tuple[StreamInfo, Reading]]:
        """The latest reading of each meter of a quantity (``illuminance``, ``temperature`` ...)."""
        return [
            (info, self.readings[name])
            for name, info in self.streams.items()
            if info.quantity == quantity and name in self.readings
        ]
