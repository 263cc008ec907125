"""Slope maps: tilt and azimuth of every pixel, from mean frames of the minutes that the estimator trusts.

The estimator goes over the session first, so a minute has the same sun, irradiance, reference and flags
for a pixel as for a region; then the frames of the window's minutes are read once more and solved by
`fieldkit.estimation.minute_maps`. Cloudy minutes, which barely affect a region's estimate, are excluded.
"""

from __future__ import annotations

import math
import platform
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from fieldkit.disk import replacing
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.chain import rows_after_gaps
from fieldkit.estimation.disturbances import MOVED_PX
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.instant import AlongSun
from fieldkit.estimation.instruments import Instruments
from fieldkit.estimation.minute_maps import MinuteMap
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.ground.on_ground import GroundView, ground_view, write_on_ground
from fieldkit.ground.terrain_products import LAYERS, Layer, Products, layer_along_sun, layers
from fieldkit.model.arrays import BoolArray, ByteArray, FloatArray, IntArray
from fieldkit.model.device import StreamInfo, find_camera, regions_on
from fieldkit.model.durations import as_seconds
from fieldkit.model.errors import ConfigError, FieldkitError, IntegrityError, NoAnswerError
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import Frame, Quality, is_usable
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import CERTAIN, WITH_SLOPE, SlopeState, final_estimates
from fieldkit.model.units import MINUTE_NS
from fieldkit.model.version import __version__
from fieldkit.physics.camera_laws import frame_k
from fieldkit.physics.facet import normal, tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.results.batch import BySession, Failures, Progress, each, no_progress
from fieldkit.results.cache import code_version
from fieldkit.results.executors import results
from fieldkit.results.json_document import attributes
from fieldkit.results.map_file import BOUNDS, VARIABLES, write_map
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.result_files import campaign_folder, command_line, writing
from fieldkit.results.session_estimates import Estimates
from fieldkit.results.sources import (
    ONE,
    SessionOrFile,
    Settings,
    config_for,
    log_warning,
    reading,
    settings_from,
)
from fieldkit.sessions.file_tree import iso_utc
from fieldkit.sessions.formats import geotiff
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting, plots, slope_map_image

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from fieldkit.config.pose import CameraPose

EXCLUDED = Quality.CLOUD | Quality.LOW_SUN
"""Flags of minutes that no map is made of."""
LEARNED_MINUTES = 1440
"""Longest window of the learned model: its covariances are of all minutes by all, 66 MB each of a day."""
LEAST_MINUTES = 3
"""Below these a map is of the last of them alone, and of the component along the sun."""
ONE_MINUTE = "one minute gives the component along the sun alone; another hour of the day gives the rest"
SURFACE_ATTRIBUTES = ("albedo", "emissivity", "emissivity_broadband", "exchange_w_m2_k")
SETTINGS_ATTRIBUTES = (
    *("scale", "noise_k", "scale_sd", "offset_sd_k", "drift_sd_k_per_h", "tilt_limit_deg", "confidence"),
    "reflected_temperature_k",
)
"""Settings that the file of a map states."""
ENDINGS = (".png", ".nc")
ON_GROUND = (".tif", ".mcap")


Window = float | str | None
"""Back from the last usable minute: seconds, a duration such as "20m", "all", or "weather" for as far as
the regions' own slopes look; None as configured."""


@dataclass(frozen=True)
class MappedRegion:
    """A region of a map: median tilt, quartiles, azimuth of the mean normal, shares of the states.

    `tilt_region_deg` are the medians over the pixels of the ends of their likelihood regions; angles in
    degrees. `along_sun_deg` is the median of a map of one minute.
    """

    region: str
    tilt_deg: float
    azimuth_deg: float
    tilt_low_deg: float
    tilt_high_deg: float
    tilt_region_deg: tuple[float, float]
    pixels: int
    states: dict[str, float]
    along_sun_deg: float = math.nan


