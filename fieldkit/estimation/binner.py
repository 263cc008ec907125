"""Samples in, closed minute bins out: the part of the estimator that does not depend on slope settings.

A bin closes when a sample arrives two seconds past its end, so any interleaving of streams within two seconds
gives the same bins. Disturbances are flagged on the way.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from fieldkit.estimation.bins import CameraStream, Follower, MinuteBin, OpenBin
from fieldkit.estimation.disturbances import DisturbanceMonitor, end_of
from fieldkit.estimation.instruments import Instruments, MinuteIrradiance, mean_of
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.channels import AIR_TEMPERATURE, WIND_SPEED, how_to_state
from fieldkit.model.device import StreamInfo, find_camera
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.samples import Event, EventKind, Quality, Reading, Sample, Severity
from fieldkit.model.site import Region, RegionRecord, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.phrases import Words
from fieldkit.physics.sun import sun_vectors

GRACE_NS = 2_000_000_000
"""Time that a bin waits for late samples after its end."""

Closed = tuple[MinuteBin, tuple[Event, ...]]
"""A bin, and its events: clouds, shade, a moved frame, late samples."""


class Binner:
    """Collects samples into minute bins.

    Each region is seen by its own camera, of those with a known temperature scale; DNI comes from measured
    direct irradiance, else from global irradiance, else from the illuminance meter (`Instruments`), as
    `irradiance_model` says in words. Samples of other streams are skipped. Regions that change hold in whole
    minutes; every outline has a column of its own. Raises `ConfigError` if the only light is from a stream of
    unknown component.
    """

    def __init__(
        self,
        site: Site,
        regions: Regions,
        streams: Sequence[StreamInfo],
        settings: EstimatorSettings,
    ) -> None:
        self._site, self._settings = site, settings
        self.schedule: RegionSchedule = RegionSchedule.of(regions)
        self._instruments = Instruments(streams, settings)
        self._unreported = self._instruments.unknown
        self._absent = self._instruments.absent
        self.irradiance_model: str = self._instruments.label
        # a bin that is still open may hold other regions than the next
        self._cameras_of = lru_cache(maxsize=2)(self._looking_at)
        self._open: dict[int, OpenBin] = {}
        self._closed_ns = -(2**62)
        self._late = 0
        self._sun_was_up = False
        self._disturbances = DisturbanceMonitor()
        # the configured pose is that of the first camera
        self._followers = {
            info.name: Follower(None if place else settings.camera_path)
            for place, info in enumerate(self._instruments.cameras)
        }

    def add(self, sample: Sample | Event | RegionRecord) -> list[Closed]:
        """Take one sample, mark or change of the regions; returns the bins it closed, usually none.

        A mark may come as early as wanted: it counts from the minute in which it was made. So may a change.
        """
        if isinstance(sample, RegionRecord):
            self.schedule = self.schedule.with_record(sample)
            return []
        if isinstance(sample, Event):
            self._disturbances.add(sample)
            return []
        start = sample.time_ns - sample.time_ns % MINUTE_NS
        closed = self._close_before(sample.time_ns - GRACE_NS)
        if start < self._closed_ns:
            self._late += 1
            return closed
        if (minute := self._open.get(start)) is None:
            number = start // MINUTE_NS
            columns = self.schedule.at(number)
            minute = self._open[start] = OpenBin(number, columns, self._cameras_of(tuple(columns.tolist())))
        if isinstance(sample, Reading):
            minute.add_reading(sample)
        elif (frames := minute.cameras.get(sample.stream)) is not None:
            frames.add_frame(sample, self._followers[sample.stream])
        return closed

    def _looking_at(self, columns: tuple[int, ...]) -> list[CameraStream]:
        """The cameras, each with those of the regions that it looks at."""
        cameras = self._instruments.cameras
        by_camera: dict[str, dict[int, Region]] = {info.name: {} for info in cameras}
        for column in columns:
            region = self.schedule.columns[column]
            if (info := find_camera(cameras, region.camera)) is not None:
                by_camera[info.name][column] = region
        return [CameraStream(info, by_camera[info.name], self._settings) for info in cameras]

    def finish(self) -> list[Closed]:
        """Close the open bins at the end of a recording."""
        return self._close_before(2**62, is_last=True)

    def _close_before(self, time_ns: int, *, is_last: bool = False) -> list[Closed]:
        due = sorted(start for start in self._open if start + MINUTE_NS <= time_ns)
        if due:
            self._closed_ns = due[-1] + MINUTE_NS
        return [self._close(self._open.pop(start), is_last) for start in due]

    def _close(self, minute: OpenBin, is_last: bool) -> Closed:
        light = self._instruments.light(minute, self._site, self._settings)
        entry, events = self._disturbances.update(
            self._bin(minute, light), minute, light, self._settings, self.schedule, is_last=is_last
        )
        events.extend(self._sunset(entry, minute))
        events.extend(self._unknown_streams(minute))
        if self._late:
            late = {"excluded": self._late}
            text = Words("event.estimator.excluded", **late)
            events.append(Event(EventKind.ESTIMATOR, *end_of(minute), text, "", Severity.WARNING, late))
            self._late = 0
        return entry, tuple(events)

    def _sunset(self, entry: MinuteBin, minute: OpenBin) -> Iterator[Event]:
        """Once the sun has set on the regions: what the next hour is worth."""
        is_up = bool(entry.sun[2] > 0.0)
        if self._sun_was_up and not is_up and minute.columns.size:
            text = Words("event.estimator.sunset")
            yield Event(EventKind.ESTIMATOR, *end_of(minute), text, data={"sunset": 1})
        self._sun_was_up = is_up

    def _unknown_streams(self, minute: OpenBin) -> Iterator[Event]:
        """Once for each stream that is not used because what it measures is unknown, or that is not there."""
        for name in self._unreported:
            text = f"{name}: what it measures is not known, so it is not used; {how_to_state(name)}"
            yield Event(EventKind.ESTIMATOR, *end_of(minute), text, name, Severity.WARNING, {"unused": name})
        self._unreported = ()
        for name in self._absent:
            absent = {"absent": name}
            text = Words("event.estimator.absent", **absent)
            yield Event(EventKind.ESTIMATOR, *end_of(minute), text, "", Severity.WARNING, absent)
        self._absent = ()

    def _bin(self, minute: OpenBin, light: MinuteIrradiance) -> MinuteBin:
        regions = self.schedule.columns
        count = len(regions)
        temperature, spread, probe = np.full((3, count), np.nan)
        pixels = np.zeros(count, np.int64)
        for part in minute.cameras.values():
            columns = part.camera.columns
            temperature[columns], spread[columns] = part.camera.means(part.sums)
            pixels[columns] = part.camera.mean_pixels(part.sums)
        held = [regions[column] for column in minute.columns]
        if (probes := self._instruments.probe_k(minute, held)).size:
            probe[minute.columns] = probes
        sun = sun_vectors(minute.time_ns, self._site, refraction=self._settings.refraction)
        low = sun[2] < math.sin(math.radians(self._settings.low_sun_deg))
        moved = minute.not_whole | minute.lost
        flags = minute.flags | light.flags | (Quality.LOW_SUN if low else Quality.GOOD)
        return MinuteBin(
            minute=minute.minute,
            time_ns=minute.time_ns,
            sun=sun,
            temperature_k=temperature,
            spread_k=spread,
            pixels=pixels,
            frames=minute.frames,
            dni_w_m2=mean_of(light.dni_w_m2),
            illuminance_lx=light.illuminance_lx,
            dhi_w_m2=light.dhi_w_m2,
            longwave_down_w_m2=self._instruments.mean(minute, "longwave_down"),
            contact_k=self._instruments.contact_k(minute),
            flags=flags,
            region_flags=tuple(Quality.MOVED if column in moved else Quality.GOOD for column in range(count)),
            air_k=self._instruments.mean(minute, AIR_TEMPERATURE),
            wind_m_s=self._instruments.mean(minute, WIND_SPEED),
            probe_k=probe if probes.size else probes,
            shift_px=minute.shift_px,
        )
