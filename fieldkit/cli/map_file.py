"""A slope map as a netCDF-4 file that says what it is and where it comes from (CF conventions).

Written with h5py, since netCDF-4 is HDF5 with dimension scales.
"""

from __future__ import annotations

import platform
import shlex
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import fieldkit
from fieldkit.cli.mapping import MappedSession
from fieldkit.model.site import RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.sessions.datasets import LIBVER, attach, iso_utc, put_scale, set_attributes
from fieldkit.sessions.reader import Session
from fieldkit.workflows.cache import code_version

_PLACE = {"units": "degree", "coordinates": "latitude longitude"}
_ABOUT = "state chi_square tilt_low_deg tilt_high_deg azimuth_low_deg azimuth_high_deg"
_DEGREES = {**_PLACE, "ancillary_variables": _ABOUT}
_END = "end of the 90 % region of the"
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
        "long_name": "what may be said about the slope of a pixel",
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


def write_map(path: Path, found: MappedSession, session: Session, settings: tuple[str, ...]) -> None:
    """Write a map; `settings` are the ``KEY=VALUE`` it was made with. Raises `OSError`."""
    rows, cols = found.slopes.state.shape
    with h5py.File(path, "w", libver=LIBVER, track_order=True) as file:
        set_attributes(file, _provenance(found, session, settings))
        put_scale(file, "y", np.arange(rows, dtype="<i4"), units="1", long_name="row, downwards")
        put_scale(file, "x", np.arange(cols, dtype="<i4"), units="1", long_name="column, to the right")
        for name, attributes in VARIABLES.items():
            _put(file, name, getattr(found.slopes, name), attributes)
        for name, attributes in BOUNDS.items():
            _put(file, name, getattr(found.bounds, name), attributes)
        _put(
            file, "region", _region_numbers(found), {
                "long_name": "which region a pixel belongs to, 0 for none",
                "flag_values": np.arange(len(found.regions) + 1, dtype="u1"),
                "flag_meanings": " ".join(["none", *(region.name for region in found.regions)]),
            },
        )  # fmt: skip
        for name, value, units in (
            ("latitude", found.site.latitude_deg, "degrees_north"),
            ("longitude", found.site.longitude_deg, "degrees_east"),
        ):
            dataset = file.create_dataset(name, data=float(value), track_order=True)
            set_attributes(dataset, {"units": units, "standard_name": name})


def _put(file: h5py.File, name: str, values: Any, attributes: dict[str, Any]) -> None:
    dataset = file.create_dataset(name, data=values, shuffle=True, compression="gzip", track_order=True)
    set_attributes(dataset, attributes)
    if values.dtype.kind == "f":
        dataset.attrs["_FillValue"] = np.array(np.nan, dataset.dtype)
    attach(file, dataset, "y", "x")


def _region_numbers(found: MappedSession) -> np.ndarray[Any, np.dtype[np.uint8]]:
    shape = found.slopes.state.shape
    numbers = np.zeros(shape, np.uint8)
    for number, region in enumerate(found.regions, start=1):
        numbers[region.mask((shape[0], shape[1]))] = number
    return numbers


def _provenance(found: MappedSession, session: Session, settings: tuple[str, ...]) -> dict[str, Any]:
    surface = found.settings.surface
    references = [region.name for region in found.regions if region.kind is RegionKind.REFERENCE]
    return {
        "Conventions": "CF-1.11",
        "title": f"Slope map of {session.header.title or session.path.stem}",
        "institution": session.header.operator,
        "license": session.header.license,
        "source": f"{found.camera.name}: {found.camera.vendor} {found.camera.model}",
        "history": f"made by fieldkit {fieldkit.__version__}: {shlex.join(['fieldkit', *sys.argv[1:]])}",
        "comment": "camera coordinates: rows and columns of the picture, not a map projection",
        "session": session.path.name,
        "session_id": session.session_id,
        "code_version": code_version(),
        "python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "settings": " ".join(settings),
        "time_coverage_start": iso_utc(found.start_ns),
        "time_coverage_end": iso_utc(found.end_ns),
        "minutes": found.minutes,
        "surface_model": "paper, eq. (6), unit-norm",
        "irradiance_model": found.irradiance_model,
        "reference_regions": " ".join(references),
        "albedo": surface.albedo,
        "emissivity": surface.emissivity,
        "emissivity_broadband": surface.emissivity_broadband,
        "exchange_w_m2_k": surface.exchange_w_m2_k,
        "scale": found.settings.scale,
        "noise_k": found.settings.noise_k,
        "scale_sd": found.settings.scale_sd,
        "offset_sd_k": found.settings.offset_sd_k,
        "drift_sd_k_per_h": found.settings.drift_sd_k_per_h,
        "tilt_limit_deg": found.settings.tilt_limit_deg,
        "reflected_temperature_k": found.settings.reflected_temperature_k,
    }
