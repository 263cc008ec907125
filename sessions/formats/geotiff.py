"""GeoTIFF: layers on the ground written as a cloud-optimised one, and heights of the ground read.

Needs ``fieldkit-slope[terrain]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra
from fieldkit.model.site import Site, apart_m
from fieldkit.physics.camera_geometry import Grid, Heights
from fieldkit.sessions.formats.imported import explained

if TYPE_CHECKING:
    from rasterio.crs import CRS

MOST_STRETCHED = 0.01
"""Largest difference from 1 of a projection's scale, in any direction, that is corrected by one factor."""
MOST_AWAY_M = 50_000.0
"""From the site to the camera: the sun is half a degree elsewhere there."""
STEP_M = 10.0
UNITS_M = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("dm", "decimetre", "decimetres", "decimeter", "decimeters"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 0.001),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), 1000.0),
    **dict.fromkeys(("ft", "foot", "feet", "internationalfoot", "internationalfeet"), 0.3048),
    **dict.fromkeys(("usft", "ftus", "footus", "ussurveyfoot", "ussurveyfeet"), 1200.0 / 3937.0),
}
"""Metres per unit of a band's heights, by its name in small letters alone."""
MARKERS = (-9999.0, -32767.0, -32768.0, 65535.0)
LOWEST_M, HIGHEST_M = -11_000.0, 22_000.0
"""Between the deepest sea and the highest mountain of the worlds."""


def projected_crs(text: str) -> CRS:
    """A projected reference system in metres, such as ``EPSG:32654``. Raises `ConfigError`."""
    _needs_rasterio()
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        problem, fix = "unknown coordinate reference system", 'name one such as "EPSG:32654"'
        raise ConfigError(problem, place=repr(text), fix=fix) from None
    if not crs.is_projected or not math.isclose(crs.linear_units_factor[1], 1.0):
        raise ConfigError("not a projected system in metres", place=text, fix="use the site's UTM zone")
    return crs


def grid_at(crs: CRS, east_m: float, north_m: float) -> Grid:
    """True north and scale of a projected system at a place, from a step of some metres to north and east.

    Raises `ConfigError` outside the system, and where it stretches distances by more than `MOST_STRETCHED`.
    """
    geographic = _geographic(crs)
    (longitude,), (latitude,) = _transform(crs, geographic, [east_m], [north_m])
    steps_m = np.diag([STEP_M, STEP_M])
    east, north = _transform(_around(geographic, longitude, latitude), crs, *steps_m)
    on_grid = np.array([east - east_m, north - north_m]) / STEP_M  # columns: a metre to east, to north
    scales = np.linalg.svd(on_grid, compute_uv=False)
    grid = Grid(math.degrees(math.atan2(*on_grid[:, 1])), float(np.sqrt(scales.prod())))
    most = float(max(scales - 1.0, key=abs))
    if abs(most) > MOST_STRETCHED:
        stretched = f"stretches distances at {east_m:.10g}, {north_m:.10g} by up to {most:+.1%}"
        problem = f"{stretched} ({grid}); {MOST_STRETCHED:.0%} can be corrected"
        fix = f"use a projection made for the site, on the Earth {_utm(longitude, latitude)}"
        raise ConfigError(problem, place=str(crs), fix=fix)
    return grid


def require_near(site: Site, crs: CRS, east_m: float, north_m: float) -> None:
    """Raise `ConfigError` for a place further than `MOST_AWAY_M` from the site."""
    (longitude,), (latitude,) = _transform(crs, _geographic(crs), [east_m], [north_m])
    if apart_m(site, replace(site, latitude_deg=latitude, longitude_deg=longitude)) > MOST_AWAY_M:
        at_site = f"the site at {site.latitude_deg:.4f}, {site.longitude_deg:.4f}"
        problem = f"lies at latitude {latitude:.4f}, longitude {longitude:.4f}, {at_site}"
        fix = "correct crs, east_m and north_m of the pose, or the place under [site]"
        raise ConfigError(problem, place="the camera's pose", fix=fix)


def _geographic(crs: CRS) -> CRS:
    """The system of longitude and latitude under a projected one: of the same body and ellipsoid."""
    from rasterio.crs import CRS

    return CRS.from_wkt(_part(crs.to_wkt(), "GEOGCS"))


def _around(geographic: CRS, longitude_deg: float, latitude_deg: float) -> CRS:
    """True distances to east and north of a place, on the system's ellipsoid."""
    from rasterio.crs import CRS

    centre = {"latitude_of_center": latitude_deg, "longitude_of_center": longitude_deg}
    parameters = "".join(f'PARAMETER["{name}",{degrees:.12f}],' for name, degrees in centre.items())
    projection = f'PROJECTION["Azimuthal_Equidistant"],{parameters}UNIT["metre",1]'
    return CRS.from_wkt(f'PROJCS["around",{geographic.to_wkt()},{projection}]')


