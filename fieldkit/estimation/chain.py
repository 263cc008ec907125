"""Slopes minute after minute: what live view, replay and batch ask, whatever the model.

The models of the paper and `full` are functions of the bins alone. The learned model is a chain of minutes:
each is taken once, in order, with the shade known at that minute, so that asking late or often gives the
same slopes. A session's first minutes are repeated where a shade test is recognised or dismissed afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.learned.inputs import (
    BRIDGED_MINUTES,
    MinuteInputs,
    bridge,
    can_start,
    logged,
    minute_inputs,
    shade,
)
from fieldkit.estimation.learned.layout import Indices, Layout
from fieldkit.estimation.learned.learner import Learner
from fieldkit.estimation.learned.readout import KnownSlope, Moments, known_slope, learnt_parameters, moments
from fieldkit.estimation.methods import kelvin_per_degree
from fieldkit.estimation.region_temperatures import remove_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, SlopeState, is_too_wide
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.facet import FloatArray, tilt_azimuth

TOGETHER = 4
"""Targets that learn together with the references; more share no more, and the cost grows with the square."""
KNOWN_BED_SD_DEG = 0.2
AIR_LOGGED_SD_K = 0.5
LONGWAVE_MEASURED_SD_W_M2 = 10.0
DEPTH_MEASURED_SD = 0.1
FAILED = "the estimate failed numerically; it starts anew with the next minute"


@dataclass(frozen=True, slots=True)
class Estimated:
    """Slopes of all targets at one minute, and what was learnt by then (with the learned model)."""

    slopes: tuple[SlopeEstimate, ...]
    learnt: Learnt | None = None


def slope_series(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[Estimated]:
    """Slopes at every minute of a history."""
    chain = SlopeChain(regions, settings)
    for last in range(1, len(history) + 1):
        yield chain.at(history.until(last))


class SlopeChain:
    """Slopes of the targets of some regions at the last minute of a history that grows."""

    def __init__(self, regions: Sequence[Region], settings: EstimatorSettings) -> None:
        self._regions, self._settings = tuple(regions), settings
        columns = RegionColumns(self._regions)
        groups = -(-columns.targets.size // TOGETHER)
        parts = np.array_split(columns.targets, groups) if groups and columns.references.size else []
        self._groups = [_Group(columns, part, settings) for part in parts]

    def at(self, history: History) -> Estimated:
        """Slopes at the last minute; the history must begin with the minutes given before."""
        if self._settings.model != "learned":
            return Estimated(slopes(history, self._regions, self._settings))
        history = remove_offsets(history, self._regions, self._settings)
        for group in self._groups:
            group.take(history)
        if not self._groups:
            return Estimated(slopes(history, self._regions, replace(self._settings, model="full")))
        found = tuple(estimate for group in self._groups for estimate in group.estimates(history))
        return Estimated(found, self._groups[0].learnt() if len(history) else None)


class _Group:
    """References and a few targets that learn together."""

    def __init__(self, columns: RegionColumns, targets: Indices, settings: EstimatorSettings) -> None:
        self._columns, self._targets, self._settings = columns, targets, settings
        self._layout = Layout.of(columns, targets, settings.azimuth == "known")
        self._learner: Learner | None = None
        self._found: list[KnownSlope] = []
        self._moments = Moments((), np.empty(0), np.empty((0, 0)))
        self._taken = self._first = 0
        self._shade: NDArray[np.bool_] = np.zeros((0, 2, 0), np.bool_)
        self._has_failed = False

    def take(self, history: History) -> None:
        """Take the minutes not taken yet, each with the shade as known then."""
        for last in range(self._taken + 1, len(history) + 1):
            try:
                self._take_last(history.until(last))
                self._has_failed = False
            except np.linalg.LinAlgError:  # recording and other regions go on
                self._learner, self._has_failed = None, True
            self._taken = last

    def _take_last(self, history: History) -> None:
        row = len(history) - 1
        learner = self._learner
        if learner is not None and history.minute[row] - history.minute[row - 1] > BRIDGED_MINUTES:
            learner = self._learner = None
        if learner is None:
            self._start(history, row)
        else:
            if not np.array_equal(shade(history, self._layout)[self._first : -1], self._shade):
                learner.reshade(self._inputs(history, row))
            learner.add(self._input(history, row, learner.last))
        if self._learner is not None:
            self._shade = shade(history, self._layout)[self._first :]
            self._found = [known_slope(self._learner, index) for index in range(self._targets.size)]
            self._moments = moments(self._learner)

    def _start(self, history: History, row: int) -> None:
        if can_start(history, row, self._layout):
            self._first = row
            known = logged(history, row, self._layout, self._columns.regions, self._settings)
            self._learner = Learner(self._layout, self._settings, self._input(history, row, None), known)

    def _input(self, history: History, row: int, before: MinuteInputs | None) -> MinuteInputs:
        start = int(history.minute[self._first])
        return minute_inputs(history, row, self._layout, self._settings, before, start)

    def _inputs(self, history: History, end: int) -> list[MinuteInputs]:
        """All minutes of this chain before a row anew."""
        made = [self._input(history, self._first, None)]
        for row in range(self._first + 1, end):
            later = self._input(history, row, made[-1])
            made.extend((*bridge(made[-1], later), later))
        return made

    def estimates(self, history: History) -> list[SlopeEstimate]:
        """Slope of each target at the last minute taken."""
        return [self._estimate(history, index) for index in range(self._targets.size)]

    def _estimate(self, history: History, index: int) -> SlopeEstimate:
        region = self._columns.regions[self._targets[index]]
        blank = SlopeEstimate(0, region.name, SlopeState.NO_DATA, model=_label(self._settings))
        if not len(history):
            return replace(blank, reason="no minutes yet")
        column = self._targets[index]
        blank = replace(
            blank,
            time_ns=int(history.time_ns[-1]),
            window_start_ns=int(history.time_ns[self._first]),
            flags=Quality(int(history.flags[-1] | history.region_flags[-1, column])),
        )
        if self._learner is None:
            reason = FAILED if self._has_failed else _missing(history, self._layout, region)
            return replace(blank, reason=reason)
        used = int(np.isfinite(history.temperature_k[self._first :, column]).sum())
        if used < self._settings.min_minutes:
            reason = f"{used} of {self._settings.min_minutes} minutes so far"
            return replace(blank, state=SlopeState.TOO_FEW, reason=reason, n_bins=used)
        return self._filled(replace(blank, n_bins=used), self._learner, index)

    def _filled(self, blank: SlopeEstimate, learner: Learner, index: int) -> SlopeEstimate:
        found = self._found[index]
        region = self._columns.regions[self._targets[index]]
        tilt, azimuth = (float(angle) for angle in tilt_azimuth(found.best))
        if self._layout.facing[index].shape[1] == 2:
            tilt, azimuth = _signed(tilt, azimuth, region.azimuth_deg)
        filled = replace(
            blank,
            tilt_deg=tilt,
            azimuth_deg=azimuth,
            tilt_low_deg=min(found.region.tilt_low_deg, tilt),
            tilt_high_deg=max(found.region.tilt_high_deg, tilt),
            azimuth_low_deg=found.region.azimuth_low_deg,
            azimuth_high_deg=found.region.azimuth_high_deg,
            chi_square=_chi_square(learner, self._layout.references + index),
            kelvin_per_degree=_kelvin_per_degree(learner, tilt, azimuth),
        )
        return self._judged(filled, found, index)

    def _judged(self, filled: SlopeEstimate, found: KnownSlope, index: int) -> SlopeEstimate:
        """The estimate with its state, and what would help where it is not certain."""
        if found.second is not None:
            tilt, azimuth = (float(angle) for angle in tilt_azimuth(found.second))
            return replace(
                filled,
                state=SlopeState.NOT_RESOLVED,
                second_tilt_deg=tilt,
                second_azimuth_deg=azimuth,
                flags=filled.flags | Quality.UNRESOLVED,
                reason=f"tilt {tilt:.1f}°, azimuth {azimuth:.0f}° fits as well ({1.0 - found.share:.0%})",
            )
        limit = self._settings.tilt_limit_deg
        if filled.tilt_deg > limit:
            return replace(
                filled, state=SlopeState.NO_INTERSECTION, reason=f"no tilt up to {limit:.0f}° fits"
            )
        low, high = filled.tilt_low_deg, filled.tilt_high_deg
        if high >= limit:
            reason = f"anything from {low:.1f}° up to the limit of {limit:g}° fits (90 %)"
            return replace(filled, state=SlopeState.UNCERTAIN, reason=reason)
        if is_too_wide(filled.tilt_deg, low, high):
            reason = f"anything from {low:.1f}° to {high:.1f}° fits (90 %); {self._advice(index)}"
            return replace(filled, state=SlopeState.UNCERTAIN, reason=reason)
        if found.region.vertical:
            return replace(filled, state=SlopeState.FLAT, reason=f"flat within {high:.1f}°")
        return replace(filled, state=SlopeState.OK)

    def _advice(self, index: int) -> str:
        """What would narrow a tilt most."""
        found, name = self._moments, f"tilt{index}"
        sd = found.sd(name)
        offers = {
            "an air temperature logged in the shade": found.sd_if_known(name, "air", AIR_LOGGED_SD_K),
            "a pyrgeometer": found.sd_if_known(name, "longwave", LONGWAVE_MEASURED_SD_W_M2),
            "the depth of the sand": found.sd_if_known(name, "depth", DEPTH_MEASURED_SD),
        }
        for other in range(self._targets.size):
            if other != index:
                known = found.sd_if_known(name, f"tilt{other}", KNOWN_BED_SD_DEG)
                offers["one known bed"] = min(known, offers.get("one known bed", math.inf))
        best = min(offers, key=lambda offer: offers[offer])
        return f"{best}: ±{1.645 * sd:.1f} → ±{1.645 * offers[best]:.1f}°"

    def learnt(self) -> Learnt | None:
        """What was learnt by now; None before the first minute."""
        learner = self._learner
        if learner is None:
            return None
        names = [self._columns.regions[column].name for column in self._layout.columns]
        kelvin, standard = _errors(learner)
        return Learnt(
            learnt_parameters(learner, self._moments),
            dict(zip(names, _rms(kelvin).tolist(), strict=True)),
            dict(zip(names, _autocorrelation(standard).tolist(), strict=True)),
            float(np.nanmean(standard**2)) if np.isfinite(standard).any() else math.nan,
        )


def _errors(learner: Learner) -> tuple[FloatArray, FloatArray]:
    """Prediction errors (n, regions) under the heaviest hypothesis: kelvin, and standardised."""
    heaviest = int(np.argmax(learner.posterior.log_weights))
    kelvin = np.array([one.kelvin[heaviest] for one in learner.innovations])
    return kelvin, np.array([one.standardised[heaviest] for one in learner.innovations])


def _rms(values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    return np.asarray(np.sqrt(np.nansum(values**2, axis=0) / np.maximum(known.sum(axis=0), 1)))


def _autocorrelation(values: FloatArray) -> FloatArray:
    """Of columns from one row to the next; 0 with fewer than three rows."""
    if len(values) < 3:
        return np.zeros(values.shape[1])
    filled = np.nan_to_num(values)
    return np.asarray((filled[1:] * filled[:-1]).sum(axis=0) / np.maximum((filled**2).sum(axis=0), 1e-12))


def _chi_square(learner: Learner, region: int) -> float:
    standard = _errors(learner)[1][:, region]
    return float(np.nanmean(standard**2)) if np.isfinite(standard).any() else math.nan


def _kelvin_per_degree(learner: Learner, tilt_deg: float, azimuth_deg: float) -> float:
    """Change of a bed's temperature per degree of tilt in balance, NaN without sun."""
    minute, posterior = learner.last, learner.posterior
    weights = posterior.weights
    light = float(weights @ posterior.normals.gain) * minute.direct
    if light <= 0.0 or minute.sun[2] <= 0.0:
        return math.nan
    grey = learner.settings.surface.emissivity_broadband
    kelvin = float(minute.temperature_k.mean())
    loss = float(weights @ posterior.filters.hypotheses.exchange) + 4.0 * grey * STEFAN_BOLTZMANN * kelvin**3
    return kelvin_per_degree(tilt_deg, azimuth_deg, minute.sun, loss / light)


def _signed(tilt: float, azimuth: float, known: float) -> tuple[float, float]:
    """Tilt along a known azimuth: 0 where the best normal leans the other way."""
    leans_away = math.cos(math.radians(azimuth - known)) < 0.0
    return (0.0 if leans_away else tilt), known % 360.0


def _missing(history: History, layout: Layout, region: Region) -> str:
    """Why the chain has not begun."""
    if not np.isfinite(history.temperature_k[:, layout.columns[: layout.references]]).any():
        return "no frames of the reference yet"
    if not np.isfinite(history.temperature_k[:, layout.columns]).all(axis=1).any():
        return "no minute yet with frames of all regions"
    return "no irradiance yet"


def _label(settings: EstimatorSettings) -> str:
    return "learned, azimuth known" if settings.azimuth == "known" else "learned"
