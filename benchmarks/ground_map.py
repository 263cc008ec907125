"""A map on the ground against the ground's formula: slopes, places and heights after three hours of sun.

A ridge, a crater and a plain, as a DEM of 200 x 200 cells, before a simulated camera of 160x120.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import ArrayLike
from rasterio.transform import xy
from scipy.optimize import least_squares

from benchmarks.result import Result
from fieldkit.config.load import load_config
from fieldkit.config.template import SIMULATED
from fieldkit.ground.on_ground import GroundView, ground_view
from fieldkit.model.arrays import FloatArray, IntArray, SingleArray
from fieldkit.physics.camera_geometry import Heights
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import angle_between_deg, normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import record
from fieldkit.recording.simulated_scene import terrain_of
from fieldkit.results.session import Session

CRS = "EPSG:32613"
WEST_M, SOUTH_M, GROUND_M = 418_830.0, 4_172_900.0, 2300.0
CRATER_M, RIM_M = (WEST_M + 39.0, SOUTH_M + 26.0), 4.0
POSE = {
    "crs": CRS,
    "east_m": WEST_M + 30.0,
    "north_m": SOUTH_M - 6.0,
    "height_m": GROUND_M + 18.0,
    "yaw_deg": 0.0,
    "pitch_deg": -30.0,
    "hfov_deg": 46.0,
    "range_m": 66.0,
    "dem": "dem.tif",
}
FLAT = {"name": "flat", "kind": "reference", "points_px": [[45, 92], [112, 92], [112, 112], [45, 112]]}
FLANKS = {"east": (1.9, 2.9, 27.0, 38.0), "west": (-2.9, -1.9, 25.0, 33.0)}
"""Plane parts of the ridge's sides: metres east of its crest, from to, and north of the corner, from to."""


def height_m(east_m: FloatArray, north_m: FloatArray) -> FloatArray:
    """Height of the ground: a ridge of 2.2 m that runs north by west, a crater of 1 m with a rim."""
    east, north = east_m - WEST_M, north_m - SOUTH_M
    across, beyond_end = east - crest_east_m(north), np.maximum(np.abs(north - 34.0) - 10.0, 0.0)
    ridge = 2.2 * np.exp(-((across / 3.4) ** 2) - (beyond_end / 4.0) ** 2)
    away = np.hypot(east_m - CRATER_M[0], north_m - CRATER_M[1])
    crater = 0.35 * np.exp(-(((away - RIM_M) / 1.2) ** 2)) - np.exp(-((away / 3.0) ** 2))
    return np.asarray(GROUND_M + ridge + crater)


def crest_east_m(north_m: ArrayLike) -> FloatArray:
    """The ridge's crest, east of the corner by north of it."""
    return np.asarray(17.0 - 0.3 * (np.asarray(north_m) - 30.0))


def regions() -> list[dict[str, Any]]:
    """A flat reference, and two patches of even slope on the ridge, of unknown tilt."""
    tables = [FLAT]
    for name, (first, last, south, north) in FLANKS.items():
        at = [(first, south), (last, south), (last, north), (first, north)]
        corners = [[WEST_M + float(crest_east_m(y)) + x, SOUTH_M + y] for x, y in at]
        tables.append({"name": name, "points_m": corners})
    return tables


