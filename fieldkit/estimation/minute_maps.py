"""Slope maps from mean frames of minutes: pixel by pixel the model, the noise and the references of regions.

With the learned model a pixel is one more target, of which the regions have taught all but the slope
(`learned.pixels`); paper and full solve the rows that regions have, with one exchange for all minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.balance import absorbed_light, conduction, smoothed_kernel
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.instant import AlongSun
from fieldkit.estimation.learned.pixels import PixelModel
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, PixelBounds, SlopeMap, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray, SingleArray
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.energy_balance import irradiance_difference, irradiance_per_kelvin
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
        over_k, settings, reference = self._over_k(surface_k), self.settings, self._reference_normal
        if settings.model == "learned" and self.learnt is not None and self._alike:
            sums, settings = self._by_learned(over_k, self.learnt)
        else:
            sums = self._by_balance(over_k)
        explained = np.zeros(self.shape, np.bool_)
        for region in self.regions:  # the references, and the targets that have a slope
            if region.kind is RegionKind.REFERENCE or region.name in self.normals:
                explained |= region.mask(self.shape)
        slopes = sums.solve(settings, explained)
        likelihood = posterior(slopes, sums, reference, settings)
        along_sun = sums.along_sun(reference, settings) if self.chosen.size == 1 else None
        return *with_bounds(slopes, likelihood, settings), likelihood, along_sun

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

    def _by_balance(self, over_k: SingleArray) -> MapSums:
        """Rows of the model paper or full, whose stored heat also depends on the minutes before.

        Of a single one it is left to the uncertainty, as for regions.
        """
        settings, surface, rows = self.settings, self.settings.surface, self.rows
        minutes, base_k, absorptance = self.history.at(rows), self._reference_k[rows], 1.0 - surface.albedo
        used = np.flatnonzero(np.isin(rows, self.chosen))
        beam, vertical = absorbed_light(minutes, base_k, settings)
        design = (minutes.sun + (vertical / beam)[:, np.newaxis] * VERTICAL)[used]
        light, level = (beam * settings.scale)[used], design @ self._reference_normal
        loss = absorptance * irradiance_per_kelvin(base_k[used], surface)
        stores_heat = settings.model != "paper" and self.chosen.size > 1
        kernel = smoothed_kernel(settings.slab) if stores_heat else np.zeros(1)
        noise_gain = np.sqrt((loss + kernel[0]) ** 2 + np.sum(kernel[1:] ** 2))
        sd = np.sqrt(2.0) * settings.noise_k * noise_gain / light

        def values(piece: slice) -> FloatArray:
            over = over_k[:, piece].astype(np.float64)
            level_k = base_k[:, np.newaxis]
            heat = absorptance * irradiance_difference(level_k + over, level_k, surface)
            if stores_heat:
                heat += conduction(minutes.minute, over, settings.slab)
            return np.asarray((heat[used].T / light + level) / sd).T

        per_kelvin = np.sum(loss / light / sd**2) / np.sum((design.T / sd) ** 2)
        design /= sd[:, np.newaxis]
        return MapSums.of(self.shape, design, design.T @ (1.0 / sd), values, float(per_kelvin))

    def _by_learned(self, over_k: SingleArray, learnt: Learnt) -> tuple[MapSums, EstimatorSettings]:
        """Rows of the learned model; the settings with the uncertainties that rows leave out."""
        rows, settings = self.rows, self.settings
        columns = np.array([*self._columns.references[self._measured_references], *self._alike], np.int64)
        regions, history = [self.regions[column] for column in columns], self.history.at(rows).only(columns)
        model = PixelModel(history, regions, np.isin(rows, self.chosen), self.normals, settings, learnt)
        pixels = model.rows()
        sums = MapSums.of(
            self.shape, pixels.design, pixels.towards_sun, lambda piece: pixels.values(over_k[:, piece])
        )
        # offsets and drifts are in the rows, pixel by pixel
        return sums, replace(settings, scale_sd=pixels.scale_sd, offset_sd_k=0.0, drift_sd_k_per_h=0.0)
