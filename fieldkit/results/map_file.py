"""A slope map as netCDF-4 with CF conventions; by h5py, since netCDF-4 is HDF5 with dimension scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap
from fieldkit.ground.terrain_products import Layer
from fieldkit.model.arrays import ByteArray
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import SlopeState
from fieldkit.sessions.file_tree import attach, put_scale, set_attributes
from fieldkit.sessions.guarded_file import GuardedFile

_PLACE = {"units": "degree", "coordinates": "latitude longitude"}
_ABOUT = "state chi_square tilt_low_deg tilt_high_deg azimuth_low_deg azimuth_high_deg"
_DEGREES = {**_PLACE, "ancillary_variables": _ABOUT}
_END = "end of the likelihood region of the"
VARIABLES: dict[str, dict[str, Any]] = {
    "tilt_deg": {
        **_DEGREES,
        "standard_name": "ground_slope_angle",
        "long_name": "angle of the surface from horizontal",
    },
    "azimuth_deg": {
        **_DEGREES,
        "standard_name": "ground_slope_direction",
        "long_name": "direction of the surface normal from true north, clockwise",
    },
    "second_tilt_deg": {
        **_DEGREES,
        "long_name": "tilt of the other slope that fits, where the state is not_resolved",
    },
    "chi_square": {"units": "1", "long_name": "reduced chi-square of the pixel"},
    "state": {
        "standard_name": "status_flag",
        "long_name": "state of the slope of a pixel",
        "flag_values": np.array([state.value for state in SlopeState], "u1"),
        "flag_meanings": " ".join(state.name.lower() for state in SlopeState),
    },
}
"""The arrays of the map, each of shape (y, x), with their attributes."""
BOUNDS: dict[str, dict[str, Any]] = {
    "tilt_low_deg": {**_PLACE, "long_name": f"lower {_END} tilt"},
    "tilt_high_deg": {**_PLACE, "long_name": f"upper {_END} tilt"},
    "azimuth_low_deg": {**_PLACE, "long_name": f"lower {_END} azimuth, below 0 across north"},
    "azimuth_high_deg": {**_PLACE, "long_name": f"upper {_END} azimuth, above 360 across north"},
}
"""The same of how sure each pixel is: noise, misfit and stated systematic uncertainties included."""


def write_map(
    path: Path,
    slopes: SlopeMap,
    bounds: PixelBounds,
    layers: Sequence[Layer],
    regions: Sequence[Region],
    site: Site,
    attributes: Mapping[str, Any],
) -> None:
    """Write the arrays of a map and its products, with attributes of the file. Raises `OSError`."""
    rows, cols = slopes.state.shape
    with GuardedFile(path, "w", track_order=True) as file:
        set_attributes(file, attributes)
        put_scale(file, "y", np.arange(rows, dtype="<i4"), units="1", long_name="row, downwards")
        put_scale(file, "x", np.arange(cols, dtype="<i4"), units="1", long_name="column, to the right")
        for name, about in VARIABLES.items():
            _put(file, name, getattr(slopes, name), about)
        for name, about in BOUNDS.items():
            _put(file, name, getattr(bounds, name), about)
        for layer in layers:
            _put_layer(file, layer)
        about = {
            "long_name": "which region a pixel belongs to, 0 for none",
            "flag_values": np.arange(len(regions) + 1, dtype="u1"),
            "flag_meanings": " ".join(["none", *(region.name for region in regions)]),
        }
        _put(file, "region", _region_numbers(regions, (rows, cols)), about)
        for name, direction in (("latitude", "north"), ("longitude", "east")):
            dataset = file.create_dataset(name, data=float(getattr(site, f"{name}_deg")), track_order=True)
            set_attributes(dataset, {"units": f"degrees_{direction}", "standard_name": name})


def _put(file: h5py.File, name: str, values: Any, attributes: dict[str, Any]) -> None:
    dataset = file.create_dataset(name, data=values, shuffle=True, compression="gzip", track_order=True)
    set_attributes(dataset, attributes)
    if values.dtype.kind == "f":
        dataset.attrs["_FillValue"] = np.array(np.nan, dataset.dtype)
    attach(file, dataset, "y", "x")


def _put_layer(file: h5py.File, layer: Layer) -> None:
    place = {"units": layer.units, "coordinates": "latitude longitude"}
    attributes = {"standard_name": layer.standard_name} if layer.standard_name else {}
    about = {"ancillary_variables": "state" if layer.sd is None else f"{layer.name}_sd state"}
    _put(file, layer.name, layer.values, {**place, **attributes, **about, "long_name": layer.long_name})
    if layer.sd is not None:
        attributes = {name: f"{word} standard_error" for name, word in attributes.items()}
        about = {"long_name": f"standard uncertainty of {layer.long_name}"}
        _put(file, f"{layer.name}_sd", layer.sd, {**place, **attributes, **about})


def _region_numbers(regions: Sequence[Region], shape: tuple[int, int]) -> ByteArray:
    numbers = np.zeros(shape, np.uint8)
    for number, region in enumerate(regions, start=1):
        numbers[region.mask(shape)] = number
    return numbers
