"""The estimator: samples in, closed minutes out, live and afterwards the same object.

It keeps the bins and watches light, shade and picture; what the slopes are is left to
`slopes`, a pure function of the bins. A minute closes when a sample arrives that is two
seconds past its end, so any interleaving within two seconds gives the same bins, and the
same bins give the same slopes to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.device import StreamInfo
from fieldkit.estimation.bins import MINUTE_NS, Bin, Camera, History, OpenMinute
from fieldkit.estimation.instruments import Instruments, Light, mean_of
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.estimation.watch import Watch, end_of
from fieldkit.estimation.window import Field
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.sun import sun_vectors
from fieldkit.samples import Event, EventKind, Quality, Reading, Sample, Severity
from fieldkit.site import Region, Site
from fieldkit.slope import SlopeEstimate

__all__ = ["GRACE_NS", "Estimator", "EstimatorSettings", "Minute"]

GRACE_NS = 2_000_000_000
"""How long after its end a minute waits for samples that are late."""


@dataclass(frozen=True, slots=True)
class Minute:
    """What became known when a minute closed.

    Temperatures in kelvin, `illuminance` in lux, `irradiance_w_m2` direct normal by the
    model named, angles in degrees; NaN where nothing was measured. `notices` are the
    estimator's events: clouds that begin and end, shade, a moved picture, samples too late.
    """

    time_ns: int
    estimates: tuple[SlopeEstimate, ...]
    temperature_k: Mapping[str, float]
    spread_k: Mapping[str, float]
    pixels: Mapping[str, int]
    illuminance: float
    irradiance_w_m2: float
    irradiance_model: str
    sun_zenith_deg: float
    sun_azimuth_deg: float
    contact_k: tuple[float, ...]
    flags: Quality
    notices: tuple[Event, ...]


class Estimator:
    """Turns samples into minutes and minutes into slopes.

    The first camera stream of a known temperature scale is used; light comes from the
    stream of direct irradiance if the irradiance model says it is measured, else from the
    illuminometer. Samples of other streams are passed over.
    """

    def __init__(
        self,
        site: Site,
        regions: Sequence[Region],
        streams: Sequence[StreamInfo],
        settings: EstimatorSettings | None = None,
    ) -> None:
        self.site, self.regions, self.settings = site, tuple(regions), settings or EstimatorSettings()
        self._instruments = Instruments(streams, self.settings.irradiance)
        self._camera: Camera | None = None
        if (info := self._instruments.camera) is not None:
            surface = self.settings.surface
            self._camera = Camera(
                info, self.regions, surface.emissivity, self.settings.reflected_temperature_k
            )
        self._open: dict[int, OpenMinute] = {}
        self._bins: list[Bin] = []
        self._closed_ns = -(2**62)
        self._late = 0
        self._watch = Watch(Field(self.regions))

    @property
    def bins(self) -> tuple[Bin, ...]:
        """All minutes closed so far."""
        return tuple(self._bins)

    def add(self, sample: Sample) -> list[Minute]:
        """Take one sample; the minutes that closed by its coming, usually none."""
        start = sample.time_ns - sample.time_ns % MINUTE_NS
        closed = self._close_before(sample.time_ns - GRACE_NS)
        if start < self._closed_ns:
            self._late += 1
            return closed
        minute = self._open.get(start)
        if minute is None:
            minute = self._open[start] = OpenMinute(start // MINUTE_NS, len(self.regions))
        if isinstance(sample, Reading):
            minute.add_reading(sample)
        elif self._camera is not None and sample.stream == self._camera.info.name:
            minute.add_frame(sample, self._camera)
        return closed

    def finish(self) -> list[Minute]:
        """Close what is open: the recording has ended."""
        return self._close_before(2**62)

    def _close_before(self, time_ns: int) -> list[Minute]:
        due = sorted(start for start in self._open if start + MINUTE_NS <= time_ns)
        if due:
            self._closed_ns = due[-1] + MINUTE_NS
        return [self._close(self._open.pop(start)) for start in due]

    def _close(self, minute: OpenMinute) -> Minute:
        light = self._instruments.light(minute, self.site, self.settings)
        entry = self._bin(minute, light)
        entry, notices = self._watch.look(entry, minute, light, self.settings)
        if self._late:
            text = f"{self._late} samples came more than 2 s late and were left out of the estimates"
            notices.append(Event(EventKind.ESTIMATOR, *end_of(minute), text, severity=Severity.WARNING))
            self._late = 0
        self._bins.append(entry)
        estimates = slopes(History.of(self._bins), self.regions, self.settings)
        zenith, azimuth = (float(angle) for angle in tilt_azimuth(entry.sun))
        names = [region.name for region in self.regions]
        return Minute(
            entry.time_ns,
            estimates,
            dict(zip(names, entry.temperature_k.tolist(), strict=True)),
            dict(zip(names, entry.spread_k.tolist(), strict=True)),
            dict(zip(names, entry.pixels.tolist(), strict=True)),
            entry.illuminance_lx,
            entry.direct_w_m2,
            self._instruments.model.label,
            zenith,
            azimuth,
            entry.contact_k,
            entry.flags,
            tuple(notices),
        )

    def _bin(self, minute: OpenMinute, light: Light) -> Bin:
        count = len(self.regions)
        temperature, spread, jitter = np.full((3, count), np.nan)
        pixels = np.zeros(count, np.int64)
        if self._camera is not None:
            temperature, spread, jitter = self._camera.means(minute.pictures)
            pixels = self._camera.outline.pixels
        sun = sun_vectors(minute.time_ns, self.site, refraction=self.settings.refraction)
        low = sun[2] < math.sin(math.radians(self.settings.low_sun_deg))
        flags = minute.flags | light.flags | (Quality.LOW_SUN if low else Quality.GOOD)
        return Bin(
            minute.minute,
            minute.time_ns,
            sun,
            temperature,
            spread,
            jitter,
            pixels,
            minute.pictures.frames,
            mean_of(light.direct_w_m2),
            light.illuminance_lx,
            self._instruments.mean(minute, "diffuse_irradiance"),
            self._instruments.mean(minute, "longwave_irradiance"),
            self._instruments.contact_k(minute),
            flags,
            (Quality.GOOD,) * count,
        )
