"""The data of a report, gathered once; minutes side by side are the columns of its figures and tables.

Pure: minutes in, arrays over minutes out, NaN where nothing is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import (
    SdKind,
    mean_absolute_error,
    root_mean_square_error,
    sd_of_absolute_error,
)
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, EventKind, Frame, Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import (
    SOLVED,
    WITH_SLOPE,
    ReferenceCheck,
    SlopeEstimate,
    SlopeState,
    final_estimates,
)
from fieldkit.physics.energy_balance import (
    SurfaceParameters,
    direct_irradiance,
    emitted_longwave,
    surface_temperature,
)
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.views import formatting, plotting
from fieldkit.views.html import Figure, Reading

if TYPE_CHECKING:
    from pathlib import Path

    from fieldkit.calibration.calibration_record import CalibrationRecord
    from fieldkit.estimation.estimator import Minute
    from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True)
class TargetSeries:
    """Estimates of one target, one per minute."""

    region: Region
    estimates: tuple[SlopeEstimate | None, ...]

    def values(self, key: str, *, solved: bool = False) -> FloatArray:
        """A number of the estimates by minute (`SLOPE_FIELDS`), NaN where there is none.

        If `solved`, also where the slope was not worked out at that minute, such as one that is held.
        """
        minutes = [e if e and (e.state in SOLVED or not solved) else None for e in self.estimates]
        return np.array([np.nan if e is None else getattr(e, key) for e in minutes], np.float64)

    @cached_property
    def tilt_deg(self) -> FloatArray:
        """Tilt, also a held one."""
        return self.values("tilt_deg")

    @cached_property
    def estimated_tilt_deg(self) -> FloatArray:
        """Tilt where it was worked out at that minute."""
        return self.values("tilt_deg", solved=True)

    @property
    def mean_error_deg(self) -> float:
        """Mean absolute tilt error over the estimates; NaN if the tilt was not given."""
        return mean_absolute_error(self.estimated_tilt_deg, self.region.tilt_deg)

    def error_words(self, sd: SdKind) -> str:
        """The mean absolute tilt error and its scatter, degrees."""
        scatter = sd_of_absolute_error(self.estimated_tilt_deg, self.region.tilt_deg, sd)
        mean = self.mean_error_deg
        return f"{mean:.1f} ({scatter:.2f})" if np.isfinite(mean) else formatting.UNKNOWN

    @property
    def final_words(self) -> str:
        """The final tilt with its likelihood region."""
        return formatting.tilt(self.final_estimate) if self.final_estimate else formatting.UNKNOWN

    @property
    def wide(self) -> int:
        """Minutes whose region was too wide to rely on their slope."""
        return sum(estimate is not None and estimate.state is SlopeState.WIDE for estimate in self.estimates)

    @property
    def final_estimate(self) -> SlopeEstimate | None:
        """The slope that stands for the session, or None where none was found."""
        finals = final_estimates(filter(None, self.estimates), [self.region])
        return next((final for final in finals.values() if final.state in WITH_SLOPE), None)

    @property
    def last(self) -> SlopeEstimate | None:
        """The last estimate, with or without a slope."""
        return next((estimate for estimate in reversed(self.estimates) if estimate is not None), None)


@dataclass(frozen=True)
class Series:
    """Everything by minute, shape (n,) each; `sun` are East-North-Up unit vectors (n, 3)."""

    time_ns: IntArray
    illuminance_lx: FloatArray
    irradiance_w_m2: FloatArray
    diffuse_w_m2: FloatArray  # as measured, NaN where not
    longwave_w_m2: FloatArray  # downward, as measured, NaN where not
    irradiance_model: str
    sun: FloatArray
    flags: IntArray
    temperature_k: Mapping[str, FloatArray]
    contact_k: FloatArray  # (n, channels)
    targets: tuple[TargetSeries, ...]
    regions: tuple[Region, ...]
    learnt: tuple[Learnt | None, ...]  # what the data had taught by each minute, with the learned model

    @property
    def final_learnt(self) -> Learnt | None:
        """Parameters learnt from the whole session, or None if nothing."""
        return next((learnt for learnt in reversed(self.learnt) if learnt is not None), None)

    @property
    def cos_zenith(self) -> FloatArray:
        """Cosine of the sun's zenith angle."""
        return self.sun[:, 2]

    def of_day_ns(self, site: Site) -> IntArray:
        """Nanoseconds since midnight on the site's clocks."""
        return np.array([formatting.of_day_ns(time_ns, site) for time_ns in self.time_ns.tolist()], np.int64)

    @property
    def cloudy(self) -> BoolArray:
        """Minutes in which irradiance changed faster than the sun's motion explains."""
        return np.asarray((self.flags & int(Quality.CLOUD)) != 0)

    def direct_on(self, tilt_deg: float, azimuth_deg: float) -> FloatArray:
        """Direct irradiance on a facet by eq. (2), W/m2."""
        cosine = cos_incidence(normal(tilt_deg, azimuth_deg), self.sun)
        return direct_irradiance(self.irradiance_w_m2, cosine)

    @property
    def references(self) -> tuple[Region, ...]:
        """The regions of known slope against which the targets are compared."""
        return tuple(region for region in self.regions if region.kind is RegionKind.REFERENCE)

    @property
    def reference_k(self) -> FloatArray:
        """Mean surface temperature of the references."""
        if not self.references:
            return np.full(self.time_ns.size, np.nan)
        return np.asarray(np.mean([self.temperature_k[region.name] for region in self.references], axis=0))


