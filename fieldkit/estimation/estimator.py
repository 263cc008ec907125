"""The estimator: samples in, closed minutes with slopes out, live and afterwards the same object.

Samples become bins in `binner`; what the slopes are is left to `slopes`, a pure function of
the bins. So any interleaving of samples that gives the same bins gives the same slopes, to
the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fieldkit.estimation.binner import Binner, Closed
from fieldkit.estimation.bins import History, MinuteBin
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, Quality, Sample
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import SlopeEstimate
from fieldkit.physics.facet import tilt_azimuth

__all__ = ["Estimator", "EstimatorSettings", "Minute"]


@dataclass(frozen=True, slots=True)
class Minute:
    """What became known when a minute closed.

    Temperatures in kelvin, `dni_w_m2` direct normal by the
    model named, diffuse light and downward longwave as measured on the horizontal, angles in degrees;
    NaN where nothing was measured. `events` are the
    estimator's events: clouds that begin and end, shade, a moved picture, samples too late.
    """

    time_ns: int
    estimates: tuple[SlopeEstimate, ...]
    temperature_k: Mapping[str, float]
    spread_k: Mapping[str, float]
    pixels: Mapping[str, int]
    illuminance_lx: float
    dni_w_m2: float
    irradiance_model: str
    sun_zenith_deg: float
    sun_azimuth_deg: float
    contact_k: tuple[float, ...]
    flags: Quality
    events: tuple[Event, ...]
    dhi_w_m2: float = math.nan
    longwave_down_w_m2: float = math.nan


class Estimator:
    """Turns samples into minutes (`Binner`) and minutes into slopes."""

    def __init__(
        self,
        site: Site,
        regions: Sequence[Region],
        streams: Sequence[StreamInfo],
        settings: EstimatorSettings | None = None,
    ) -> None:
        self.site, self.regions, self.settings = site, tuple(regions), settings or EstimatorSettings()
        self._binner = Binner(site, self.regions, streams, self.settings)
        self._bins: list[MinuteBin] = []

    @property
    def irradiance_model(self) -> str:
        """How direct light is worked out from the stream that gives it, in words."""
        return self._binner.irradiance_model

    @property
    def bins(self) -> tuple[MinuteBin, ...]:
        """All minutes closed so far."""
        return tuple(self._bins)

    def add(self, sample: Sample) -> list[Minute]:
        """Take one sample; the minutes that closed by its coming, usually none."""
        return [self._minute(closed) for closed in self._binner.add(sample)]

    def finish(self) -> list[Minute]:
        """Close what is open: the recording has ended."""
        return [self._minute(closed) for closed in self._binner.finish()]

    def _minute(self, closed: Closed) -> Minute:
        entry, notices = closed
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
            entry.dni_w_m2,
            self.irradiance_model,
            zenith,
            azimuth,
            entry.contact_k,
            entry.flags,
            notices,
            entry.dhi_w_m2,
            entry.longwave_down_w_m2,
        )
