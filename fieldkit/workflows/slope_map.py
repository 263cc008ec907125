"""Slope maps: tilt and azimuth of every pixel, from mean frames of the minutes that the estimator trusts.

The estimator goes over the session first, so a minute has the same sun, irradiance, reference and flags
for a pixel as for a region; then the frames of the window's minutes are read once more. Cloudy minutes,
which barely affect a region's estimate, are excluded. With the learned model pixels are solved by the full
model with the parameters learnt from the regions.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

import fieldkit
from fieldkit.disk import replacing
from fieldkit.estimation.balance import absorbed_light, conducted, smoothed_kernel
from fieldkit.estimation.bins import History, MinuteBin, RegionColumns
from fieldkit.estimation.disturbances import MOVED_PX
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.estimation.instruments import Instruments
from fieldkit.estimation.learned.as_settings import learnt_settings
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, PixelBounds, SlopeMap, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings, Model
from fieldkit.model.device import StreamInfo
from fieldkit.model.durations import as_seconds
from fieldkit.model.errors import FieldkitError, IntegrityError, NoAnswerError, StorageError
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.samples import Frame, Quality, is_usable
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import CERTAIN, WITH_SLOPE, SlopeEstimate, SlopeState, final_estimates
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.camera_laws import frame_k
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, FloatArray, normal, tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.sessions.file_tree import LIBVER, attach, iso_utc, put_scale, set_attributes
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting, layer_image, plots, slope_map_image
from fieldkit.workflows.batch import Failures, Progress, no_progress
from fieldkit.workflows.cache import code_version
from fieldkit.workflows.estimate import estimates_of, estimator_for, minutes_of
from fieldkit.workflows.executors import THIS_PROCESS, Work, Workers
from fieldkit.workflows.provenance import command_line
from fieldkit.workflows.sources import SessionOrFile, Settings, config_for, reading, settings_from
from fieldkit.workflows.terrain_products import Layer, Products, layers

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from fieldkit.config.pose import CameraPose

EXCLUDED = Quality.CLOUD | Quality.LOW_SUN
"""Flags of minutes that no map is made of."""
SURFACE_MODELS: Mapping[Model, str] = {
    "paper": "paper, eq. (6), unit-norm",
    "full": "full, unit-norm",
    "learned": "full with learnt parameters, unit-norm",
}
LEAST_MINUTES = 3
BEFORE_MINUTES = 120
"""Minutes before the window whose warmth the sand remembers."""
ENDINGS = (".png", ".nc")


Window = float | str | None
"""Back from the last usable minute: seconds, a duration such as "20m", "all", or "weather" for as far as
the regions' own slopes look; None as configured."""


@dataclass(frozen=True)
class MappedRegion:
    """A region of a map: median tilt, quartiles, azimuth of the mean normal, shares of the states.

    `tilt_region_deg` are the medians over the pixels of the ends of their 90 % regions. Angles in degrees.
    """

    region: str
    tilt_deg: float
    azimuth_deg: float
    tilt_low_deg: float
    tilt_high_deg: float
    tilt_region_deg: tuple[float, float]
    pixels: int
    states: dict[str, float]