@dataclass(frozen=True, slots=True)
class MappedSession:
    """A slope map and what it was made of: the minutes `start_ns`..`end_ns`, how many, and their flags.

    `overrides` are the ``KEY=VALUE`` given over the configuration, `window` the one asked for.
    `smeared_px` is by how much the frame's content lay elsewhere from minute to minute; frames are not moved.
    `damaged` counts the camera's frames in them that do not match their checksum; they were excluded.
    """

    path: Path
    overrides: tuple[str, ...]
    window: Window
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
    """Pose of the camera, if it was configured."""
    along_sun: AlongSun | None = None
    """The component along the sun, where one minute gives no more; then no pixel has a slope."""

    @property
    def states(self) -> dict[str, float]:
        """The share of the pixels in each state that occurs."""
        return _shares(self.slopes.state)

    @property
    def has_moved(self) -> bool:
        """True if the frame moved within the window."""
        return bool(self.flags & Quality.MOVED or self.smeared_px > MOVED_PX)

    @property
    def notes(self) -> list[str]:
        """Settings for regions that do not apply to pixels, and what spoils the map."""
        kinds, has_azimuth = ", ".join(self.settings.kinds), self.settings.azimuth == "known"
        notes = (
            (has_azimuth, "the map leaves the azimuth free: only regions have a known one"),
            (self.along_sun is not None, ONE_MINUTE),
            (kinds, f"no pixels of regions of another kind of surface: {kinds}"),
            (self.has_moved, "the frame moved within the window: edges are smeared; choose another window"),
        )
        return [note for applies, note in notes if applies]

    @property
    def damage(self) -> IntegrityError | None:
        """The error for frames that do not match their checksum; the map was made without them."""
        if not self.damaged:
            return None
        text = f"{self.damaged} frames do not match their checksum; the map is made without them"
        return IntegrityError(text, place=self.path, fix=Action.CHECK(self.path))

    def by_region(self) -> list[MappedRegion]:
        """Each region of the map in numbers."""
        return [_mapped_region(self, region) for region in self.regions]

    def document(self) -> dict[str, Any]:
        """The map in numbers, for ``--json``: minutes, states, flags, regions."""
        flags = [str(flag.name).lower() for flag in self.flags]
        regions = [asdict(region) for region in self.by_region()]
        extent = attributes(self, "minutes", "start_ns", "end_ns", "states")
        return {**extent, "confidence": self.bounds.confidence, "flags": flags, "regions": regions}

    def __repr__(self) -> str:
        shares = ", ".join(f"{share:.0%} {state}" for state, share in self.states.items())
        return f"<MappedSession {self.path.stem}: {self.minutes} min, {shares}>"

    def _repr_png_(self) -> bytes:
        return map_png(self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the tilt of every pixel with the regions' outlines."""
        outlines = {region.name: region.points_px for region in self.regions}
        return plots.tilt_map(self.slopes.tilt_deg, outlines, ax)

    def to_xarray(self) -> xr.Dataset:
        """The arrays over (y, x), rows downwards; needs ``fieldkit-slope[lab]``."""
        import xarray as xr

        arrays = {name: getattr(self.slopes, name) for name in VARIABLES}
        arrays |= {name: getattr(self.bounds, name) for name in BOUNDS}
        attributes = VARIABLES | BOUNDS
        about = {"session": self.path.name, "minutes": self.minutes, "confidence": self.bounds.confidence}
        variables = {name: (("y", "x"), values, attributes[name]) for name, values in arrays.items()}
        return xr.Dataset(variables, attrs=about)

    def products(self, products: Products) -> list[Layer]:
        """Products of the map. Raises `NoAnswerError` for one that cannot be made of it."""
        if self.along_sun is not None:
            if set(products.names) != {"rdir"}:
                raise NoAnswerError(ONE_MINUTE, place=self.path.name, fix="choose a window with more minutes")
            return [layer_along_sun(self.along_sun, self.bounds.confidence)]
        return layers(
            products,
            self.slopes,
            self.likelihood,
            site=self.site,
            time_ns=self.start_ns,
            regions=self.regions,
            inertia=self.inertia,
        )

    def on_ground(self, pose: CameraPose, cell_m: float | None = None) -> GroundView:
        """Ground that the pixels saw in the middle of the window.

        Raises `NoAnswerError` if the camera moved: one pose cannot place its pixels. Raises `ConfigError` for
        a pose that is not at the site, otherwise as `fieldkit.ground.on_ground.ground_view`.
        """
        if self.has_moved:
            raise NoAnswerError(
                "the camera moved within the window, and one pose cannot place its pixels on the ground",
                place=self.path.name,
                fix="choose a window in which it stood still, or omit " + Argument("pose"),
            )
        rows, cols = self.slopes.state.shape
        at = pose.at((self.start_ns + self.end_ns) // 2)
        geotiff.require_near(self.site, geotiff.projected_crs(at.table.crs), *at.position_m[:2])
        return ground_view(at, (rows, cols), cell_m)

    def write(
        self,
        base: str | Path | None = None,
        products: Products | None = None,
        *,
        pose: CameraPose | None = None,
        cell_m: float | None = None,
        notify: Callable[[str], None] = log_warning,
    ) -> list[Path]:
        """Write the map as image ``BASE.png`` and arrays ``BASE.nc``; the files.

        `base` is in the campaign's results by default, or beside a session elsewhere. `products` are added to
        the arrays; each has an image ``BASE-NAME.png``. With a pose, given or
        configured, they (or slope and heading) are also written on the ground, in cells of `cell_m`:
        ``BASE.tif``, ``BASE.mcap``. `notify` receives how the grid is corrected, or why a
        configured pose does not put the map on it, and which files of an earlier map stand beside it.

        Raises `StorageError` if a file cannot be written, `NoAnswerError` if a product cannot be made,
        `ConfigError` if a pose that is given does not fit.
        """
        base = default_base(self.path, self.window, self.overrides) if base is None else Path(base)
        view = self._configured_view(cell_m, notify) if pose is None else self.on_ground(pose, cell_m)
        if self.along_sun is not None and products is None:
            products = Products(("rdir",), drive_deg=self.along_sun.azimuth_deg + 180.0)
        if products is None and view is not None:
            products = Products(("slope", "heading"))
        layers = self.products(products) if products is not None else []
        with writing(base):
            files = self._write_frame(base, layers)
            if view is not None:
                notify(f"the grid of {view.crs} is corrected: {view.grid}")
                files += write_on_ground(base, view, layers, self.slopes, self.end_ns)
        if earlier := _earlier_files(base, files):
            notify(f"of an earlier map, not of this one: {', '.join(map(str, earlier))}")
        return files

    def _configured_view(self, cell_m: float | None, notify: Callable[[str], None]) -> GroundView | None:
        """The ground by the configured pose, None without one and where it does not fit."""
        try:
            return None if self.pose is None else self.on_ground(self.pose, cell_m)
        except (ConfigError, NoAnswerError) as error:
            notify(f"not put on the ground: {error.message}")
            return None

    def _write_frame(self, base: Path, layers: Sequence[Layer]) -> list[Path]:
        files = [base.with_name(base.name + ending) for ending in ENDINGS]
        layers_beside = layers if self.along_sun is None else ()  # of one minute the map is the layer
        images = {base.with_name(f"{base.name}-{layer.name}.png"): layer for layer in layers_beside}
        # as a whole: a viewer may have the previous one open
        with replacing(files[0], synced=False) as image, replacing(files[1], synced=False) as arrays:
            image.write_bytes(map_png(self))
            with open_session(self.path) as session:
                attributes = _provenance(self, session)
            write_map(arrays, self.slopes, self.bounds, layers, self.regions, self.site, attributes)
        for path, layer in images.items():
            with replacing(path, synced=False) as image:
                image.write_bytes(_layer_image(self, layer))
        return [*files, *images]


Maps = dict[Path, tuple[MappedSession, list[Path]]]
"""Maps and their files, by session."""


@overload
def slope_map(session: SessionOrFile, window: Window = None, **options: Any) -> MappedSession: ...
@overload
def slope_map(
    session: Sequence[SessionOrFile], window: Window = None, **options: Any
) -> BySession[MappedSession]: ...
def slope_map(  # type: ignore[misc]  # the options above are those below
    session: SessionOrFile | Sequence[SessionOrFile],
    window: Window = None,
    *,
    settings: Settings = (),
    present: bool = False,
    executor: Executor | None = None,
    on_progress: Progress = no_progress,
) -> MappedSession | BySession[MappedSession]:
    """Estimate tilt and azimuth of every pixel of a session, or of each of several.

    Parameters
    ----------
    session
        A session or its file, which may still be recording, or several.
    window
        How far back from the last usable minute: seconds, "20m", "all", or "weather" for as far as the
        regions' own slopes look; as configured by default. By the learned model a day at most, and no
        further than the last gap of two hours.
    settings
        Other values for keys of ``fieldkit.toml``: ``{"albedo": 0.25}``, or ``KEY=VALUE``.
    present
        Use the campaign's ``fieldkit.toml`` and regions as they are now.
    executor
        Any of `concurrent.futures`, whose workers map those of several; this process unless given.
    on_progress
        Called with the frames read so far and their number; of several, with sessions.

    Returns
    -------
    MappedSession
        The map, with `to_xarray`, `by_region` and `write`. Of several, a dictionary of maps by file; its
        `failures` has the errors of the others.

    Raises
    ------
    SessionError, ConfigError
        If the session cannot be read, or a setting is wrong.
    NoAnswerError
        If there is no reference region, no camera of known temperatures, or no minute of frames under steady
        sun. Fewer than three give the component along the sun alone (`MappedSession.along_sun`).

    Examples
    --------
    >>> slopes = fieldkit.slope_map(session, "all")
    >>> slopes
    <MappedSession 20160101T190001Z-noon: 20 min, 100% wide>
    >>> [(bed.region, round(bed.tilt_deg)) for bed in slopes.by_region()]
    [('flat', 3), ('b05', 6), ('b15', 16), ('b25', 27)]
    """
    if not isinstance(session, ONE):
        chosen: dict[str, Any] = {"settings": settings, "present": present}
        return each(slope_map, session, executor, window, on_progress=on_progress, **chosen)
    with reading(session) as opened:
        return _map_session(opened, window, tuple(settings_from(settings)), present, on_progress)


def map_sessions(
    bases: Mapping[Path, Path],
    window: Window = None,
    *,
    settings: Sequence[str] = (),
    present: bool = False,
    products: Products | None = None,
    pose: CameraPose | None = None,
    cell_m: float | None = None,
    executor: Executor | None = None,
    notify: Callable[[str], None] = log_warning,
    on_progress: Progress = no_progress,
) -> tuple[Maps, Failures]:
    """Map sessions and write each under its base as `MappedSession.write` does: maps, files, what failed.

    Workers read the recordings; the files are written here. Raises `StorageError`.
    """
    maps: Maps = {}
    failures: Failures = {}
    make = partial(slope_map, window=window, settings=settings, present=present)
    pieces = [(path, partial(make, path.resolve())) for path in bases]
    for done, (path, session_map) in enumerate(results(executor, pieces), start=1):
        on_progress(done, len(bases))
        if isinstance(session_map, FieldkitError):
            failures[path] = session_map
            continue
        try:
            files = session_map.write(bases[path], products, pose=pose, cell_m=cell_m, notify=notify)
            maps[path] = session_map, files
        except (ConfigError, NoAnswerError) as error:
            failures[path] = error
            continue
        if (damage := session_map.damage) is not None:
            failures[path] = damage
    return {path: maps[path] for path in bases if path in maps}, failures


def default_base(session: Path, window: Window = None, overrides: Sequence[str] = ()) -> Path:
    """``results/NAME/slope-map`` of the campaign, or ``NAME-slope-map`` beside a session elsewhere.

    A window and settings that are not the configured ones are in the name: one map is not taken for another.
    """
    results, name = campaign_folder(session, "results"), "slope-map" + variant(window, overrides)
    return results / session.stem / name if results else session.resolve().parent / f"{session.stem}-{name}"


def variant(window: Window, overrides: Sequence[str] = ()) -> str:
    """End of the name of a map by its window and settings, "" for the configured ones."""
    parts = [] if window is None else [window if isinstance(window, str) else f"{window / 60.0:g}m"]
    pairs = [override.partition("=") for override in sorted(overrides)]
    parts += [f"{key.rpartition('.')[2]}-{value}" for key, _, value in pairs]
    return "".join("-" + re.sub(r"[^\w.-]+", "_", part) for part in parts)


def _earlier_files(base: Path, new_files: Sequence[Path]) -> list[Path]:
    """Files of an earlier map under a base that the new files have not replaced."""
    endings = (*ON_GROUND, *(f"-{name}.png" for name in LAYERS))
    files = [base.with_name(base.name + ending) for ending in endings]
    return [file for file in files if file.exists() and file not in new_files]


def _map_session(
    session: SessionReader, window: Window, settings: tuple[str, ...], present: bool, on_progress: Progress
) -> MappedSession:
    config = config_for(session, settings, present=present)
    minutes = SessionMinutes(session, config, present=present)
    instruments = Instruments(tuple(session.streams.values()), minutes.settings)
    camera = find_camera(instruments.cameras)
    regions = regions_on(camera.name, minutes.regions, instruments.cameras) if camera else ()
    if camera is None or not RegionColumns(regions).references.size:
        missing = "camera whose temperatures are known" if camera is None else "reference region"
        raise NoAnswerError(f"no {missing}, so it has no slope map", place=session.path)
    columns = [place for place, region in enumerate(minutes.regions) if region in regions]
    history, estimates = minutes.history.only(np.array(columns, np.int64)), minutes.estimates()
    chosen = _window(minutes, estimates, window)
    if not len(chosen):
        raise NoAnswerError(
            "no minute has frames, reference, sun and steady irradiance",
            place=session.path,
            fix=Action.CHECK() + " shows what is missing; " + Argument("window", "all") + " uses all of it",
        )
    is_instant = len(chosen) < LEAST_MINUTES
    chosen = chosen[-1:] if is_instant else chosen
    learnt = None if is_instant else estimates.learnt.final
    final = final_estimates(estimates, minutes.regions)
    normals = {
        slope.region: normal(slope.tilt_deg, slope.azimuth_deg)
        for slope in final.values()
        if slope.state in WITH_SLOPE
    }
    shape = camera.shape[0], camera.shape[1]
    minute_map = MinuteMap(history, regions, chosen, shape, minutes.settings, normals, learnt)
    surface_k = surface_of_pixels(regions, shape, minutes.settings)
    total, finished = len(minute_map.rows), count(1)

    def counted_k(minute: int) -> FloatArray:
        on_progress(next(finished), total)
        return surface_k(mean_of_minute_k(session, camera, minute))

    slopes, bounds, likelihood, along_sun = minute_map.solve(counted_k)
    first, last = history.minute[chosen[[0, -1]]].tolist()
    return MappedSession(
        path=session.path,
        overrides=settings,
        window=window,
        slopes=_within_regions(slopes, regions),
        bounds=bounds,
        likelihood=likelihood,
        camera=camera,
        site=minutes.site,
        regions=regions,
        settings=_as_learnt(minutes.settings, learnt),
        model="full" if is_instant and minutes.settings.model == "learned" else minutes.settings.model,
        irradiance_model=instruments.label,
        start_ns=first * MINUTE_NS,
        end_ns=(last + 1) * MINUTE_NS,
        minutes=len(chosen),
        flags=Quality(int(np.bitwise_or.reduce(history.flags[chosen]))),
        smeared_px=float(np.ptp(history.shift_px[chosen])),
        damaged=minutes.measured.damaged.get(camera.name, 0),
        inertia=_inertia(minutes.settings, estimates.learnt.final),
        pose=config.pose,
        along_sun=along_sun,
    )


def _as_learnt(settings: EstimatorSettings, learnt: Learnt | None) -> EstimatorSettings:
    """The settings with the gain and the exchange of all minutes that the learned model found."""
    if settings.model != "learned" or learnt is None:
        return settings
    parameters = {parameter.name: parameter for parameter in learnt.parameters}
    surface, gain = settings.surface, parameters["gain"]
    exchange_m_s = parameters["exchange"].value / (surface.heat_capacity_j_kg_k * surface.air_density_kg_m3)
    surface = replace(surface, exchange_m_s=exchange_m_s)
    return replace(settings, surface=surface, scale=gain.value, scale_sd=gain.sd)


def _inertia(settings: EstimatorSettings, learnt: Learnt | None) -> LearntParameter | None:
    parameters = learnt.parameters if learnt is not None and settings.model == "learned" else ()
    return next((parameter for parameter in parameters if parameter.name == "thermal_inertia"), None)


def _window(known: SessionMinutes, estimates: Estimates, window: Window) -> IntArray:
    """The usable minutes of a window, as rows of `SessionMinutes.history`."""
    final = final_estimates(estimates, known.regions)
    starts_ns = [slope.window_start_ns for slope in final.values() if slope.state in WITH_SLOPE]
    weather_ns = max(starts_ns, default=0)
    is_learned, window_s = known.settings.model == "learned", None
    if window is None:
        window_s = None if is_learned else known.settings.fixed_window_s
    elif window != "weather":
        window_s = math.inf if window == "all" else as_seconds(window)
        if window_s < 60.0:
            what, example = f"{window_s:g} s hold no minute", f"{window_s:g}m"
            raise ConfigError(what, place=Argument("window"), fix=Argument("window", example))
    history, field = known.history, RegionColumns(known.regions)
    useful = np.flatnonzero(_is_sunlit(known, history) & _is_useful(history, field))
    if not useful.size:
        return useful
    minutes = history.minute[useful]
    first = weather_ns // MINUTE_NS if window_s is None else minutes[-1] - window_s / 60.0
    if is_learned:
        anew = history.minute[max(rows_after_gaps(history), default=0)]
        first = max(first, anew, minutes[-1] - LEARNED_MINUTES)
    return useful[minutes >= first]


def _is_sunlit(known: SessionMinutes, history: History) -> BoolArray:
    """Minutes in which neither the site's horizon nor that of a reference hides any of the sun."""
    settings = known.settings
    references = (region.name for region in known.regions if region.kind is RegionKind.REFERENCE)
    horizons = (settings.horizon, *(settings.horizon_of(name) for name in references))
    shares = [sunlit_share(horizon, history.sun, MINUTE_EDGE_DEG) for horizon in horizons]
    return np.asarray(np.all(np.array(shares) == 1.0, axis=0))


def _is_useful(history: History, field: RegionColumns) -> BoolArray:
    has_reference = np.isfinite(history.temperature_k[:, field.references]).any(axis=1)
    is_excluded = (history.flags & int(EXCLUDED)) != 0
    return np.asarray(np.isfinite(history.dni_w_m2) & has_reference & ~is_excluded)


def surface_of_pixels(
    regions: Sequence[Region], shape: tuple[int, int], settings: EstimatorSettings
) -> Callable[[FloatArray], FloatArray]:
    """Surface temperatures of a frame (rows, cols) of brightness temperatures, both in kelvin.

    Emissivity and known offset are a region's own inside it. NaN in regions without a slope, such as a foil,
    and in those of another kind of surface than the reference's.
    """
    emissivity, offset_k = np.full(shape, settings.surface.emissivity), np.zeros(shape)
    for region in regions:
        inside = region.mask(shape)
        # pixels are compared with the reference's surface
        has_slope = region.kind in (RegionKind.REFERENCE, RegionKind.TARGET)
        unknown = not has_slope or region.name in settings.kinds
        offset_k[inside] = math.nan if unknown else settings.offsets_k.get(region.name, 0.0)
        if np.isfinite(region.emissivity):
            emissivity[inside] = region.emissivity

    def surface_k(brightness: FloatArray) -> FloatArray:
        # the offset is of brightness temperature, and a kelvin of it is more than one of the grey surface
        return surface_temperature_k(brightness - offset_k, emissivity, settings.reflected_temperature_k)

    return surface_k


def _within_regions(slopes: SlopeMap, regions: Sequence[Region]) -> SlopeMap:
    """Outside the regions the ground may differ from the reference's material: wide."""
    state = slopes.state.copy()
    in_region = np.any([region.mask((state.shape[0], state.shape[1])) for region in regions], axis=0)
    state[~in_region & np.isin(state, CERTAIN)] = SlopeState.WIDE
    return replace(slopes, state=state)


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


def _mapped_region(session_map: MappedSession, region: Region) -> MappedRegion:
    slopes = session_map.slopes
    inside = region.mask((slopes.state.shape[0], slopes.state.shape[1]))
    has_slope = inside & np.isfinite(slopes.tilt_deg)
    low, middle, high, azimuth, least, most, along_sun = (math.nan,) * 7
    if has_slope.any():
        low, middle, high = (float(q) for q in np.percentile(slopes.tilt_deg[has_slope], (25, 50, 75)))
        normals = normal(slopes.tilt_deg[has_slope], slopes.azimuth_deg[has_slope])
        azimuth = float(tilt_azimuth(normals.mean(axis=0))[1])
        bounds = (session_map.bounds.tilt_low_deg, session_map.bounds.tilt_high_deg)
        least, most = (float(np.median(bound[has_slope])) for bound in bounds)
    if session_map.along_sun is not None and (resolved := inside & session_map.along_sun.resolved).any():
        along_sun = float(np.median(session_map.along_sun.tilt_deg[resolved]))
    return MappedRegion(
        region=region.name,
        tilt_deg=middle,
        azimuth_deg=azimuth,
        tilt_low_deg=low,
        tilt_high_deg=high,
        tilt_region_deg=(least, most),
        pixels=int(inside.sum()),
        states=_shares(slopes.state[inside]),
        along_sun_deg=along_sun,
    )


def _shares(states: ByteArray) -> dict[str, float]:
    """The share of the pixels in each state that occurs."""
    shares = {state.name.lower(): float((states == state).mean()) for state in SlopeState if states.size}
    return {name: share for name, share in shares.items() if share}


def map_png(session_map: MappedSession, width: int = 960, full_deg: float = 0.0) -> bytes:
    """A map as a PNG file close to `width` pixels wide; `full_deg` in full colour, by default its own."""
    if (along_sun := session_map.along_sun) is not None:
        return _layer_image(session_map, layer_along_sun(along_sun, session_map.bounds.confidence))
    about = session_map.path.stem, _caption(session_map)
    return slope_map_image.png(
        session_map.slopes, session_map.bounds, session_map.regions, *about, width=width, full_deg=full_deg
    )


def _layer_image(session_map: MappedSession, layer: Layer) -> bytes:
    planes = (layer.values,) if layer.sd is None else (layer.values, layer.sd)
    title, caption = f"{session_map.path.stem}: {layer.long_name}", _caption(session_map)
    return slope_map_image.layer_png(
        planes, session_map.slopes.state, title, caption, units=layer.units, is_cyclic=layer.is_cyclic
    )


def _caption(session_map: MappedSession) -> str:
    begin = formatting.local_time(session_map.start_ns, session_map.site)
    end = formatting.clock_time(session_map.end_ns, session_map.site, since_ns=session_map.start_ns)
    zone = formatting.zone_name(session_map.start_ns, session_map.site, session_map.end_ns)
    return f"{begin:%Y-%m-%d %H:%M}-{end} {zone}, {session_map.minutes} min"


def _provenance(session_map: MappedSession, session: SessionReader) -> dict[str, Any]:
    references = [region.name for region in session_map.regions if region.kind is RegionKind.REFERENCE]
    model = "paper, eq. (6)" if session_map.model == "paper" else session_map.model
    return {
        "Conventions": "CF-1.11",
        "title": f"Slope map of {session.header.title or session.path.stem}",
        "institution": session.header.operator,
        "license": session.header.license,
        "source": f"{session_map.camera.name}: {session_map.camera.vendor} {session_map.camera.model}",
        "history": f"made by fieldkit {__version__}: {command_line() or 'from Python'}",
        "comment": "camera coordinates: rows and columns of the frame, not a map projection",
        "session": session.path.name,
        "session_id": session.session_id,
        "code_version": code_version(),
        "python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "settings": " ".join(session_map.overrides),
        "time_coverage_start": iso_utc(session_map.start_ns),
        "time_coverage_end": iso_utc(session_map.end_ns),
        "minutes": session_map.minutes,
        "surface_model": f"{model}, unit-norm",
        "irradiance_model": session_map.irradiance_model,
        "reference_regions": " ".join(references),
        **{name: getattr(session_map.settings.surface, name) for name in SURFACE_ATTRIBUTES},
        **{name: getattr(session_map.settings, name) for name in SETTINGS_ATTRIBUTES},
    }
