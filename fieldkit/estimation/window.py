"""The minutes an estimate looks back on, and the slope of one region from them.

"Since the last change of weather" reaches back as far as one slope explains the minutes: a
cloud that passed weighs next to nothing and ends no window, while a sky, wind or drift that
changed things for good shows as a misfit, and the window is halved until it fits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation import quality
from fieldkit.estimation.answers import WORKED_OUT
from fieldkit.estimation.balance import Rows, rows
from fieldkit.estimation.band_emissivity import moved_temperatures
from fieldkit.estimation.bins import History
from fieldkit.estimation.drift import RECENT_MINUTES, drifts_k
from fieldkit.estimation.methods import Solution, solution
from fieldkit.estimation.offsets import without_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth

DOUBTFUL_WEIGHT = 0.01
"""Weight of a clouded minute in the paper's model, which knows no stored heat, and of a shaded one: kept, but
hardly heard."""
SHORTEST_MINUTES = 20
"""A window is not halved below the paper's own."""


@dataclass(frozen=True, slots=True)
class Field:
    """The regions of a picture as the estimator sees them: which columns are references, which targets."""

    regions: tuple[Region, ...]

    @property
    def references(self) -> NDArray[np.int64]:
        """Columns of the references."""
        return self._columns(RegionKind.REFERENCE)

    @property
    def targets(self) -> NDArray[np.int64]:
        """Columns of the targets."""
        return self._columns(RegionKind.TARGET)

    @property
    def reference_normals(self) -> FloatArray:
        """Unit normals of the references; one without a tilt is flat."""
        beds = [self.regions[column] for column in self.references]
        tilts = [0.0 if math.isnan(bed.tilt_deg) else bed.tilt_deg for bed in beds]
        azimuths = [0.0 if math.isnan(bed.azimuth_deg) else bed.azimuth_deg for bed in beds]
        return normal(tilts, azimuths).reshape(-1, 3)

    def _columns(self, kind: RegionKind) -> NDArray[np.int64]:
        return np.array([i for i, region in enumerate(self.regions) if region.kind == kind], np.int64)


class Window:
    """The minutes an estimate looks back on, ending before index `last` of the history."""

    def __init__(
        self,
        history: History,
        last: int,
        field: Field,
        settings: EstimatorSettings,
        minutes: float | None = None,
    ) -> None:
        self.field, self.settings, self.past = field, settings, history.until(last)
        self.first = _first(self.past, settings, minutes)
        self.rows: Rows | None = None
        if last and field.references.size and field.targets.size:
            true = without_offsets(self.past, field.regions, settings)
            beds = field.references, field.targets, field.reference_normals
            moved = moved_temperatures(true.temperature_k, field.regions, settings)
            self.rows = rows(true, self.first, *beds, settings, moved)

    def estimate(self, index: int) -> SlopeEstimate:
        """Slope of the target `index`."""
        region = self.field.regions[self.field.targets[index]]
        blank = SlopeEstimate(0, region.name, SlopeState.NO_DATA, model=_label(self.settings))
        if self.rows is None:
            return replace(
                blank, reason="no minutes yet" if self.field.references.size else "no reference region"
            )
        column = self.field.targets[index]
        flags = Quality(int(self.past.flags[-1] | self.past.region_flags[-1, column]))
        blank = replace(
            blank,
            time_ns=int(self.past.time_ns[-1]),
            window_start_ns=int(self.past.time_ns[self.first]),
            flags=flags,
        )
        used = self._used(self.rows, index)
        if (trouble := self._trouble(column, used)) is not None:
            state, reason = trouble
            low = Quality.LOW_SUN if state == SlopeState.LOW_SUN else Quality.GOOD
            return replace(blank, state=state, reason=reason, flags=flags | low, n_bins=int(used.sum()))
        weights = self._weights(self.rows, index, used)
        answer = solution(self.rows, index, weights, region, self.settings)
        if not answer.explained and self.shorter is not None:
            later = self.shorter.estimate(index)
            if later.state not in (SlopeState.TOO_FEW, SlopeState.NO_DATA):
                return later
        return _filled(blank, answer, self.rows, index, self._known_azimuth(column))

    @cached_property
    def shorter(self) -> Window | None:
        """The later half of a window whose length is the weather's; None where it is short enough."""
        minutes = int(self.past.minute[-1] - self.past.minute[self.first])
        if self.settings.window_s is not None or minutes <= SHORTEST_MINUTES:
            return None
        half = max(minutes / 2.0, SHORTEST_MINUTES)
        return Window(self.past, len(self.past), self.field, self.settings, half)

    def told_of_drift(self, answers: list[SlopeEstimate]) -> list[SlopeEstimate]:
        """The answers, with `NO_INTERSECTION` and the reason where one region alone left its prediction.

        Only where the minutes contradict each other, and not soon after a cloud.
        """
        minute = self.past.minute
        lately = minute[-1:] - minute < 2 * RECENT_MINUTES
        if self.rows is None or not len(minute) or (self.past.flags[lately] & Quality.CLOUD).any():
            return answers
        start = self.past.time_ns[self.first]
        if all(
            one.state is not SlopeState.NO_INTERSECTION and one.window_start_ns <= start for one in answers
        ):
            return answers
        weights = [self._weights(self.rows, i, self._used(self.rows, i)) for i in range(len(answers))]
        limit = self.settings.tilt_limit_deg
        drifts = drifts_k(self.rows, np.column_stack(weights), minute[self.first :], limit)
        return [_drifting(one, float(kelvin)) for one, kelvin in zip(answers, drifts, strict=True)]

    def _used(self, rows: Rows, index: int) -> NDArray[np.bool_]:
        y, sigma = rows.y[:, index], rows.sigma[:, index]
        return np.asarray(np.isfinite(y) & self._high_sun() & quality.sunlit(y, sigma))

    def _high_sun(self) -> NDArray[np.bool_]:
        low = np.sin(np.radians(self.settings.low_sun_deg))
        return np.asarray(self.past.sun[self.first :, 2] >= low)

    def _weights(self, rows: Rows, index: int, used: NDArray[np.bool_]) -> FloatArray:
        weights = np.where(used, 1.0 / np.where(used, rows.sigma[:, index], 1.0) ** 2, 0.0)
        doubtful = (self.past.region_flags[self.first :, self.field.targets[index]] & Quality.SHADED) != 0
        if self.settings.model == "paper":
            doubtful |= (self.past.flags[self.first :] & Quality.CLOUD) != 0
        return np.where(doubtful, DOUBTFUL_WEIGHT * weights, weights)

    def _trouble(self, column: np.int64, used: NDArray[np.bool_]) -> tuple[SlopeState, str] | None:
        """Why no slope can be worked out at all."""
        window = self.past.since(self.first)
        if not self._high_sun()[-1]:
            elevation = math.degrees(math.asin(window.sun[-1, 2]))
            return (
                SlopeState.LOW_SUN,
                f"the sun stands at {elevation:.1f}°, below {self.settings.low_sun_deg:g}°",
            )
        for what, values in (
            ("no pictures of this region", window.temperature_k[:, column]),
            ("no pictures of the reference", window.temperature_k[:, self.field.references]),
            ("no irradiance", window.direct_w_m2),
        ):
            if not np.isfinite(values).any():
                return SlopeState.NO_DATA, f"{what} in the window"
        needed = max(self._fewest(column), self.settings.min_minutes)
        if used.sum() < needed:
            return SlopeState.TOO_FEW, f"{used.sum()} of {needed} minutes so far"
        if self.past.region_flags[-1, column] & Quality.SHADED:
            return SlopeState.SHADED, "this region alone lost its sun"
        return None

    def _fewest(self, column: np.int64) -> int:
        """One minute more than there are angles to find, so that minutes can disagree."""
        return 3 if math.isnan(self._known_azimuth(column)) else 2

    def _known_azimuth(self, column: np.int64) -> float:
        """Azimuth of a region that need not be found, in degrees [0, 360); NaN where it must."""
        is_known = self.settings.azimuth == "known"
        return self.field.regions[column].azimuth_deg % 360.0 if is_known else math.nan