def series(minutes: Sequence[Minute], regions: Sequence[Region]) -> Series:
    """Minutes as columns, in order of time."""
    ordered = sorted(minutes, key=lambda minute: minute.time_ns)

    def column(name: str) -> FloatArray:
        return np.array([getattr(minute, name) for minute in ordered], np.float64)

    channels = max((len(minute.contact_k) for minute in ordered), default=0)
    contact = np.full((len(ordered), channels), np.nan)
    for row, minute in enumerate(ordered):
        contact[row, : len(minute.contact_k)] = minute.contact_k
    return Series(
        time_ns=np.array([minute.time_ns for minute in ordered], np.int64),
        illuminance_lx=column("illuminance_lx"),
        irradiance_w_m2=column("dni_w_m2"),
        diffuse_w_m2=column("dhi_w_m2"),
        longwave_w_m2=column("longwave_down_w_m2"),
        irradiance_model=ordered[-1].irradiance_model if ordered else "",
        sun=normal(column("sun_zenith_deg"), column("sun_azimuth_deg")).reshape(-1, 3),
        flags=np.array([int(minute.flags) for minute in ordered], np.int64),
        temperature_k={
            region.name: np.array([m.temperature_k.get(region.name, np.nan) for m in ordered], np.float64)
            for region in regions
        },
        contact_k=contact,
        targets=tuple(_target(region, ordered) for region in regions if region.kind is RegionKind.TARGET),
        regions=tuple(regions),
        learnt=tuple(minute.learnt for minute in ordered),
    )


def _target(region: Region, minutes: Sequence[Minute]) -> TargetSeries:
    estimates = tuple(
        next((estimate for estimate in minute.estimates if estimate.region == region.name), None)
        for minute in minutes
    )
    return TargetSeries(region, estimates)


def temperature_rmse_k(measured_k: Mapping[str, FloatArray], modelled_k: Mapping[str, FloatArray]) -> float:
    """RMSE over all regions and minutes of measured against modelled surface temperature, kelvin."""
    if not modelled_k:
        return float("nan")
    temperature_k = np.concatenate([measured_k[name] for name in modelled_k])
    return root_mean_square_error(temperature_k, np.concatenate(list(modelled_k.values())))


def modelled_temperature(columns: Series, target: TargetSeries, parameters: SurfaceParameters) -> FloatArray:
    """Surface temperature (n,) of a target of known slope by eq. (7) of the paper, kelvin.

    Air temperature and the sky's longwave are not measured. Both enter eq. (7) alike for all targets, so the
    reference stands in for them: at every minute the air temperature is the one that balances the reference
    at its measured temperature. NaN if the slope is unknown or there is no reference.
    """
    if not np.isfinite([target.region.tilt_deg, target.region.azimuth_deg]).all():
        return np.full(columns.time_ns.size, np.nan)
    direct = columns.direct_on(target.region.tilt_deg, target.region.azimuth_deg)
    return surface_temperature(direct, 0.0, _air_of_reference(columns, parameters), parameters)


