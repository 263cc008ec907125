"""From a session to its slope map: mean pictures of the minutes that the estimator trusts, summed and solved.

The estimator goes over the session first, so a minute has the same sun, light, reference and flags for
a pixel as for a region; then the pictures of the window's minutes are read once more. A clouded minute,
which a region's estimate hardly hears, is left out. The surface model is the paper's.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import fieldkit
from fieldkit.config import Config
from fieldkit.estimation.bins import MinuteBin, RegionColumns
from fieldkit.estimation.estimator import Estimator
from fieldkit.estimation.instruments import Instruments
from fieldkit.estimation.pixel_slopes import MapSums, PixelBounds, SlopeMap, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.samples import Frame, Quality, is_usable
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import CERTAIN, WITH_SLOPE, SlopeState, final_estimates
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.camera_laws import frame_k
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.sessions.reader import Session
from fieldkit.sessions.schema import LIBVER, attach, iso_utc, put_scale, set_attributes
from fieldkit.workflows.cache import code_version
from fieldkit.workflows.estimate import estimates_of, estimator_for, minutes_of
from fieldkit.workflows.provenance import command_line

LEFT_OUT = Quality.CLOUD | Quality.LOW_SUN
"""Flags of minutes that no map is made of."""
LEAST_MINUTES = 3


@dataclass(frozen=True, slots=True)
class MappedSession:
    """A slope map and what it was made of: the minutes `start_ns`..`end_ns`, how many, and their flags.

    `damaged` counts the camera's frames in them that do not match their checksum; they were excluded.
    """

    slopes: SlopeMap
    bounds: PixelBounds
    camera: StreamInfo
    site: Site
    regions: tuple[Region, ...]
    settings: EstimatorSettings
    irradiance_model: str
    start_ns: int
    end_ns: int
    minutes: int
    flags: Quality
    damaged: int = 0


def map_of(
    session: Session, config: Config, window_s: float | None, *, present: bool = False
) -> MappedSession:
    """Tilt and azimuth of every pixel from the last `window_s` seconds of a session that can be used.

    `window_s` infinite means all of it, None as far back as the regions' own slopes look. Raises
    `NoAnswerError` where there is no reference, no camera of known temperatures, or fewer than
    three minutes of both pictures and light.
    """
    estimator = estimator_for(session, config, present=present)
    instruments = Instruments(tuple(session.streams.values()), estimator.settings)
    camera = instruments.camera
    field = RegionColumns(estimator.regions)
    if camera is None or not field.references.size:
        missing = "camera whose temperatures are known" if camera is None else "reference region"
        raise NoAnswerError(f"{session.path} has no {missing}, so it has no slope map")
    answers = final_estimates(estimates_of(minutes_of(session, estimator)), estimator.regions)
    weather_ns = max((one.window_start_ns for one in answers.values() if one.state in WITH_SLOPE), default=0)
    chosen = chosen_minutes(estimator.bins, field, window_s, weather_ns)
    if len(chosen) < LEAST_MINUTES:
        raise NoAnswerError(
            f"{session.path}: {len(chosen)} minutes have pictures, reference, sun and steady light; "
            f"a map needs {LEAST_MINUTES}",
            fix="fieldkit check tells what is missing; --window all takes the whole session",
        )
    slopes, bounds = _solved(session, camera, estimator, chosen)
    return MappedSession(
        slopes,
        bounds,
        camera,
        estimator.site,
        estimator.regions,
        estimator.settings,
        instruments.label,
        chosen[0].start_ns,
        chosen[-1].start_ns + MINUTE_NS,
        len(chosen),
        _flags(chosen),
        session.damaged.get(camera.name, 0),
    )


def chosen_minutes(
    bins: Sequence[MinuteBin], field: RegionColumns, window_s: float | None, weather_ns: int
) -> list[MinuteBin]:
    """The minutes of a window that say something: it ends with the last of them.

    It begins `window_s` before, or with the minute `weather_ns` lies in where that is None.
    """
    useful = [one for one in bins if _is_useful(one, field)]
    if not useful:
        return []
    first = weather_ns // MINUTE_NS if window_s is None else useful[-1].minute - window_s / 60.0
    return [one for one in useful if one.minute >= first]


def _is_useful(one: MinuteBin, field: RegionColumns) -> bool:
    known = np.isfinite(one.dni_w_m2) and np.isfinite(one.temperature_k[field.references]).any()
    return bool(known and not one.flags & LEFT_OUT)


def _flags(bins: Sequence[MinuteBin]) -> Quality:
    flags = Quality.GOOD
    for one in bins:
        flags |= one.flags
    return flags


def _solved(
    session: Session, camera: StreamInfo, estimator: Estimator, chosen: Sequence[MinuteBin]
) -> tuple[SlopeMap, PixelBounds]:
    settings, field = estimator.settings, RegionColumns(estimator.regions)
    shape = (camera.shape[0], camera.shape[1])
    sums = MapSums(shape, settings.surface, settings.noise_k, settings.tilt_limit_deg)
    emissivity, offset_k = _of_pixels(estimator.regions, shape, settings)
    # as for regions: a reference that was never seen is no reference, the others are averaged
    table = np.array([one.temperature_k[field.references] for one in chosen])
    seen = np.isfinite(table).any(axis=0)
    reference_normal = field.reference_normals[seen].mean(axis=0)
    for one, references_k in zip(chosen, table[:, seen], strict=True):
        reference_k = float(np.mean(references_k))
        if np.isfinite(reference_k):
            brightness = mean_picture(session, camera, one.minute)
            # what the camera sees too warm is brightness: a kelvin of it is more of a grey surface
            kelvin = surface_temperature_k(
                brightness - offset_k, emissivity, settings.reflected_temperature_k
            )
            light = one.dni_w_m2 * settings.scale
            sums.add(kelvin, reference_k, one.sun, light, reference_normal)
    slopes, bounds = with_bounds(sums.solve(), sums, reference_normal, settings)
    return _within_regions(slopes, estimator.regions), bounds


def _within_regions(slopes: SlopeMap, regions: Sequence[Region]) -> SlopeMap:
    """Outside the regions nothing says that the ground is made of what the reference is: uncertain."""
    state = slopes.state.copy()
    drawn = np.zeros((state.shape[0], state.shape[1]), np.bool_)
    for region in regions:
        drawn |= region.mask((state.shape[0], state.shape[1]))
    state[~drawn & np.isin(state, CERTAIN)] = SlopeState.UNCERTAIN
    return replace(slopes, state=state)


def _of_pixels(
    regions: Sequence[Region], shape: tuple[int, int], settings: EstimatorSettings
) -> tuple[FloatArray, FloatArray]:
    """Emissivity and known offset (kelvin of brightness) of every pixel: a region's own inside it."""
    emissivity, offset_k = np.full(shape, settings.surface.emissivity), np.zeros(shape)
    for region in regions:
        inside = region.mask(shape)
        offset_k[inside] = settings.offsets_k.get(region.name, 0.0)
        if np.isfinite(region.emissivity):
            emissivity[inside] = region.emissivity
    return emissivity, offset_k


def mean_picture(session: Session, camera: StreamInfo, minute: int) -> FloatArray:
    """Mean brightness temperature (rows, cols) of the usable frames of a minute, kelvin.

    NaN where the camera's law has no answer, and all over without a usable frame.
    """
    rows = np.flatnonzero(session.times_ns(camera.name) // MINUTE_NS == minute)
    total, pictures = np.zeros(camera.shape), 0
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else ():
        for frame in session.stream(camera.name).samples(int(run[0]), int(run[-1]) + 1):
            if isinstance(frame, Frame) and is_usable(frame.quality):
                total += frame_k(camera, frame.counts, frame.metadata_rows, np.float32)
                pictures += 1
    return total / pictures if pictures else np.full(camera.shape, np.nan)


# Written as netCDF-4 with CF conventions; by h5py, since netCDF-4 is HDF5 with dimension scales.

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
        "history": f"made by fieldkit {fieldkit.__version__}: {command_line()}",
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