def _drifting(answer: SlopeEstimate, kelvin: float) -> SlopeEstimate:
    if not kelvin or answer.state not in (*WORKED_OUT, SlopeState.NO_INTERSECTION):
        return answer
    reason = f"this region alone left its own prediction by {kelvin:+.1f} K in {RECENT_MINUTES} min: a drift"
    return replace(answer, state=SlopeState.NO_INTERSECTION, reason=reason)


def _first(past: History, settings: EstimatorSettings, minutes: float | None) -> int:
    """Index of the first minute of the window that ends with the last one; 0 if nothing bounds it."""
    if settings.window_s is not None:
        minutes = settings.window_s / 60.0
    if minutes is None or not len(past):
        return 0
    return int(np.searchsorted(past.minute, past.minute[-1] - minutes))


def _label(settings: EstimatorSettings) -> str:
    known = ", azimuth known" if settings.azimuth == "known" else ""
    return f"{settings.model}, {settings.method}{known}"


def _angles(found: FloatArray, known_azimuth: float) -> tuple[float, float]:
    """Tilt and azimuth of a normal, degrees; a known azimuth holds for a vertical normal too."""
    tilt, azimuth = (float(angle) for angle in tilt_azimuth(found))
    return tilt, azimuth if math.isnan(known_azimuth) else known_azimuth


def _filled(blank: SlopeEstimate, answer: Solution, rows: Rows, index: int, known: float) -> SlopeEstimate:
    """The estimate with the solution's numbers in it; `known` is the azimuth not searched, or NaN."""
    filled = replace(
        blank,
        state=answer.state,
        reason=answer.reason,
        n_bins=answer.used,
        chi_square=answer.chi_square,
        flags=blank.flags | (Quality.UNRESOLVED if answer.second is not None else Quality.GOOD),
    )
    if answer.best is None:
        return filled
    tilt, azimuth = _angles(answer.best, known)
    seen = np.flatnonzero(np.isfinite(rows.per_kelvin[:, index]))  # the last minute may have no picture
    last = seen[-1] if seen.size else -1
    lamp, per_kelvin = rows.lamps[last], float(rows.per_kelvin[last, index])
    if answer.second is not None:
        second_tilt, second_azimuth = _angles(answer.second, known)
        filled = replace(filled, second_tilt_deg=second_tilt, second_azimuth_deg=second_azimuth)
    whole, noise = answer.whole, answer.noise
    return replace(
        filled,
        tilt_deg=tilt,
        azimuth_deg=azimuth,
        tilt_low_deg=whole.tilt_low_deg,
        tilt_high_deg=whole.tilt_high_deg,
        azimuth_low_deg=whole.azimuth_low_deg,
        azimuth_high_deg=whole.azimuth_high_deg,
        kelvin_per_degree=quality.kelvin_per_degree(tilt, azimuth, lamp, per_kelvin),
        noise_tilt_low_deg=noise.tilt_low_deg,
        noise_tilt_high_deg=noise.tilt_high_deg,
        noise_azimuth_low_deg=noise.azimuth_low_deg,
        noise_azimuth_high_deg=noise.azimuth_high_deg,
    )