def _air_of_reference(columns: Series, parameters: SurfaceParameters) -> FloatArray:
    """Air temperature that balances the references by eq. (7) without longwave, kelvin, their mean."""
    air_k = []
    for region in columns.references:
        surface_k = columns.temperature_k[region.name]
        azimuth = region.azimuth_deg if np.isfinite(region.azimuth_deg) else 0.0
        direct = columns.direct_on(region.tilt_deg, azimuth)
        emitted = emitted_longwave(surface_k, parameters.emissivity_broadband)
        lost = emitted - (1.0 - parameters.albedo) * direct
        air_k.append(surface_k + lost / parameters.exchange_w_m2_k)
    return np.asarray(np.mean(air_k, axis=0)) if air_k else np.full(columns.time_ns.size, np.nan)


# --- figures over time, with their values minute by minute for who points at them


MOST = 200
"""Readings of a figure: three hours minute by minute; longer sessions show every second minute, or third."""


def figure_over_time(
    data: ReportData, drawn: plotting.OverTime, caption: str, alt: str,
    values: Callable[[int], Iterable[str]], *, wide: bool = True, parts: Sequence[str] = (),
) -> Figure:  # fmt: skip
    """A figure with its readings; `values` gives the lines of words for a minute's index."""
    time_ns = data.columns.time_ns
    step = math.ceil(time_ns.size / MOST)
    middle = 100.0 * drawn.share_of_width[::step]
    width = float(np.min(np.diff(middle), initial=2.0))
    readings = [
        Reading(
            round(left - width / 2, 2),
            round(width, 2),
            "\n".join([data.clock_time(int(time_ns[minute])), *values(minute)]),
        )
        for left, minute in zip(middle.tolist(), range(0, time_ns.size, step), strict=True)
    ]
    return Figure(drawn.svg, caption, alt, wide, readings, parts)


# --- the data of a report, gathered once


@dataclass(frozen=True)
class ReportData:
    """A session, its minutes, and the settings they were estimated with.

    `minutes` are the estimator's by `settings`, or the recording's own (`is_recordings`). `site`, `regions`
    and `config_toml` are those of the estimator, as an imported session has none of its own. `by_others` are
    the final slopes by the other models, `budgets` the uncertainty budget of
    each slope by region, with the learned model, `checks` the references as all others show them; `frame` is
    the one to show, `command_line` what was typed.
    `sd` is the standard deviation of the absolute errors: eq. (9) as printed, or the usual one;
    `calibrations` were found from the session, with their files; `active` are those that its slopes use, by
    key, `cautions` what speaks against using them.
    """

    session: SessionReader
    minutes: Sequence[Minute]
    settings: EstimatorSettings
    site: Site
    regions: tuple[Region, ...]
    config_toml: str
    sd: SdKind = "paper"
    frame: Frame | None = None
    by_others: Mapping[Model, Sequence[SlopeEstimate]] = field(default_factory=dict)
    command_line: str = ""
    is_recordings: bool = False
    budgets: Mapping[str, tuple[BudgetTerm, ...]] = field(default_factory=dict)
    checks: tuple[ReferenceCheck, ...] = ()
    calibrations: Sequence[tuple[CalibrationRecord, Path]] = ()
    active: Mapping[str, CalibrationRecord] = field(default_factory=dict)
    cautions: Sequence[str] = ()

    @cached_property
    def columns(self) -> Series:
        """The minutes side by side."""
        return series(self.minutes, self.regions)

    @cached_property
    def events(self) -> Sequence[Event]:
        """The events of the session, in order of time."""
        return formatting.by_time(self.session.events())

    def events_of(self, *kinds: EventKind) -> list[Event]:
        """Events of some kinds, in order."""
        return [event for event in self.events if event.kind in kinds]

    def clock_time(self, time_ns: int, *, seconds: bool = False) -> str:
        """A time of day at the site, with its date after the first day."""
        return formatting.clock_time(time_ns, self.site, seconds=seconds, since_ns=self.session.start_ns)

    def draw(self, draw: Callable[[ReportData], Iterator[Figure]]) -> list[Figure] | None:
        """The figures that `draw` yields; None without matplotlib."""
        return list(draw(self)) if plotting.available() else None

    @property
    def zone(self) -> str:
        """The time zone of the session with its offset; two where the clocks change in it."""
        return formatting.zone_name(self.session.start_ns, self.site, self.session.end_ns)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the contact probes of all thermometers, in their order."""
        meters = [info for info in self.session.streams.values() if info.quantity == "temperature"]
        return tuple(
            info.channels[i] if i < len(info.channels) else str(i + 1)
            for info in meters
            for i in range(info.shape[0])
        )
