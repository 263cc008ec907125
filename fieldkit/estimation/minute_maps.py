"""Slope maps from mean frames of minutes: pixel by pixel the model, the noise and the references of regions.

With the learned model a pixel is one more target, of which the regions have taught all but the slope
(`learned.pixels`); paper and full solve the rows that regions have, with one exchange for all minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.balance import absorbed_light, conduction, smoothed_kernel
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.instant import AlongSun
from fieldkit.estimation.learned.pixels import pixel_rows
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, PixelBounds, SlopeMap, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray, SingleArray
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL

BEFORE_MINUTES = 120
"""Minutes before the first of a map whose warmth the sand remembers."""
SurfaceK = Callable[[int], FloatArray]
"""Surface temperatures of a frame by its minute since 1970, shape (rows, cols). [K]"""
Mapped = tuple[SlopeMap, PixelBounds, PixelPosterior, AlongSun | None]


@dataclass(frozen=True)
class MinuteMap:
    """A map of some minutes of a session, of a frame of `shape` (rows, cols).

    `history` are minute bins, whose columns are the `regions`; `chosen` are rows of the minutes that the map
    is made of: at least three, or one for the component along the sun. `settings` are as of the regions,
    `normals` unit normals of the targets that have a slope, by name. `learnt` is what the session taught the
    learned model; without it pixels are solved by the model full.
    """

    history: History
    regions: tuple[Region, ...]
    chosen: IntArray
    shape: tuple[int, int]
    settings: EstimatorSettings
    normals: Mapping[str, FloatArray]
    learnt: Learnt | None = None

    def solve(self, surface_k: SurfaceK) -> Mapped:
        """Slopes of every pixel, bounds, likelihood, and of one minute the component along the sun."""
        settings = self.settings
        limits = (settings.tilt_limit_deg, settings.confidence)
        sums = MapSums(self.shape, settings.surface, settings.noise_k, *limits)
        if settings.model == "paper":
            self._add_paper(sums, surface_k)
        elif settings.model == "learned" and self.learnt is not None and self._alike:
            settings = self._add_learned(sums, surface_k, self.learnt)
        else:
            self._add_full(sums, surface_k)
        slopes = sums.solve(self._explained_pixels)
        likelihood = posterior(slopes, sums, self._reference_normal, settings)
        along_sun = sums.along_sun(self._reference_normal, settings) if self.chosen.size == 1 else None
        return *with_bounds(slopes, likelihood, settings), likelihood, along_sun

    @property
    def _explained_pixels(self) -> BoolArray:
        """Pixels of the references, and of the targets that have a slope."""
        explained = np.zeros(self.shape, np.bool_)
        for region in self.regions:
            if region.kind is RegionKind.REFERENCE or region.name in self.normals:
                explained |= region.mask(self.shape)
        return explained

    @property
    def _columns(self) -> RegionColumns:
        return RegionColumns(self.regions)

    @property
    def _measured_references(self) -> BoolArray:
        """References with any temperature, as for regions: the others are averaged."""
        table = self.history.temperature_k[np.ix_(self.chosen, self._columns.references)]
        return np.asarray(np.isfinite(table).any(axis=0))

    @property
    def _alike(self) -> list[int]:
        """Columns of targets with any temperature whose surface is that of the references, as pixels' is."""
        kelvin = self.history.temperature_k[self.rows]
        return [
            column
            for column in self._columns.targets.tolist()
            if self.regions[column].name not in self.settings.kinds and np.isfinite(kelvin[:, column]).any()
        ]

    @property
    def _reference_k(self) -> FloatArray:
        columns = self._columns.references[self._measured_references]
        return np.asarray(self.history.temperature_k[:, columns].mean(axis=1))

    @property
    def _reference_normal(self) -> FloatArray:
        return np.asarray(self._columns.reference_normals[self._measured_references].mean(axis=0))

    def _add_paper(self, sums: MapSums, surface_k: SurfaceK) -> None:
        history, reference_k = self.history, self._reference_k
        for row in self.rows.tolist():
            dni_w_m2 = history.dni_w_m2[row] * self.settings.scale
            kelvin = surface_k(int(history.minute[row]))
            sums.add(kelvin, reference_k[row], history.sun[row], dni_w_m2, self._reference_normal)

    @property
    def rows(self) -> IntArray:
        """Rows of the minutes whose frames are needed: those with a reference, and for heat those before."""
        minute, is_known = self.history.minute, np.isfinite(self._reference_k)
        if self.settings.model == "paper" or self.chosen.size == 1:
            return self.chosen[is_known[self.chosen]]
        first, last = minute[self.chosen[[0, -1]]]
        return np.flatnonzero((minute >= first - BEFORE_MINUTES) & (minute <= last) & is_known)

    def _over_k(self, surface_k: SurfaceK) -> SingleArray:
        """Temperatures of all pixels over the reference (rows, pixels)."""
        minute, base_k = self.history.minute, self._reference_k
        return np.array(
            [(surface_k(int(minute[row])) - base_k[row]).ravel() for row in self.rows.tolist()], np.float32
        )

    def _add_full(self, sums: MapSums, surface_k: SurfaceK) -> None:
        """Add the minutes by the full model, whose stored heat also depends on the minutes before.

        Of a single one it is left to the uncertainty, as for regions.
        """
        settings = replace(self.settings, model="full")
        rows, over_k = self.rows, self._over_k(surface_k)
        minutes, base_k = self.history.at(rows), self._reference_k[rows]
        stored, kernel = np.zeros(over_k.shape), np.zeros(1)
        if self.chosen.size > 1:
            kernel = smoothed_kernel(settings.slab)
            pieces = [conduction(minutes.minute, piece, settings.slab) for piece in _pieces(over_k)]
            stored = np.concatenate(pieces, axis=1)
        beam, vertical = absorbed_light(minutes, base_k, settings)
        design = minutes.sun + (vertical / beam)[:, np.newaxis] * VERTICAL
        light = beam * settings.scale / (1.0 - settings.surface.albedo)
        for row in np.flatnonzero(np.isin(rows, self.chosen)).tolist():
            loss = float(irradiance_per_kelvin(base_k[row], settings.surface))
            loss *= 1.0 - settings.surface.albedo
            gain = float(np.sqrt((loss + kernel[0]) ** 2 + np.sum(kernel[1:] ** 2))) / loss
            kelvin = (over_k[row] + base_k[row]).reshape(sums.shape).astype(np.float64)
            reference = self._reference_normal
            sums.add(kelvin, base_k[row], design[row], light[row], reference, stored[row], gain)

    def _add_learned(self, sums: MapSums, surface_k: SurfaceK, learnt: Learnt) -> EstimatorSettings:
        """Add the minutes by the learned model; the settings with the uncertainties that rows leave out."""
        rows, over_k = self.rows, self._over_k(surface_k)
        history = self.history.at(rows)
        columns = np.array([*self._columns.references[self._measured_references], *self._alike], np.int64)
        regions = [self.regions[column] for column in columns]
        chosen = np.isin(rows, self.chosen)
        pixels = pixel_rows(history.only(columns), regions, chosen, self.normals, self.settings, learnt)
        sums.add_rows(pixels.design, pixels.towards_sun, lambda piece: pixels.values(over_k[:, piece]))
        # offsets and drifts are in the rows, pixel by pixel
        return replace(
            self.settings, model="full", scale_sd=pixels.scale_sd, offset_sd_k=0.0, drift_sd_k_per_h=0.0
        )


def _pieces(columns: SingleArray) -> Iterator[FloatArray]:
    """A few thousand columns at a time: the transforms need several times their memory."""
    for begin in range(0, columns.shape[1], 4096):
        yield columns[:, begin : begin + 4096].astype(np.float64)
