"""GeoTIFF: layers on the ground written as a cloud-optimised one, and heights of the ground read.

Needs ``fieldkit[terrain]``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import ConfigError
from fieldkit.physics.camera_geometry import Heights

if TYPE_CHECKING:
    from rasterio.crs import CRS


def projected_crs(text: str) -> CRS:
    """A projected reference system in metres, such as ``EPSG:32654``. Raises `ConfigError`."""
    _needs_rasterio()
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        raise ConfigError(
            f"unknown coordinate reference system {text!r}", fix='name one such as "EPSG:32654"'
        ) from None
    if not crs.is_projected or not math.isclose(crs.linear_units_factor[1], 1.0):
        raise ConfigError(f"{text} is not a projected system in metres", fix="use the site's UTM zone")
    return crs


def true_north_deg(crs: CRS, east_m: float, north_m: float) -> float:
    """Direction of true north on the grid in degrees, clockwise from the grid's own north."""
    from rasterio.warp import transform

    (longitude,), (latitude,) = transform(crs, "EPSG:4326", [east_m], [north_m])
    (east,), (north,) = transform("EPSG:4326", crs, [longitude], [latitude + 1e-4])
    return math.degrees(math.atan2(east - east_m, north - north_m))


def read_heights(path: Path, crs: CRS) -> Heights:
    """The first band of a DEM in this reference system. Raises `ConfigError`."""
    _needs_rasterio()
    import rasterio
    from rasterio.errors import RasterioIOError

    try:
        with rasterio.open(path) as file:
            heights = file.read(1, masked=True).astype(np.float64).filled(np.nan)
            found, place = file.crs, file.transform
    except RasterioIOError as error:
        raise ConfigError(f"cannot read the DEM {path}: {error}", fix="name a GeoTIFF of heights") from error
    if found != crs:
        raise ConfigError(
            f"{path} is in {found or 'no reference system'}, the pose in {crs}",
            fix=f"gdalwarp -t_srs {crs} {path} dem.tif",
        )
    if place.b or place.d or place.e >= 0.0 or not math.isclose(place.a, -place.e, rel_tol=1e-6):
        raise ConfigError(f"{path} has no square cells with north up", fix="gdalwarp -tr 0.5 0.5 ...")
    return Heights(place.c, place.f, place.a, heights)


def write_layers(
    path: Path, layers: Sequence[tuple[str, str, NDArray[np.float32]]], crs: CRS, west_m: float,
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
    try:
        import rasterio  # noqa: F401
    except ImportError as error:
        raise ConfigError("GeoTIFF needs rasterio", fix="pip install 'fieldkit[terrain]'") from error