def slope_deg(east_m: FloatArray, north_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tilt and azimuth from the grid's north, by the formula's differences over a millimetre."""
    step = 5e-4
    rise = [
        height_m(east_m + step * east, north_m + step * north)
        - height_m(east_m - step * east, north_m - step * north)
        for east, north in ((1, 0), (0, 1))
    ]
    return tilt_azimuth(np.stack([-rise[0], -rise[1], np.full(rise[0].shape, 2.0 * step)], axis=-1))


def dem(cells: int = 200, cell_m: float = 0.3) -> Heights:
    """Its heights on square cells."""
    centre = cell_m * (np.arange(cells) + 0.5)
    top = SOUTH_M + cell_m * cells
    return Heights(WEST_M, top, cell_m, height_m(*np.meshgrid(WEST_M + centre, top - centre)))


def write_dem(path: Path, ground: Heights) -> None:
    """Write heights as a GeoTIFF."""
    rows, cols = ground.heights_m.shape
    place = rasterio.Affine(ground.cell_m, 0.0, ground.west_m, 0.0, -ground.cell_m, ground.north_m)
    profile = {"driver": "GTiff", "width": cols, "height": rows, "count": 1, "dtype": "float64"}
    with rasterio.open(path, "w", crs=CRS, transform=place, **profile) as file:
        file.write(ground.heights_m, 1)


def record_terrain(folder: Path, duration: str, ground: Heights) -> Session:
    """Record a session of the terrain from noon on, under a clear sky."""
    folder.mkdir(parents=True)
    write_dem(folder / "dem.tif", ground)
    camera = {**SIMULATED["camera"], "pose": POSE}
    simulation = {**SIMULATED["simulation"], "weather": "clear", "speed": "max", "terrain": True}
    thermometer = {**SIMULATED["thermometer"], "options": {"labels": ["T1", "air"]}}
    tables = {
        **SIMULATED,
        "camera": camera,
        "thermometer": thermometer,
        "simulation": simulation,
        "region": regions(),
    }
    return record(create_campaign(folder, tables), duration=duration, name="terrain")


LEAST_K_PER_DEG = 0.2
STEP_NS = 300_000_000_000
DNI_W_M2, SURFACE_K = 850.0, 290.0
"""Of the clear winter afternoon, for what a degree is worth."""


@dataclass(frozen=True, slots=True)
class GroundMap:
    """Layers of ``ground.tif``, places of its cells, and the true slopes there, azimuth from true north."""

    layers: dict[str, SingleArray]
    cell_m: float
    east_m: FloatArray
    north_m: FloatArray
    tilt_deg: FloatArray
    azimuth_deg: FloatArray

    @classmethod
    def read(cls, path: Path, true_north_deg: float) -> GroundMap:
        """Layers of a file that ``fieldkit map`` wrote."""
        with rasterio.open(path) as file:
            layers = dict(zip(file.descriptions, file.read(), strict=True))
            rows, cols = np.indices(file.shape)
            east, north = xy(file.transform, rows.ravel(), cols.ravel())
            east, north = (np.reshape(values, file.shape) for values in (east, north))
            cell_m = file.transform.a
        tilt, azimuth = slope_deg(east, north)
        return cls(layers, cell_m, east, north, tilt, azimuth - true_north_deg)

    def places_off_m(self) -> float:
        """How far the crater lies from its place: the shift that fits its slopes best."""
        away = np.hypot(self.east_m - CRATER_M[0], self.north_m - CRATER_M[1])
        around = (away < 1.6 * RIM_M) & np.isfinite(self.layers["slope"])
        east, north, tilt = self.east_m[around], self.north_m[around], self.layers["slope"][around]

        def misfit(off_m: FloatArray) -> FloatArray:
            return slope_deg(east - off_m[0], north - off_m[1])[0] - tilt

        fit = least_squares(misfit, (0.0, 0.0))
        return float(np.hypot(*fit.x))

    def heights_off_share(self) -> float:
        """Root mean square error of the heights over the relief, about the median."""
        has_height = np.isfinite(self.layers["height"])
        true = height_m(self.east_m, self.north_m)[has_height]
        off = self.layers["height"][has_height] - true
        return float(np.std(off) / np.ptp(true))


def kelvin_per_degree(view: GroundView, folder: Path, times_ns: IntArray) -> FloatArray:
    """Mean over times of what a degree of tilt is worth in each pixel, zero in shadows, (rows, cols)."""
    config = load_config(folder / "fieldkit.toml")
    assert config.pose is not None
    sun = sun_vectors(times_ns, config.site)
    east, north = view.points_m[..., 0], view.points_m[..., 1]
    tilt, azimuth = (angle.reshape(-1) for angle in slope_deg(east, north))
    azimuth -= view.grid.true_north_deg
    turned = np.abs((normal(tilt + 0.5, azimuth) - normal(tilt - 0.5, azimuth)) @ sun.T)
    facing = normal(tilt, azimuth) @ sun.T > 0.0
    lit = terrain_of(config.pose.at(int(times_ns[0]))).sunlit_share(sun, slice(None))
    loss = float(irradiance_per_kelvin(SURFACE_K, config.surface_parameters()))
    return np.asarray((turned * facing * lit).mean(axis=1).reshape(east.shape) * DNI_W_M2 / loss)


def write_map(folder: Path) -> Path:
    """Map the campaign's session on the ground by the command; the GeoTIFF."""
    words = ["map", "-q", "-o", "ground", "--products", "slope,heading,ptilt", "--limit-deg", "20"]
    subprocess.run([sys.executable, "-m", "fieldkit", *words], cwd=folder, check=True, stdout=subprocess.PIPE)
    return folder / "ground.tif"


def run() -> list[Result]:
    """Record three hours, map them, compare: two minutes."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "terrain")
        with record_terrain(folder, "3h", dem()) as session:
            begin_ns = session.start_ns
        return compare(folder, begin_ns + np.arange(0, 180 * 60 * 10**9, STEP_NS))


def compare(folder: Path, times_ns: IntArray) -> list[Result]:
    """The map of a recorded campaign against the formula."""
    config = load_config(folder / "fieldkit.toml")
    assert config.pose is not None
    view = ground_view(config.pose.at(int(times_ns[0])), (120, 160))
    ground = GroundMap.read(write_map(folder), view.grid.true_north_deg)
    worth = view.on_cells(kelvin_per_degree(view, folder, times_ns).astype(np.float32))
    tilt, azimuth = ground.layers["slope"], ground.layers["heading"]
    telling = np.isfinite(tilt) & (worth >= LEAST_K_PER_DEG)
    off = (tilt - ground.tilt_deg)[telling]
    turned = angle_between_deg(normal(tilt, azimuth), normal(ground.tilt_deg, ground.azimuth_deg))[telling]
    is_steep = ground.tilt_deg[telling] > 5.0
    cells_off = ground.places_off_m() / ground.cell_m
    steep, sd = np.abs(off[is_steep]), ground.layers["slope_sd"][telling][is_steep]
    return [
        Result("tilt where a degree is worth 0.2 K", rms(off), "° RMSE", "<= 1.0", f"{telling.sum()} cells"),
        Result("  steeper than 5°", rms(steep), "° RMSE", "", f"{steep.size} cells"),
        Result("  these within their 90 % bounds", 100.0 * float((steep < 1.645 * sd).mean()), "%", "90"),
        Result("  normal", rms(turned), "° RMSE", ""),
        Result("place of the crater", cells_off, "cells", "<= 0.5", f"{ground.cell_m:.3f} m"),
        Result("heights over a relief of 3.2 m", 100.0 * ground.heights_off_share(), "% RMSE", "<= 5"),
    ]


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