def _part(wkt: str, name: str) -> str:
    """The element of that name in well-known text (version 1), with its brackets; "" without."""
    start = wkt.find(f"{name}[")
    depths = np.cumsum([(letter == "[") - (letter == "]") for letter in wkt[start:]])
    closed = np.flatnonzero((depths == 0) & (np.array(list(wkt[start:])) == "]"))
    return "" if start < 0 else wkt[start : start + int(closed[0]) + 1]


def _transform(
    source: CRS, target: CRS, x: Sequence[float], y: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    from rasterio.warp import transform

    try:
        points = np.array(transform(source, target, x, y), np.float64)
    except Exception:  # GDAL's errors have no public class
        points = np.full((2, len(x)), np.nan)
    if not np.isfinite(points).all():
        place, fix = f"{x[0]:.10g}, {y[0]:.10g}", "correct east_m and north_m, or crs"
        raise ConfigError(f"lies outside {source}", place=place, fix=fix)
    return points[0], points[1]


def _utm(longitude_deg: float, latitude_deg: float) -> str:
    zone = int((longitude_deg + 180.0) % 360.0 // 6.0) + 1
    return f"EPSG:{(32600 if latitude_deg >= 0.0 else 32700) + zone}"


def read_heights(path: Path, crs: CRS, scale: float) -> Heights:
    """The first band of a DEM in this reference system, in metres; its scale is that of a `Grid`.

    Raises `ConfigError`.
    """
    _needs_rasterio()
    import rasterio
    from rasterio.errors import RasterioIOError

    readable = explained(path, "cannot read the DEM", "name a GeoTIFF of heights", RasterioIOError)
    with readable, rasterio.open(path) as file:
        band = file.read(1, masked=True).astype(np.float64).filled(np.nan)
        crs_of_file, place = file.crs, file.transform
        gain, offset, unit = file.scales[0], file.offsets[0], file.units[0]
    if _horizontal(crs_of_file) != _horizontal(crs):
        problem = f"in {crs_of_file or 'no reference system'}, the pose in {crs}"
        fix = f"transform it: gdalwarp -t_srs {crs} -r bilinear {path} dem.tif"
        raise ConfigError(problem, place=path, fix=fix)
    if place.b or place.d or place.e >= 0.0 or not math.isclose(place.a, -place.e, rel_tol=1e-6):
        fix = "resample it to larger cells: gdalwarp -tr 0.5 0.5 IN.tif OUT.tif"
        raise ConfigError("no square cells with north up", place=path, fix=fix)
    upwards = -1.0 if ",DOWN]" in crs_of_file.to_wkt() else 1.0  # a system of depths
    heights = upwards * (band * gain + offset) * _metres_per_unit(path, unit)
    _refuse_no_heights(path, heights, band)
    return Heights(place.c, place.f, place.a, heights, scale)


def _horizontal(crs: CRS | None) -> CRS | None:
    """A system without the heights of a compound one."""
    from rasterio.crs import CRS

    plane = _part(crs.to_wkt(), "PROJCS") if crs else ""
    return CRS.from_wkt(plane) if plane else crs


def _metres_per_unit(path: Path, unit: str | None) -> float:
    """Metres in the unit of a band's heights, 1 without one; GDAL gives a compound system's to the band."""
    if not unit:
        return 1.0
    if (metres := UNITS_M.get(re.sub("[^a-z]", "", unit.lower()))) is None:
        fix = f"set it to m, ft or US survey foot: rio edit-info --bidx 1 --units m {path}"
        raise ConfigError(f"heights in {unit!r}, a unit that is not known", place=path, fix=fix)
    return metres


def _refuse_no_heights(path: Path, heights_m: FloatArray, band: FloatArray) -> None:
    """Raise `ConfigError` for a marker of missing heights that the file does not declare."""
    is_marker = np.isin(band, MARKERS) | (heights_m < LOWEST_M) | (heights_m > HIGHEST_M)
    if is_marker.any():
        marker = f"{band[is_marker][0]:.17g}"
        fix = f"declare it: rio edit-info --nodata {marker} {path}, or correct scale, offset and unit"
        problem = f"holds {marker}, which is no height, and does not declare it as missing"
        raise ConfigError(problem, place=path, fix=fix)


def write_layers(
    path: Path, layers: Sequence[tuple[str, str, SingleArray]], crs: CRS, west_m: float,
    north_m: float, cell_m: float,
) -> None:  # fmt: skip
    """Write layers (name, units, values) as bands, north up, NaN where nothing is known. Raises `OSError`."""
    import rasterio

    rows, cols = layers[0][2].shape
    profile = {
        "driver": "COG", "width": cols, "height": rows, "count": len(layers), "dtype": "float32",
        "crs": crs, "transform": rasterio.Affine(cell_m, 0.0, west_m, 0.0, -cell_m, north_m),
        "nodata": math.nan, "compress": "deflate",
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        for band, (name, units, values) in enumerate(layers, start=1):
            file.write(values, band)
            file.set_band_description(band, name)
            file.set_band_unit(band, units)


def _needs_rasterio() -> None:
    if find_spec("rasterio") is None:
        raise ConfigError("GeoTIFF needs rasterio", fix=install_extra("terrain"))
