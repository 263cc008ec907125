"""Samples in, closed minutes out: the part of the estimator that all parameters of slopes share.

A minute closes when a sample arrives that is two seconds past its end, so any interleaving
within two seconds gives the same bins. Light, shade and picture are watched on the way.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from fieldkit.estimation.bins import CameraStream, MinuteBin, OpenBin, RegionColumns
from fieldkit.estimation.disturbances import DisturbanceMonitor, end_of
from fieldkit.estimation.instruments import Instruments, MinuteIrradiance, mean_of
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.radiation import how_to_state
from fieldkit.model.samples import Event, EventKind, Quality, Reading, Sample, Severity
from fieldkit.model.site import Region, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors

GRACE_NS = 2_000_000_000
"""How long after its end a minute waits for samples that are late."""

Closed = tuple[MinuteBin, tuple[Event, ...]]
"""A minute, and what was noticed in it: clouds, shade, a moved picture, samples too late."""


class Binner:
    """Turns samples into minutes.

    The first camera stream of a known temperature scale is used; light comes from measured direct
    irradiance, else from global irradiance, else from the illuminometer (`Instruments`). Samples of other
    streams are passed over. `irradiance_model` says in words how direct light is worked out.

    Raises `ConfigError` where the only light is of a stream whose component is unknown.
    """

    def __init__(
        self,
        site: Site,
        regions: Sequence[Region],
        streams: Sequence[StreamInfo],
        settings: EstimatorSettings,
    ) -> None:
        self._site, self._regions, self._settings = site, tuple(regions), settings
        self._instruments = Instruments(streams, settings)
        self._unasked = self._instruments.unknown
        self.irradiance_model = self._instruments.label
        self._camera: CameraStream | None = None
        if (info := self._instruments.camera) is not None:
            self._camera = CameraStream(
                info, self._regions, settings.surface.emissivity, settings.reflected_temperature_k
            )
        self._open: dict[int, OpenBin] = {}
        self._closed_ns = -(2**62)
        self._late = 0
        self._watch = DisturbanceMonitor(RegionColumns(self._regions))

    def add(self, sample: Sample) -> list[Closed]:
        """Take one sample; the minutes that closed by its coming, usually none."""
        start = sample.time_ns - sample.time_ns % MINUTE_NS
        closed = self._close_before(sample.time_ns - GRACE_NS)
        if start < self._closed_ns:
            self._late += 1
            return closed
        minute = self._open.get(start)
        if minute is None:
            minute = self._open[start] = OpenBin(start // MINUTE_NS, len(self._regions))
        if isinstance(sample, Reading):
            minute.add_reading(sample)
        elif self._camera is not None and sample.stream == self._camera.info.name:
            minute.add_frame(sample, self._camera)
        return closed

    def finish(self) -> list[Closed]:
        """Close what is open: the recording has ended."""
        return self._close_before(2**62)

    def _close_before(self, time_ns: int) -> list[Closed]:
        due = sorted(start for start in self._open if start + MINUTE_NS <= time_ns)
        if due:
            self._closed_ns = due[-1] + MINUTE_NS
        return [self._close(self._open.pop(start)) for start in due]

    def _close(self, minute: OpenBin) -> Closed:
        light = self._instruments.light(minute, self._site, self._settings)
        entry, notices = self._watch.look(self._bin(minute, light), minute, light, self._settings)
        notices.extend(self._ask(minute))
        if self._late:
            text = f"{self._late} samples came more than 2 s late and were left out of the estimates"
            notices.append(Event(EventKind.ESTIMATOR, *end_of(minute), text, severity=Severity.WARNING))
            self._late = 0
        return entry, tuple(notices)

    def _ask(self, minute: OpenBin) -> Iterator[Event]:
        """Once, for each stream that cannot serve because what it measures is unknown."""
        for name in self._unasked:
            text = f"{name}: what it measures is not known, so it is not used; {how_to_state(name)}"
            yield Event(EventKind.ESTIMATOR, *end_of(minute), text, name, Severity.WARNING)
        self._unasked = ()

    def _bin(self, minute: OpenBin, light: MinuteIrradiance) -> MinuteBin:
        count = len(self._regions)
        temperature, spread, jitter = np.full((3, count), np.nan)
        pixels = np.zeros(count, np.int64)
        if self._camera is not None:
            temperature, spread, jitter = self._camera.means(minute.pictures)
            pixels = self._camera.outline.pixels
        sun = sun_vectors(minute.time_ns, self._site, refraction=self._settings.refraction)
        low = sun[2] < math.sin(math.radians(self._settings.low_sun_deg))
        flags = minute.flags | light.flags | (Quality.LOW_SUN if low else Quality.GOOD)
        return MinuteBin(
            minute.minute,
            minute.time_ns,
            sun,
            temperature,
            spread,
            jitter,
            pixels,
            minute.pictures.frames,
            mean_of(light.dni_w_m2),
            light.illuminance_lx,
            light.dhi_w_m2,
            self._instruments.mean(minute, "longwave_down"),
            self._instruments.contact_k(minute),
            flags,
            (Quality.GOOD,) * count,
        )