@dataclass(frozen=True, slots=True)
class MappedSession:
    """A slope map and what it was made of: the minutes `start_ns`..`end_ns`, how many, and their flags.

    `overrides` are the ``KEY=VALUE`` given over the configuration.
    `smeared_px` is by how much the frame's content lay elsewhere from minute to minute; frames are not moved.
    `damaged` counts the camera's frames in them that do not match their checksum; they were excluded.
    """

    path: Path
    overrides: tuple[str, ...]
    slopes: SlopeMap
    bounds: PixelBounds
    likelihood: PixelPosterior
    camera: StreamInfo
    site: Site
    regions: tuple[Region, ...]
    settings: EstimatorSettings
    model: Model
    irradiance_model: str
    start_ns: int
    end_ns: int
    minutes: int
    flags: Quality
    smeared_px: float = 0.0
    damaged: int = 0
    inertia: LearntParameter | None = None
    """Thermal inertia that the learned model found, shared by all regions."""
    pose: CameraPose | None = None
    """Where the camera stood, if that was configured: `fieldkit.workflows.on_ground.view_of`."""

    @property
    def states(self) -> dict[str, float]:
        """The share of the pixels in each state that occurs."""
        return _shares(self.slopes.state)

    @property
    def has_moved(self) -> bool:
        """Whether the frame moved within the window."""
        return bool(self.flags & Quality.MOVED or self.smeared_px > MOVED_PX)

    @property
    def notes(self) -> list[str]:
        """What was configured for regions and does not apply to pixels, and what spoils the map."""
        holds = {
            "the map leaves the azimuth free: only regions have a known one": self.settings.azimuth
            == "known",
            "the frame moved within the window: edges are smeared; choose another --window": self.has_moved,
        }
        return [note for note, applies in holds.items() if applies]

    @property
    def damage(self) -> IntegrityError | None:
        """The error for frames that do not match their checksum; the map was made without them."""
        if not self.damaged:
            return None
        text = f"{self.path}: {self.damaged} frames do not match their checksum; the map is made without them"
        return IntegrityError(text, fix=f"fieldkit check {self.path}")

    def by_region(self) -> list[MappedRegion]:
        """Each region of the map in numbers."""
        return [_mapped_region(self, region) for region in self.regions]

    def document(self) -> dict[str, Any]:
        """The map in numbers, for ``--json``: minutes, states, flags, regions."""
        return {
            "minutes": self.minutes, "start_ns": self.start_ns, "end_ns": self.end_ns,
            "states": self.states, "flags": [str(flag.name).lower() for flag in self.flags],
            "regions": [asdict(region) for region in self.by_region()],
        }  # fmt: skip

    def __repr__(self) -> str:
        shares = ", ".join(f"{share:.0%} {state}" for state, share in self.states.items())
        return f"<MappedSession {self.path.stem}: {self.minutes} min, {shares}>"

    def _repr_png_(self) -> bytes:
        return _image(self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the tilt of every pixel with the regions' outlines."""
        outlines = {region.name: region.vertices for region in self.regions}
        return plots.tilt_map(self.slopes.tilt_deg, outlines, ax)

    def to_xarray(self) -> xr.Dataset:
        """The arrays over (y, x), rows downwards; needs ``fieldkit[lab]``."""
        import xarray as xr

        arrays = {name: getattr(self.slopes, name) for name in VARIABLES}
        arrays |= {name: getattr(self.bounds, name) for name in BOUNDS}
        attributes = VARIABLES | BOUNDS
        return xr.Dataset(
            {name: (("y", "x"), values, attributes[name]) for name, values in arrays.items()},
            attrs={"session": self.path.name, "minutes": self.minutes},
        )

    def products(self, wanted: Products) -> list[Layer]:
        """Products of the map. Raises `NoAnswerError` for one that cannot be made of it."""
        return layers(self, wanted)

    def write(self, base: str | Path | None = None, made: Sequence[Layer] = ()) -> list[Path]:
        """Write the map as image ``BASE.png`` and arrays ``BASE.nc``; the files. Raises `StorageError`.

        Products in `made` are added to the arrays; each has an image ``BASE-NAME.png``. Without `base` the
        files go to the campaign's results, or beside a session elsewhere.
        """
        base = default_base(self.path) if base is None else Path(base)
        files = [base.with_name(base.name + ending) for ending in ENDINGS]
        images = {base.with_name(f"{base.name}-{layer.name}.png"): layer for layer in made}
        try:
            base.parent.mkdir(parents=True, exist_ok=True)
            # as a whole: a viewer may have the previous one open
            with replacing(files[0], synced=False) as image, replacing(files[1], synced=False) as arrays:
                image.write_bytes(_image(self))
                with open_session(self.path) as session:
                    write_map(arrays, self, session, made)
            for path, layer in images.items():
                with replacing(path, synced=False) as image:
                    image.write_bytes(_layer_image(self, layer))
        except OSError as error:
            raise StorageError(
                f"cannot write {base}: {error.strerror or error}", fix="name another place with -o"
            ) from error
        return [*files, *images]


Maps = dict[Path, tuple[MappedSession, list[Path]]]
"""Maps and their files, by session."""


def slope_map(
    session: SessionOrFile,
    window: Window = None,
    *,
    settings: Settings = (),
    present: bool = False,
) -> MappedSession:
    """Estimate tilt and azimuth of every pixel of a session.

    Parameters
    ----------
    session
        A session or its file; it may still be recording.
    window
        How far back from the last usable minute: seconds, "20m", "all", or "weather" for as far as the
        regions' own slopes look; as configured by default.
    settings
        Other values for keys of ``fieldkit.toml``: ``{"albedo": 0.25}``, or ``KEY=VALUE``.
    present
        Use the campaign's ``fieldkit.toml`` and regions as they are now.

    Returns
    -------
    MappedSession
        The map, with `to_xarray`, `by_region` and `write`.

    Raises
    ------
    SessionError, ConfigError
        If the session cannot be read, or a setting is wrong.
    NoAnswerError
        If there is no reference region, no camera of known temperatures, or fewer than three minutes
        of frames under steady sun.

    Examples
    --------
    >>> slopes = fieldkit.slope_map(session, "all")
    >>> slopes
    <MappedSession 20160101T190001Z-noon: 20 min, 100% uncertain>
    >>> [(bed.region, round(bed.tilt_deg)) for bed in slopes.by_region()]
    [('flat', 1), ('b05', 5), ('b15', 15), ('b25', 26)]
    """
    with reading(session) as opened:
        return _mapped(opened, window, tuple(settings_from(settings)), present)


def map_sessions(
    bases: Mapping[Path, Path],
    window: Window = None,
    *,
    settings: Sequence[str] = (),
    present: bool = False,
    wanted: Products | None = None,
    workers: Workers = THIS_PROCESS,
    on_progress: Progress = no_progress,
) -> tuple[Maps, Failures]:
    """Map sessions and write each under its base, with its products: maps and files, and what failed.

    Workers read the recordings; the files are written here. Raises `StorageError`.
    """
    made: Maps = {}
    failures: Failures = {}
    with workers.executor(len(bases)) as executor:
        work: Work[Path] = Work(executor)
        for path in bases:
            piece = partial(slope_map, path.resolve(), window, settings=settings, present=present)
            work.submit(path, piece)
        for done, (path, found) in enumerate(work.results(), start=1):
            on_progress(done, len(bases))
            if isinstance(found, FieldkitError):
                failures[path] = found
                continue
            try:
                products = found.products(wanted) if wanted is not None else []
                made[path] = found, found.write(bases[path], products)
            except NoAnswerError as error:
                failures[path] = error
                continue
            if (damage := found.damage) is not None:
                failures[path] = damage
    return {path: made[path] for path in bases if path in made}, failures


def default_base(session: Path) -> Path:
    """``results/NAME/slope-map`` of the campaign, or ``NAME-slope-map`` beside a session elsewhere."""
    parent = session.resolve().parent
    if parent.name == "recordings":
        return parent.parent / "results" / session.stem / "slope-map"
    return parent / f"{session.stem}-slope-map"


def _mapped(
    session: SessionReader, window: Window, settings: tuple[str, ...], present: bool
) -> MappedSession:
    config = config_for(session, settings, present=present)
    estimator = estimator_for(session, config, present=present)
    instruments = Instruments(tuple(session.streams.values()), estimator.settings)
    camera = instruments.camera
    if camera is None or not RegionColumns(estimator.schedule.columns).references.size:
        missing = "camera whose temperatures are known" if camera is None else "reference region"
        raise NoAnswerError(f"{session.path} has no {missing}, so it has no slope map")
    minutes = list(minutes_of(session, estimator))
    estimates = list(estimates_of(minutes))
    chosen = _window(estimator, estimates, window)
    if len(chosen) < LEAST_MINUTES:
        raise NoAnswerError(
            f"{session.path}: {len(chosen)} minutes have frames, reference, sun and steady irradiance; "
            f"a map needs {LEAST_MINUTES}",
            fix="run fieldkit check for what is missing; --window all uses the whole session",
        )
    used = _settings(estimator, minutes)
    slopes, bounds, likelihood = _solved(session, camera, estimator, used, chosen)
    return MappedSession(
        path=session.path,
        overrides=settings,
        slopes=slopes,
        bounds=bounds,
        likelihood=likelihood,
        camera=camera,
        site=estimator.site,
        regions=estimator.regions,
        settings=used,
        model=estimator.settings.model,
        irradiance_model=instruments.label,
        start_ns=chosen[0].start_ns,
        end_ns=chosen[-1].start_ns + MINUTE_NS,
        minutes=len(chosen),
        flags=_flags(chosen),
        smeared_px=float(np.ptp([one.shift_px for one in chosen])),
        damaged=session.damaged.get(camera.name, 0),
        inertia=_inertia(estimator, minutes),
        pose=config.pose,
    )


def _settings(estimator: Estimator, minutes: Sequence[Minute]) -> EstimatorSettings:
    """Settings of the map: the configured ones, or the full model with what the session taught."""
    settings = estimator.settings
    if settings.model != "learned":
        return settings
    learnt = _learnt(minutes)
    if learnt is None:
        return replace(settings, model="full")
    air_k = np.array([one.air_k for one in estimator.bins])
    return learnt_settings(
        settings, learnt, float(np.nanmean(air_k)) if np.isfinite(air_k).any() else math.nan
    )


def _learnt(minutes: Sequence[Minute]) -> Learnt | None:
    return next((one.learnt for one in reversed(minutes) if one.learnt is not None), None)


def _inertia(estimator: Estimator, minutes: Sequence[Minute]) -> LearntParameter | None:
    learnt = _learnt(minutes) if estimator.settings.model == "learned" else None
    found = learnt.parameters if learnt is not None else ()
    return next((one for one in found if one.name == "thermal_inertia"), None)


def _window(estimator: Estimator, estimates: Sequence[SlopeEstimate], window: Window) -> list[MinuteBin]:
    """The usable minutes of a window."""
    final = final_estimates(estimates, estimator.regions)
    weather_ns = max((one.window_start_ns for one in final.values() if one.state in WITH_SLOPE), default=0)
    window_s: float | None
    match window:
        case None:
            is_learned = estimator.settings.model == "learned"
            window_s = None if is_learned else estimator.settings.window_s
        case "all":
            window_s = math.inf
        case "weather":
            window_s = None
        case duration:
            window_s = as_seconds(duration)
    bins = [one for one in estimator.bins if _is_sunlit(one, estimator)]
    return chosen_minutes(bins, RegionColumns(estimator.regions), window_s, weather_ns)


def _is_sunlit(one: MinuteBin, estimator: Estimator) -> bool:
    """Whether neither the site's horizon nor that of a reference hides any of the sun."""
    settings = estimator.settings
    references = (region.name for region in estimator.regions if region.kind is RegionKind.REFERENCE)
    horizons = (settings.horizon, *(settings.horizon_of(name) for name in references))
    return all(sunlit_share(horizon, one.sun, MINUTE_EDGE_DEG) == 1.0 for horizon in horizons)


def chosen_minutes(
    bins: Sequence[MinuteBin], field: RegionColumns, window_s: float | None, weather_ns: int
) -> list[MinuteBin]:
    """The usable minutes of a window, which ends with the last of them.

    It begins `window_s` before, or with the minute `weather_ns` lies in where that is None.
    """
    useful = [one for one in bins if _is_useful(one, field)]
    if not useful:
        return []
    first = weather_ns // MINUTE_NS if window_s is None else useful[-1].minute - window_s / 60.0
    return [one for one in useful if one.minute >= first]


def _is_useful(one: MinuteBin, field: RegionColumns) -> bool:
    known = np.isfinite(one.dni_w_m2) and np.isfinite(one.temperature_k[field.references]).any()
    return bool(known and not one.flags & EXCLUDED)


def _flags(bins: Sequence[MinuteBin]) -> Quality:
    flags = Quality.GOOD
    for one in bins:
        flags |= one.flags
    return flags


def _solved(
    session: SessionReader,
    camera: StreamInfo,
    estimator: Estimator,
    settings: EstimatorSettings,
    chosen: Sequence[MinuteBin],
) -> tuple[SlopeMap, PixelBounds, PixelPosterior]:
    field, shape = RegionColumns(estimator.regions), (camera.shape[0], camera.shape[1])
    sums = MapSums(shape, settings.surface, settings.noise_k, settings.tilt_limit_deg)
    emissivity, offset_k = _of_pixels(estimator.regions, shape, settings)

    def surface_k(minute: int) -> FloatArray:
        # the offset is of brightness temperature, and a kelvin of it is more than one of the grey surface
        brightness = mean_of_minute_k(session, camera, minute)
        return surface_temperature_k(brightness - offset_k, emissivity, settings.reflected_temperature_k)

    # as for regions: a reference without any temperature is excluded, the others are averaged
    table = np.array([one.temperature_k[field.references] for one in chosen])
    seen = np.isfinite(table).any(axis=0)
    reference_normal = field.reference_normals[seen].mean(axis=0)
    if settings.model == "paper":
        for one, references_k in zip(chosen, table[:, seen], strict=True):
            reference_k = float(np.mean(references_k))
            if np.isfinite(reference_k):
                dni_w_m2 = one.dni_w_m2 * settings.scale
                sums.add(surface_k(one.minute), reference_k, one.sun, dni_w_m2, reference_normal)
    else:
        references = field.references[seen]
        _add_full(sums, surface_k, estimator.bins, chosen, references, reference_normal, settings)
    slopes = sums.solve()
    likelihood = posterior(slopes, sums, reference_normal, settings)
    slopes, bounds = with_bounds(slopes, likelihood, settings)
    return _within_regions(slopes, estimator.regions), bounds, likelihood


def _add_full(
    sums: MapSums,
    surface_k: Callable[[int], FloatArray],
    bins: Sequence[MinuteBin],
    chosen: Sequence[MinuteBin],
    references: NDArray[np.int64],
    reference_normal: FloatArray,
    settings: EstimatorSettings,
) -> None:
    """Add the chosen minutes by the full model, whose stored heat also depends on the minutes before."""
    first = chosen[0].minute - BEFORE_MINUTES
    reference_k = {one.minute: float(np.mean(one.temperature_k[references])) for one in bins}
    known = [one for one in bins if one.minute >= first and np.isfinite(reference_k[one.minute])]
    known = [one for one in known if one.minute <= chosen[-1].minute]
    history = History.of(known)
    base_k = np.array([reference_k[one.minute] for one in known])
    over_k = np.array(
        [(surface_k(one.minute) - reference_k[one.minute]).ravel() for one in known], np.float32
    )
    stored = np.concatenate(
        [conducted(history.minute, piece, settings.slab) for piece in _pieces(over_k)], axis=1
    )
    beam, vertical = absorbed_light(history, base_k, settings)
    design = history.sun + (vertical / beam)[:, np.newaxis] * VERTICAL
    light = beam * settings.scale / (1.0 - settings.surface.albedo)
    kernel, minutes = smoothed_kernel(settings.slab), {one.minute for one in chosen}
    for row, one in enumerate(known):
        if one.minute in minutes:
            loss = float(irradiance_per_kelvin(base_k[row], settings.surface))
            loss *= 1.0 - settings.surface.albedo
            gain = float(np.sqrt((loss + kernel[0]) ** 2 + np.sum(kernel[1:] ** 2))) / loss
            kelvin = (over_k[row] + base_k[row]).reshape(sums.shape).astype(np.float64)
            sums.add(kelvin, base_k[row], design[row], light[row], reference_normal, stored[row], gain)


def _pieces(columns: NDArray[np.float32]) -> Iterator[FloatArray]:
    """A few thousand columns at a time: the transforms need several times their memory."""
    for begin in range(0, columns.shape[1], 4096):
        yield columns[:, begin : begin + 4096].astype(np.float64)


def _within_regions(slopes: SlopeMap, regions: Sequence[Region]) -> SlopeMap:
    """Outside the regions the ground may differ from the reference's material: uncertain."""
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


def mean_of_minute_k(session: SessionReader, camera: StreamInfo, minute: int) -> FloatArray:
    """Mean brightness temperature (rows, cols) of the usable frames of a minute, kelvin.

    NaN where the camera's law has no temperature, and everywhere without a usable frame.
    """
    rows = np.flatnonzero(session.times_ns(camera.name) // MINUTE_NS == minute)
    total, count = np.zeros(camera.shape), 0
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else ():
        for frame in session.stream(camera.name).samples(int(run[0]), int(run[-1]) + 1):
            if isinstance(frame, Frame) and is_usable(frame.quality):
                total += frame_k(camera, frame.counts, frame.metadata_rows, np.float32)
                count += 1
    return total / count if count else np.full(camera.shape, np.nan)


def _mapped_region(found: MappedSession, region: Region) -> MappedRegion:
    slopes = found.slopes
    inside = region.mask((slopes.state.shape[0], slopes.state.shape[1]))
    known = inside & np.isfinite(slopes.tilt_deg)
    low, middle, high, azimuth, least, most = (math.nan,) * 6
    if known.any():
        low, middle, high = (float(q) for q in np.percentile(slopes.tilt_deg[known], (25, 50, 75)))
        normals = normal(slopes.tilt_deg[known], slopes.azimuth_deg[known])
        azimuth = float(tilt_azimuth(normals.mean(axis=0))[1])
        bounds = (found.bounds.tilt_low_deg, found.bounds.tilt_high_deg)
        least, most = (float(np.median(bound[known])) for bound in bounds)
    shares = _shares(slopes.state[inside])
    return MappedRegion(region.name, middle, azimuth, low, high, (least, most), int(inside.sum()), shares)


def _shares(states: NDArray[np.uint8]) -> dict[str, float]:
    """The share of the pixels in each state that occurs."""
    shares = {state.name.lower(): float((states == state).mean()) for state in SlopeState if states.size}
    return {name: share for name, share in shares.items() if share}


def _image(found: MappedSession) -> bytes:
    caption = _caption(found)
    return slope_map_image.png(found.slopes, found.bounds, found.regions, found.path.stem, caption)


def _layer_image(found: MappedSession, layer: Layer) -> bytes:
    planes = (layer.values,) if layer.sd is None else (layer.values, layer.sd)
    title, caption = f"{found.path.stem}: {layer.long_name}", _caption(found)
    return layer_image.png(
        planes, found.slopes.state, title, caption, units=layer.units, is_cyclic=layer.is_cyclic
    )


def _caption(found: MappedSession) -> str:
    begin, end = (formatting.clock_time(time_ns, found.site) for time_ns in (found.start_ns, found.end_ns))
    day = formatting.local_time(found.start_ns, found.site).date()
    zone = formatting.zone_name(found.start_ns, found.site)
    return f"{day} {begin}-{end} {zone}, {found.minutes} min"


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


def write_map(path: Path, found: MappedSession, session: SessionReader, made: Sequence[Layer] = ()) -> None:
    """Write the arrays of a map and its products with where they come from. Raises `OSError`."""
    rows, cols = found.slopes.state.shape
    with h5py.File(path, "w", libver=LIBVER, track_order=True) as file:
        set_attributes(file, _provenance(found, session))
        put_scale(file, "y", np.arange(rows, dtype="<i4"), units="1", long_name="row, downwards")
        put_scale(file, "x", np.arange(cols, dtype="<i4"), units="1", long_name="column, to the right")
        for name, attributes in VARIABLES.items():
            _put(file, name, getattr(found.slopes, name), attributes)
        for name, attributes in BOUNDS.items():
            _put(file, name, getattr(found.bounds, name), attributes)
        for layer in made:
            _put_layer(file, layer)
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


def _put_layer(file: h5py.File, layer: Layer) -> None:
    place = {"units": layer.units, "coordinates": "latitude longitude"}
    named = {"standard_name": layer.standard_name} if layer.standard_name else {}
    about = {"ancillary_variables": "state" if layer.sd is None else f"{layer.name}_sd state"}
    _put(file, layer.name, layer.values, {**place, **named, **about, "long_name": layer.long_name})
    if layer.sd is not None:
        named = {name: f"{word} standard_error" for name, word in named.items()}
        about = {"long_name": f"standard uncertainty of {layer.long_name}"}
        _put(file, f"{layer.name}_sd", layer.sd, {**place, **named, **about})


def _region_numbers(found: MappedSession) -> np.ndarray[Any, np.dtype[np.uint8]]:
    shape = found.slopes.state.shape
    numbers = np.zeros(shape, np.uint8)
    for number, region in enumerate(found.regions, start=1):
        numbers[region.mask((shape[0], shape[1]))] = number
    return numbers


def _provenance(found: MappedSession, session: SessionReader) -> dict[str, Any]:
    surface = found.settings.surface
    references = [region.name for region in found.regions if region.kind is RegionKind.REFERENCE]
    return {
        "Conventions": "CF-1.11",
        "title": f"Slope map of {session.header.title or session.path.stem}",
        "institution": session.header.operator,
        "license": session.header.license,
        "source": f"{found.camera.name}: {found.camera.vendor} {found.camera.model}",
        "history": f"made by fieldkit {fieldkit.__version__}: {command_line() or 'from Python'}",
        "comment": "camera coordinates: rows and columns of the picture, not a map projection",
        "session": session.path.name,
        "session_id": session.session_id,
        "code_version": code_version(),
        "python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "settings": " ".join(found.overrides),
        "time_coverage_start": iso_utc(found.start_ns),
        "time_coverage_end": iso_utc(found.end_ns),
        "minutes": found.minutes,
        "surface_model": SURFACE_MODELS[found.model],
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
