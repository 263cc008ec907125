"""From the bins of a session to the slopes at its last minute: one pure function for live and batch.

`slopes` looks back over the settings' window, turns minutes into rows (`balance`), solves
them by the method asked for, and says how far the answer may be trusted. During a cloud
or a shadow it answers with what was known just before, so an estimate is held, not reset.

"Since the last change of weather" reaches back as far as one slope explains the minutes: a
cloud that passed weighs next to nothing and ends no window, while a sky, wind or drift that
changed things for good shows as a misfit, and the window is halved until it fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation import quality
from fieldkit.estimation.answers import WORKED_OUT
from fieldkit.estimation.balance import Rows, rows
from fieldkit.estimation.bins import History
from fieldkit.estimation.methods import Solution, solution
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth
from fieldkit.samples import Quality
from fieldkit.site import Region, RegionKind
from fieldkit.slope import SlopeEstimate, SlopeState

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


def slopes(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    """Slope of every target at the last minute of the history, in the order of the regions."""
    field = Field(tuple(regions))
    clouded = (history.flags & Quality.CLOUD) != 0
    last = len(history)
    if settings.model == "paper" and last and clouded[-1]:
        return _held(history, field, ~clouded, settings)
    window = _Window(history, last, field, settings)
    answers = [window.estimate(index) for index in range(field.targets.size)]
    return tuple(
        _shaded(history, field, index, settings) if answer.flags & Quality.SHADED else answer
        for index, answer in enumerate(answers)
    )


def _held(
    history: History, field: Field, clear: NDArray[np.bool_], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    last = int(np.flatnonzero(clear)[-1]) + 1 if clear.any() else 0
    window = _Window(history, last, field, settings)
    now, flags = int(history.time_ns[-1]), Quality(int(history.flags[-1]))
    ago = (now - history.time_ns[last - 1]) / 60e9 if last else 0.0
    held = []
    for index in range(field.targets.size):
        answer = window.estimate(index)
        answer = replace(answer, time_ns=now, flags=answer.flags | flags)
        if answer.state in WORKED_OUT:
            reason = f"the light is unsteady; estimate of {ago:.0f} min ago"
            answer = replace(answer, state=SlopeState.HELD_CLOUD, reason=reason)
        held.append(answer)
    return tuple(held)


def _shaded(history: History, field: Field, index: int, settings: EstimatorSettings) -> SlopeEstimate:
    """The last estimate before this region alone lost its sun."""
    column = field.targets[index]
    lit = (history.region_flags[:, column] & Quality.SHADED) == 0
    last = int(np.flatnonzero(lit)[-1]) + 1 if lit.any() else 0
    held = _Window(history, last, field, settings).estimate(index)
    return replace(
        held,
        time_ns=int(history.time_ns[-1]),
        state=SlopeState.SHADED,
        flags=held.flags | Quality.SHADED,
        reason="this region alone lost its sun",
    )


class _Window:
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
            offsets = np.array([settings.offsets_k.get(field.regions[c].name, 0.0) for c in field.targets])
            self.rows = rows(
                self.past,
                self.first,
                field.references,
                field.targets,
                field.reference_normals,
                offsets,
                settings,
            )

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
        y, sigma = self.rows.y[:, index], self.rows.sigma[:, index]
        used = np.isfinite(y) & self._high_sun() & quality.sunlit(y, sigma)
        if (trouble := self._trouble(column, used)) is not None:
            state, reason = trouble
            low = Quality.LOW_SUN if state == SlopeState.LOW_SUN else Quality.GOOD
            return replace(blank, state=state, reason=reason, flags=flags | low, n_bins=int(used.sum()))
        answer = solution(self.rows, index, self._weights(column, used, sigma), region, self.settings)
        if not answer.explained and self.shorter is not None:
            later = self.shorter.estimate(index)
            if later.state not in (SlopeState.TOO_FEW, SlopeState.NO_DATA):
                return later
        return _filled(blank, answer, self.rows, index)

    @cached_property
    def shorter(self) -> _Window | None:
        """The later half of a window whose length is the weather's; None where it is short enough."""
        minutes = int(self.past.minute[-1] - self.past.minute[self.first])
        if self.settings.window_s is not None or minutes <= SHORTEST_MINUTES:
            return None
        half = max(minutes / 2.0, SHORTEST_MINUTES)
        return _Window(self.past, len(self.past), self.field, self.settings, half)

    def _high_sun(self) -> NDArray[np.bool_]:
        low = np.sin(np.radians(self.settings.low_sun_deg))
        return np.asarray(self.past.sun[self.first :, 2] >= low)

    def _weights(self, column: np.int64, used: NDArray[np.bool_], sigma: FloatArray) -> FloatArray:
        weights = np.where(used, 1.0 / np.where(used, sigma, 1.0) ** 2, 0.0)
        doubtful = (self.past.region_flags[self.first :, column] & Quality.SHADED) != 0
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
        is_known = self.settings.azimuth == "known" and math.isfinite(self.field.regions[column].azimuth_deg)
        return 2 if is_known else 3


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


def _filled(blank: SlopeEstimate, answer: Solution, rows: Rows, index: int) -> SlopeEstimate:
    """The estimate with the solution's numbers in it."""
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
    tilt, azimuth = (float(angle) for angle in tilt_azimuth(answer.best))
    seen = np.flatnonzero(np.isfinite(rows.per_kelvin[:, index]))  # the last minute may have no picture
    last = seen[-1] if seen.size else -1
    lamp, per_kelvin = rows.lamps[last], float(rows.per_kelvin[last, index])
    if answer.second is not None:
        second_tilt, second_azimuth = (float(angle) for angle in tilt_azimuth(answer.second))
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
        kelvin_per_degree=quality.kelvin_per_degree(answer.best, lamp, per_kelvin),
        noise_tilt_low_deg=noise.tilt_low_deg,
        noise_tilt_high_deg=noise.tilt_high_deg,
        noise_azimuth_low_deg=noise.azimuth_low_deg,
        noise_azimuth_high_deg=noise.azimuth_high_deg,
    )
