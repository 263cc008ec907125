"""The component of slopes along the sun from one thermal image over a surface model, against that model.

The kind of ground is all that is known of it beforehand. Gain, noise, the effect of height and the spread of
slopes are learnt from the other half of the scene, or from the other tiles; the map is that of one instant
(`fieldkit.estimation.instant`).

* Ridges in Pennsylvania (Landsat 7, 120 m): leafless in November, in leaf in July, which must be refused.
* A stony desert fan (drone, 3 m) in the afternoon; the clock of its stamp is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fieldkit
from benchmarks.result import Result
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.confidence import interval_sds
from fieldkit.model.site import Site
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS
from fieldkit.physics.climate import usual_air_k
from fieldkit.physics.daylight import clear_sky, clear_sky_longwave
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors
from fieldkit.physics.terrain import climb_deg
from fieldkit.weather import Weather
from tests.harness.pixels import sums_of_frames

RIDGES_SITE = Site(40.525, -76.272, 280.0)
RIDGES_AT = {"nov": "2002-11-25T15:33", "july": "2002-07-20T15:33"}
DESERT_SITE = Site(31.35, 35.37, -240.0)
DESERT_AT = {"winter time": "2021-05-31T13:16", "summer time": "2021-05-31T12:16"}
"""The image is stamped 15:16 by a clock of either time."""
TILES_C = 45.0
"""Mean temperature of the tiles, which takes the place of each one's own."""
MOST_NDVI = 0.2
"""Index of bare ground and leafless trees; beyond it leaves cool themselves, and no gain holds."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Cells (rows, cols) of one image: surface temperature, height over their mean, unit normals."""

    kelvin: FloatArray
    height_m: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, kelvin: FloatArray, height_m: FloatArray, cell_m: float, by: int) -> Scene:
        """Means over squares of `by` cells; normals from the differences of neighbouring squares."""
        height = _means(height_m, by)
        down, right = np.gradient(height, by * cell_m)
        normals = np.stack([-right, down, np.ones_like(height)], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        return cls(_means(kelvin, by), height - height.mean(), normals)

    def columns(self, directions: FloatArray) -> FloatArray:
        """Columns of a fit (cells, 2 + k): one, its height, what its normal adds along directions (3, k)."""
        along = (self.normals - VERTICAL).reshape(-1, 3) @ directions
        return np.column_stack([np.ones(self.kelvin.size), self.height_m.ravel(), along])

    def along_deg(self, azimuth_deg: float) -> FloatArray:
        """True tilts towards an azimuth in its vertical plane."""
        return climb_deg(self.normals, azimuth_deg + 180.0)


def _means(values: FloatArray, by: int) -> FloatArray:
    rows, cols = (size // by for size in values.shape)
    squares = values[: rows * by, : cols * by].reshape(rows, by, cols, by)
    return np.asarray(squares.mean(axis=(1, 3)))


def _fit(scenes: Sequence[Scene], directions: FloatArray) -> tuple[FloatArray, float]:
    """Temperature of level ground, its change per metre and along directions (3, k), and what is left."""
    design = np.vstack([scene.columns(directions) for scene in scenes])
    kelvin = np.concatenate([scene.kelvin.ravel() for scene in scenes])
    is_finite = np.isfinite(kelvin)
    coefficients = np.linalg.lstsq(design[is_finite], kelvin[is_finite])[0]
    return coefficients, float(np.std(kelvin[is_finite] - design[is_finite] @ coefficients))


def _warming(scenes: Sequence[Scene]) -> tuple[float, float]:
    """Kelvin per unit of slope, and the azimuth towards which surfaces are warmer."""
    east, north = _fit(scenes, np.eye(3)[:, :2])[0][2:]
    return float(np.hypot(east, north)), float(np.degrees(np.arctan2(east, north)) % 360.0)


@dataclass(frozen=True, slots=True)
class Components:
    """Components found, true ones, ends of their regions, and the spread of slopes beforehand, (cells,)."""

    found_deg: FloatArray
    truth_deg: FloatArray
    low_deg: FloatArray
    high_deg: FloatArray
    spread_deg: FloatArray

    @classmethod
    def of(
        cls, known: Sequence[Scene], asked: Scene, sun: FloatArray, settings: EstimatorSettings
    ) -> Components:
        """The map of one instant of a scene, with what is learnt from other scenes under the same sun."""
        (level_k, per_m, per_cosine), noise_k = _fit(known, sun[:, np.newaxis])
        # the noise of a map is that of a pixel and of its reference, which here has none
        noise_k /= np.sqrt(2.0)
        settings = replace(settings, model="paper", noise_k=noise_k, offset_sd_k=0.0, scale_sd=0.0)
        light = per_cosine * float(irradiance_per_kelvin(level_k, settings.surface))
        at_level_k = asked.kelvin - per_m * asked.height_m
        sums = sums_of_frames([at_level_k], [level_k], sun[np.newaxis], noise_k, light)
        along = sums.along_sun(VERTICAL, settings)
        spread = np.std(np.concatenate([scene.along_deg(along.azimuth_deg).ravel() for scene in known]))
        truth = asked.along_deg(along.azimuth_deg)
        columns = (along.tilt_deg, truth, along.low_deg, along.high_deg, np.full(truth.shape, spread))
        return cls(*(column[np.isfinite(along.tilt_deg)] for column in columns))

    def with_prior(self) -> Components:
        """The same if slopes are spread as in the other scenes: the product of two normal distributions."""
        sds = interval_sds(EstimatorSettings().confidence)
        sd = (self.high_deg - self.low_deg) / (2.0 * sds)
        share = self.spread_deg**2 / (self.spread_deg**2 + sd**2)
        centre, half = share * self.found_deg, sds * np.sqrt(share) * sd
        return replace(self, found_deg=centre, low_deg=centre - half, high_deg=centre + half)

    def error_deg(self) -> float:
        """Mean absolute error."""
        return float(np.mean(np.abs(self.found_deg - self.truth_deg)))

    def guess_deg(self) -> float:
        """Error of level ground everywhere."""
        return float(np.mean(np.abs(self.truth_deg)))

    def coverage(self) -> Result:
        """The share of regions that hold the truth."""
        inside = (self.low_deg <= self.truth_deg) & (self.truth_deg <= self.high_deg)
        return Result("  component inside its 90 % region", 100.0 * float(inside.mean()), "%", "85-95")


def _join(parts: Sequence[Components]) -> Components:
    columns = [[getattr(part, name) for part in parts] for name in Components.__slots__]
    return Components(*map(np.concatenate, columns))


def _sun(utc: str, site: Site) -> FloatArray:
    return np.asarray(sun_vectors(_times(utc, 0), site)[0])


def _times(utc: str, minutes: int) -> IntArray:
    """Minutes before a time and it itself, UTC nanoseconds since 1970."""
    last = int(np.datetime64(utc, "ns").astype(np.int64))
    return np.asarray(last + MINUTE_NS * np.arange(-minutes, 1), np.int64)


def ridges(path: Path, settings: EstimatorSettings) -> Iterator[Result]:
    """Rows of a file of bands and heights: an image of leaves is refused, the other measured."""
    bands = {name: values.astype(np.float64) for name, values in np.load(path).items()}
    for month, utc in RIDGES_AT.items():
        red, infrared = bands[f"{month}3"], bands[f"{month}4"]
        ndvi = float(np.median((infrared - red) / (infrared + red)))
        note = "refused: leaves cool themselves" if ndvi > MOST_NDVI else "used"
        yield Result(f"ridges in {month}: NDVI, median", ndvi, "", f"refused > {MOST_NDVI}", note)
        if ndvi <= MOST_NDVI:
            # Landsat 7, band 6 of low gain: radiance and brightness temperature
            kelvin = 1282.71 / np.log(666.09 / (0.067087 * bands[f"{month}61"] - 0.07) + 1.0)
            yield from _leafless(kelvin, bands["dem"], utc, settings)


def _leafless(
    kelvin: FloatArray, dem_m: FloatArray, utc: str, settings: EstimatorSettings
) -> Iterator[Result]:
    sun = _sun(utc, RIDGES_SITE)
    per_slope, azimuth = _warming([Scene.of(kelvin, dem_m, 30.0, 4)])
    predicted = _predicted_warming(utc, sun, settings)
    away = 100.0 * (predicted / per_slope - 1.0)
    note = f"predicted {predicted:.1f}, measured {per_slope:.1f} K per unit of slope towards {azimuth:.0f}°"
    yield Result("  predicted warming by slope less measured", away, "%", "within 15", note)
    west, east = (Scene.of(kelvin[:, part], dem_m[:, part], 30.0, 4) for part in (slice(75), slice(75, 150)))
    pairs = ((west, east), (east, west))
    components = _join([Components.of([known], asked, sun, settings) for known, asked in pairs])
    names = ("gain of the other half", "and its spread of slopes")
    for name, estimate in zip(names, (components, components.with_prior()), strict=True):
        note = f"level ground everywhere {estimate.guess_deg():.2f}"
        yield Result(f"  component along the sun, {name}", estimate.error_deg(), "deg", "<= 2.8", note)
        yield estimate.coverage()


def _predicted_warming(utc: str, sun: FloatArray, settings: EstimatorSettings) -> float:
    """Kelvin per unit of slope along the sun, by the forward model under the clear sky of that morning."""
    times, site = _times(utc, 480), RIDGES_SITE
    dni, dhi = clear_sky(sun_vectors(times, site)[:, 2], times, site.elevation_m)
    air_k = usual_air_k(times, site)
    weather = Weather(times, dni, dhi, clear_sky_longwave(air_k), air_k, np.zeros_like(air_k), site)
    tilt, azimuth = float(np.degrees(np.arctan(0.1))), float(tilt_azimuth(sun)[1])
    facets = [(tilt, azimuth), (tilt, (azimuth + 180.0) % 360.0)]
    towards, away = fieldkit.predict(facets, weather, settings=settings).surface_k[-1]
    return float(towards - away) / 0.2


def desert(path: Path, settings: EstimatorSettings) -> Iterator[Result]:
    """Rows of a file of tiles: the direction of warming against the sun's, and the component along it."""
    data = np.load(path)
    tiles = [_tile(data[f"ir{tile}"], data[f"dsm{tile}"], data[f"shade{tile}"]) for tile in (1, 2, 3)]
    suns = {clock: tilt_azimuth(_sun(utc, DESERT_SITE)) for clock, utc in DESERT_AT.items()}
    per_slope, azimuth = _warming(tiles)
    note = f"open: {per_slope:.1f} K per unit of slope towards {azimuth:.0f}°"
    for clock, (_, towards) in suns.items():
        name = f"desert: direction of warming less the sun's, {clock}"
        yield Result(name, azimuth - float(towards), "deg", "explained", note)
    parts = []
    for asked in tiles:
        others = [tile for tile in tiles if tile is not asked]
        sun = normal(suns["winter time"][0], _warming(others)[1])
        parts.append(Components.of(others, asked, sun, settings))
    components = _join(parts)
    names = ("gain and direction of other tiles", "and their slopes")
    for name, part in zip(names, (components, components.with_prior()), strict=True):
        skill = 100.0 * (1.0 - part.error_deg() / part.guess_deg())
        note = f"error {part.error_deg():.1f}, level ground everywhere {part.guess_deg():.1f} deg"
        yield Result(f"  skill of the component, {name}", skill, "%", ">= 14", note)
        yield part.coverage()


def _tile(celsius: FloatArray, height_m: FloatArray, shade: FloatArray) -> Scene:
    """Cells of 3 m without any in shade, over the tile's mean: a mosaic drifts from tile to tile."""
    scene = Scene.of(np.asarray(celsius, np.float64), np.asarray(height_m, np.float64), 0.6, 5)
    kelvin = np.where(_means(shade, 5) > 0.0, np.nan, scene.kelvin)
    return replace(scene, kelvin=kelvin - np.nanmean(kelvin) + CELSIUS_ZERO_K + TILES_C)
