"""The estimator: samples in, closed minutes with slopes out, the same object live and in batch.

Samples become minute bins in `binner`; `slopes` is a pure function of the bins. So any interleaving of
samples that gives the same bins gives the same slopes, to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from fieldkit.estimation.binner import Binner, Closed
from fieldkit.estimation.bins import History, MinuteBin
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, Quality, Sample
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import SlopeEstimate
from fieldkit.physics.facet import tilt_azimuth

__all__ = ["Estimator", "EstimatorSettings", "Minute"]


@dataclass(frozen=True, slots=True)
class Minute:
    """Result of one closed minute: slopes, means of the bin, events.

    Temperatures per region in kelvin; `dni_w_m2` by `irradiance_model`, `dhi_w_m2` and `longwave_down_w_m2`
    as measured on the horizontal; angles in degrees; NaN where not measured. `events`: clouds, shade, a moved
    frame, late samples. `learnt`: what the data taught, with the learned model.
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
    learnt: Learnt | None = None

    def __repr__(self) -> str:
        start = datetime.fromtimestamp(self.time_ns / 1e9, UTC)
        slopes = ", ".join(
            f"{one.region} {one.tilt_deg:.1f}°" if one.tilt_deg == one.tilt_deg else f"{one.region} –°"
            for one in self.estimates
        )
        return f"<Minute {start:%H:%M} UTC: {slopes or 'no slopes'}; {self.dni_w_m2:.0f} W/m² direct>"


class Estimator:
    """Collects samples into minute bins (`Binner`) and estimates slopes from these (`slopes`)."""

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
        self._chain = SlopeChain(self.regions, self.settings)

    @property
    def irradiance_model(self) -> str:
        """How DNI is derived, and from which stream, in words."""
        return self._binner.irradiance_model

    @property
    def bins(self) -> tuple[MinuteBin, ...]:
        """All bins closed so far."""
        return tuple(self._bins)

    def add(self, sample: Sample | Event) -> list[Minute]:
        """Take one sample or mark; returns the minutes it closed, usually none."""
        return [self.minute(closed) for closed in self.collect(sample)]

    def finish(self) -> list[Minute]:
        """Close the open minutes at the end of a recording."""
        return [self.minute(closed) for closed in self.collect_rest()]

    def collect(self, sample: Sample | Event) -> list[Closed]:
        """Take one sample or mark; returns the bins it closed, each of which `minute` turns into slopes.

        Takes microseconds; `minute` may take a second and more, and may run in another thread.
        """
        return self._binner.add(sample)

    def collect_rest(self) -> list[Closed]:
        """Close the open bins at the end of a recording."""
        return self._binner.finish()

    def minute(self, closed: Closed) -> Minute:
        """Slopes at the end of a bin; every bin is to be given once, in order."""
        entry, events = closed
        self._bins.append(entry)
        estimated = self._chain.at(History.of(self._bins))
        zenith, azimuth = (float(angle) for angle in tilt_azimuth(entry.sun))
        names = [region.name for region in self.regions]
        return Minute(
            entry.time_ns,
            estimated.slopes,
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
            events,
            entry.dhi_w_m2,
            entry.longwave_down_w_m2,
            estimated.learnt,
        )
