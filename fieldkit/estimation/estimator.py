"""The estimator: samples in, closed minutes with slopes out, the same object live and in batch.

Samples become minute bins in `binner`; `slopes` is a pure function of the bins. So any interleaving of
samples that gives the same bins gives the same slopes, to the last bit.
"""

from __future__ import annotations

import math
import pickle
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import chain

from fieldkit.estimation.binner import Binner, Closed
from fieldkit.estimation.bins import History, pad
from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.learnt import Learnt
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.samples import Event, Quality, Sample
from fieldkit.model.site import Region, RegionRecord, Site
from fieldkit.model.slope import ReferenceCheck, SlopeEstimate
from fieldkit.physics.facet import tilt_azimuth

PACKED_MINUTES = 60
"""Minutes that are kept as they are before they are packed: a day of them as objects has 10 MB."""

__all__ = ["Estimator", "EstimatorSettings", "Minute"]


@dataclass(frozen=True, slots=True)
class Minute:
    """Result of one closed minute: slopes, means of the bin, events.

    Temperatures per region in kelvin; `dni_w_m2` by `irradiance_model`, `dhi_w_m2` and `longwave_down_w_m2`
    as measured on the horizontal; angles in degrees; NaN where not measured. `events`: clouds, shade, a moved
    frame, late samples. `learnt`: the learned model's parameters.

    Examples
    --------
    >>> minutes = []
    >>> session = fieldkit.record(campaign, duration="8m", name="short", on_minute=minutes.append)
    >>> minutes[-1]
    <Minute 19:08 UTC: b05 4.7°, b15 14.5°, b25 24.0°; 1023 W/m² direct>
    >>> sorted(minutes[0].temperature_k)
    ['b05', 'b15', 'b25', 'flat']
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
        tilts = ((slope.region, f"{slope.tilt_deg:.1f}".replace("nan", "–")) for slope in self.estimates)
        slopes = ", ".join(f"{region} {tilt}°" for region, tilt in tilts)
        return f"<Minute {start:%H:%M} UTC: {slopes or 'no slopes'}; {self.dni_w_m2:.0f} W/m² direct>"


class Estimator:
    """Collects samples into minute bins (`Binner`) and estimates slopes from these (`slopes`).

    `regions` may change: by a schedule given here, or by a `RegionRecord` added before the minute from which
    it holds.
    """

    def __init__(
        self,
        site: Site,
        regions: Regions,
        streams: Sequence[StreamInfo],
        settings: EstimatorSettings | None = None,
    ) -> None:
        self.site = site
        self.settings: EstimatorSettings = settings or EstimatorSettings()
        self._binner = Binner(site, regions, streams, self.settings)
        self.history: History = History.of([], len(self.schedule.columns))
        """All bins closed so far, of every outline in `schedule`."""
        self._last_minutes: list[Minute] = []
        self._packed_minutes: list[bytes] = []
        self._chain = SlopeChain(regions, self.settings)

    @property
    def schedule(self) -> RegionSchedule:
        """Every outline of the regions, with the minutes in which it holds."""
        return self._binner.schedule

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions that hold in the last minute closed, at first those that hold from the beginning."""
        return self.schedule.regions_at(int(self.history.minute[-1]) if len(self.history) else 0)

    @property
    def irradiance_model(self) -> str:
        """Source of DNI, in words: the stream and its conversion."""
        return self._binner.irradiance_model

    @property
    def minutes(self) -> list[Minute]:
        """All that were estimated so far."""
        hours = (pickle.loads(zlib.decompress(packed)) for packed in self._packed_minutes)
        return [*chain.from_iterable(hours), *self._last_minutes]

    def budgets(self) -> dict[str, tuple[BudgetTerm, ...]]:
        """The uncertainty budget of each target after the last minute; none from the weather alone."""
        return self._chain.budgets(self.history)

    def reference_checks(self) -> tuple[ReferenceCheck, ...]:
        """The slope of each reference by all others after the last minute; none with fewer than two."""
        return self._chain.reference_checks()

    def add(self, sample: Sample | Event | RegionRecord) -> list[Minute]:
        """Take one sample, mark or change of regions; returns the minutes it closed, usually none."""
        return [self.minute(closed) for closed in self.collect(sample)]

    def finish(self) -> list[Minute]:
        """Close the open minutes at the end of a recording."""
        return [self.minute(closed) for closed in self.collect_rest()]

    def collect(self, sample: Sample | Event | RegionRecord) -> list[Closed]:
        """Take one sample, mark or change of regions; returns the bins it closed, for `minute`.

        Takes microseconds; `minute` may take a second and more, and may run in another thread.
        """
        return self._binner.add(sample)

    def collect_rest(self) -> list[Closed]:
        """Close the open bins at the end of a recording."""
        return self._binner.finish()

    def minute(self, closed: Closed) -> Minute:
        """Slopes at the end of a bin; every bin is to be given once, in order."""
        self.history = self.history.plus(closed[0])
        self._chain.schedule = self.schedule
        estimated = self._chain.at(self.history)
        measured = measured_minute(closed, self.schedule, self.irradiance_model)
        minute = replace(measured, estimates=estimated.slopes, learnt=estimated.learnt)
        self._last_minutes.append(minute)
        if len(self._last_minutes) == PACKED_MINUTES:
            self._packed_minutes.append(zlib.compress(pickle.dumps(self._last_minutes)))
            self._last_minutes = []
        return minute


def measured_minute(closed: Closed, schedule: RegionSchedule, irradiance_model: str) -> Minute:
    """A minute without its slopes."""
    entry, events = closed
    zenith, azimuth = (float(angle) for angle in tilt_azimuth(entry.sun))
    columns, count = schedule.at(entry.minute), len(schedule.columns)
    names = [schedule.columns[column].name for column in columns]
    kelvin, spread = (pad(row, count)[columns].tolist() for row in (entry.temperature_k, entry.spread_k))
    return Minute(
        time_ns=entry.time_ns,
        estimates=(),
        temperature_k=dict(zip(names, kelvin, strict=True)),
        spread_k=dict(zip(names, spread, strict=True)),
        pixels=dict(zip(names, pad(entry.pixels, count, 0)[columns].tolist(), strict=True)),
        illuminance_lx=entry.illuminance_lx,
        dni_w_m2=entry.dni_w_m2,
        irradiance_model=irradiance_model,
        sun_zenith_deg=zenith,
        sun_azimuth_deg=azimuth,
        contact_k=entry.contact_k,
        flags=entry.flags,
        events=events,
        dhi_w_m2=entry.dhi_w_m2,
        longwave_down_w_m2=entry.longwave_down_w_m2,
    )
