"""What the minutes say about weather, shade and camera: flags on the bins, and events to tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldkit.estimation.bins import Bin, OpenMinute
from fieldkit.estimation.instruments import Light, mean_of
from fieldkit.estimation.light import GUST_SD_K, Cusum, Jump, LightWatch, ShadeWatch
from fieldkit.estimation.picture import PictureWatch
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.window import Field
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Reading, Severity


class Watch:
    """Looks for clouds, shade on one bed, and a picture that moved or froze."""

    def __init__(self, field: Field) -> None:
        self._field = field
        self._light = LightWatch()
        self._reference = Cusum(least_sd=GUST_SD_K)
        self._shade = {int(column): ShadeWatch() for column in field.targets}
        self._shaded: set[int] = set()
        self._picture = PictureWatch()
        self._moved = False
        self._settled_ns = -(2**62)
        self._last_sums: tuple[int, list[int]] | None = None

    def look(
        self, entry: Bin, minute: OpenMinute, light: Light, settings: EstimatorSettings
    ) -> tuple[Bin, list[Event]]:
        """The bin with its flags, and what is to be told."""
        notices = self._clouds(entry, light, settings)
        if self._light.cloudy or notices or entry.start_ns < self._settled_ns:
            entry = replace(entry, flags=entry.flags | Quality.CLOUD)
        reference_k = mean_of(entry.temperature_k[self._field.references])
        jump = self._reference.add(entry.minute, reference_k)
        if jump is not None:
            notices.append(_jump_notice(jump, minute, bool(entry.flags & Quality.CLOUD)))
        entry = self._shades(entry, reference_k, minute, notices)
        return self._pictures(entry, minute, notices), notices

    def _clouds(self, entry: Bin, light: Light, settings: EstimatorSettings) -> list[Event]:
        notices = []
        for reading, clearness in zip(light.readings, light.clearness.tolist(), strict=True):
            change = self._light.add(reading.mono_ns, reading.time_ns, clearness)
            if change is None:
                continue
            if change.kind == "end":
                self._settled_ns = change.time_ns + round(settings.settle_s * 1e9)
            data = {"phase": change.kind}
            severity = Severity.WARNING if change.kind == "begin" else Severity.INFO
            text = f"cloud {change.kind}s: {change.text}"
            notices.append(
                Event(EventKind.CLOUD, change.mono_ns, change.time_ns, text, reading.stream, severity, data)
            )
        return notices

    def _shades(self, entry: Bin, reference_k: float, minute: OpenMinute, notices: list[Event]) -> Bin:
        flags = list(entry.region_flags)
        for column, watch in self._shade.items():
            # a cloud is not a shadow: while the light changes no bed is singled out
            over = float("nan") if entry.flags & Quality.CLOUD else entry.temperature_k[column] - reference_k
            shaded = watch.add(entry.minute, float(over))
            if shaded:
                flags[column] |= Quality.SHADED
            if shaded != (column in self._shaded):
                self._shaded ^= {column}
                text = (
                    f"{self._field.regions[column].name} {'alone lost its sun' if shaded else 'is lit again'}"
                )
                notices.append(Event(EventKind.ESTIMATOR, *end_of(minute), text, severity=Severity.WARNING))
        return replace(entry, region_flags=tuple(flags))

    def _pictures(self, entry: Bin, minute: OpenMinute, notices: list[Event]) -> Bin:
        if minute.first_frame is None:
            return entry
        sums = (minute.pictures.frames, minute.pictures.totals)
        if sums == self._last_sums:
            blank = np.full_like(entry.temperature_k, np.nan)
            entry = replace(entry, flags=entry.flags | Quality.FROZEN, temperature_k=blank)
        self._last_sums = sums
        moved = self._picture.add(minute.first_frame.counts)
        if moved and not self._moved:
            text = f"picture moved {self._picture.shift_px:.1f} px, regions may be off their beds"
            notices.append(Event(EventKind.MOVED, *end_of(minute), text, severity=Severity.WARNING))
        self._moved = moved
        return replace(entry, flags=entry.flags | Quality.MOVED) if moved else entry


def end_of(minute: OpenMinute) -> tuple[int, int]:
    """Monotonic and UTC nanoseconds of the last sample of a minute."""
    samples: list[Frame | Reading] = [r for readings in minute.readings.values() for r in readings]
    if minute.first_frame is not None:
        samples.append(minute.first_frame)
    last = max(samples, key=lambda sample: sample.time_ns, default=None)
    return (last.mono_ns, last.time_ns) if last is not None else (0, minute.time_ns)


def _jump_notice(jump: Jump, minute: OpenMinute, clouded: bool) -> Event:
    change = f"the reference's temperature left its trend by {jump.found - jump.expected:+.1f} K"
    text = f"{change}, as the light did" if clouded else f"{change} in steady light: wind, shade or a drift"
    return Event(EventKind.ESTIMATOR, *end_of(minute), text)
