"""The scene that a configuration describes: beds of sand below a clear or a measured sky."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fieldkit.config import Config
from fieldkit.config.pose import Pose
from fieldkit.config.toml_schema import SimulationTable
from fieldkit.drivers.simulated import CAMERAS, SimulatedField
from fieldkit.drivers.simulated.lepton import frame_shape
from fieldkit.ground.on_ground import ground_view
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.bodies import EARTH, body_of
from fieldkit.physics.camera_geometry import horizon_of_ground
from fieldkit.physics.climate import usual_air_k
from fieldkit.physics.facet import VERTICAL, normal, tilt_azimuth
from fieldkit.results.sources import log_warning
from fieldkit.simulation import ClearSky, Facet, Fault, MeasuredSky, Scene, Sky
from fieldkit.simulation.camera_frame import Motion
from fieldkit.simulation.drawn_field import drawn_scene
from fieldkit.simulation.facets import FRAME_SHAPE, GROUND, Outline
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import Exchange
from fieldkit.simulation.simulated_clock import START_MONO_NS, SimulatedClock
from fieldkit.simulation.terrain import Terrain
from fieldkit.weather import Weather, packaged_day, read_station_file

PACKAGED_DAY = "alamosa-2016-01-01"
FOIL_ALBEDO, FOIL_EMISSIVITY = 0.80, 0.04
"""Crumpled aluminium: it reflects the sky into the camera."""
NEAR_DEG = 0.2
HORIZON_STEP_DEG = 10.0
"""Of the skyline that terrain casts its shadows by."""
HOUR_NS = 3600 * SECOND_NS
BED_OVER_REGION = 1.18
"""Beds are this much larger than the regions drawn on them."""


@contextmanager
def simulated_field(
    config: Config, duration_s: float, from_ns: int | None = None
) -> Iterator[tuple[SimulatedClock, SimulatedField]]:
    """The clock and the instruments of the configured scene, closed at the end.

    `from_ns` is the monotonic time at which the scene is entered, by default its start.
    """
    elapsed_ns = 0 if from_ns is None else from_ns - START_MONO_NS
    scene = scene_of(config, duration_s + elapsed_ns / SECOND_NS)
    simulation = config.tables.simulation
    speed = 1.0 if simulation is None else simulation.speed
    clock = SimulatedClock(scene.start_ns, math.inf if speed == "max" else speed, elapsed_ns)
    offsets_k = simulation.camera_offset_k if simulation else {}
    with clock, SimulatedField(scene, clock, offsets_k) as field:
        yield clock, field


def scene_of(config: Config, duration_s: float) -> Scene:
    """The configured scene, with a bed of sand under every region of stated slope, of its tilt and azimuth.

    On level ground the usual beds lie where no slope is stated, unless one is stated off all of them: a user
    sees where to draw, and a region of unknown slope has that of what it covers.
    Raises `ConfigError` if the configuration does not describe a scene.
    """
    simulation = config.tables.simulation
    if simulation is None:
        raise ConfigError(
            "the devices are simulated, but there is no [simulation] table",
            place=config.path,
            fix="add [simulation] to fieldkit.toml; " + Action.CREATE_CAMPAIGN(simulated=True) + " shows one",
        )
    start_ns = ALAMOSA_NOON_NS
    if simulation.start is not None:
        start_ns = round(simulation.start.timestamp()) * SECOND_NS
    facets, probed = _facets(config, simulation)
    faults = tuple(map(Fault, simulation.faults))
    sky = _sky(config, simulation.weather, start_ns)
    motion = _motion(simulation)
    scene = Scene(
        config.site, sky, facets, start_ns, duration_s, simulation.seed, faults, motion=motion, probed=probed
    )
    if simulation.terrain:
        if config.pose is None:
            raise ConfigError(
                "simulated terrain needs it", place="camera.pose", fix="give [camera] a pose with a dem"
            )
        scene = _in_relief(scene, terrain_of(config.pose.at(start_ns)), simulation)
    if (body := body_of(config.site)) is not EARTH:
        conductivity_w_m_k, heat_capacity_j_m3_k = body.conductivity_w_m_k, body.heat_capacity_j_m3_k
        ground, *beds = (
            replace(bed, conductivity_w_m_k=conductivity_w_m_k, heat_capacity_j_m3_k=heat_capacity_j_m3_k)
            for bed in (scene.ground, *scene.facets)
        )
        still_air = Exchange(body.exchange_w_m2_k, per_wind=0.0)
        scene = replace(scene, facets=tuple(beds), ground=ground, exchange=still_air)
    return drawn_scene(scene) if simulation.drawn else scene


def terrain_of(pose: Pose) -> Terrain:
    """The ground of a pose's DEM as the camera sees it; level where a pixel meets none.

    Raises `ConfigError`, or `NoAnswerError` if the camera sees nothing of it.
    """
    view = ground_view(pose, FRAME_SHAPE)
    if (ground := view.dem) is None:
        raise ConfigError(
            "simulated terrain needs heights", place="camera.pose", fix="give it a dem, a GeoTIFF"
        )
    east, north = np.moveaxis(view.points_m[..., :2].reshape(-1, 2), -1, 0)
    tilt, azimuth = tilt_azimuth(ground.normals(east, north))
    normals = normal(tilt, azimuth - view.grid.true_north_deg)
    azimuths = np.arange(0.0, 360.0, HORIZON_STEP_DEG) + view.grid.true_north_deg
    pieces = np.array_split(np.arange(len(east)), len(east) // 1000 + 1)
    horizon = [horizon_of_ground(ground, east[piece], north[piece], azimuths, 0.0) for piece in pieces]
    is_known = np.isfinite(normals).all(axis=1, keepdims=True)
    return Terrain(np.where(is_known, normals, VERTICAL), np.nan_to_num(np.concatenate(horizon)))


def _in_relief(scene: Scene, terrain: Terrain, simulation: SimulationTable) -> Scene:
    """The scene with sand in relief in place of level ground, whose skyline the beds see too."""
    beds = tuple(replace(bed, horizon=terrain.horizon_at(_middle_pixel(bed))) for bed in scene.facets)
    return replace(scene, terrain=terrain, facets=beds, ground=_of_sand(scene.ground, simulation))


def _middle_pixel(bed: Facet) -> int:
    x, y = np.mean(bed.points_px, axis=0)
    return round(float(y)) * FRAME_SHAPE[1] + round(float(x))


def _facets(config: Config, simulation: SimulationTable) -> tuple[tuple[Facet, ...], tuple[int, ...]]:
    """The beds, and for each region the number of the one that it lies on, -1 for the ground."""
    regions, usual = _regions(config), () if simulation.terrain else BEDS
    own, undrawn = {}, list(usual)
    for region, table in zip(regions, config.tables.region, strict=True):
        covered, is_stated = _most_covered(region.points_px, usual) or GROUND, table.tilt_deg is not None
        is_level = region.kind is RegionKind.REFERENCE and covered.tilt_deg == 0.0
        if is_stated or is_level or region.kind is RegionKind.FOIL:
            own[region.name] = bed = _bed(simulation, region, covered)
            is_elsewhere = is_stated and not _most_covered(bed.points_px, usual)
            undrawn = [left for left in undrawn if not (is_elsewhere or _shared_px(bed.points_px, left))]
    lies_on = [own.get(region.name) or _most_covered(region.points_px, undrawn) for region in regions]
    beds = (*own.values(), *undrawn)
    numbers = tuple(beds.index(bed) if bed else -1 for bed in lies_on)
    names = {number: region.name for number, region in reversed([*zip(numbers, regions, strict=True)])}
    facets = (
        _of_sand(replace(bed, name=names.get(number, f"undrawn {bed.name}")), simulation)
        for number, bed in enumerate(undrawn, start=len(own))
    )
    return (*own.values(), *facets), numbers


def _regions(config: Config) -> list[Region]:
    """The regions in pixels of the scene's frame, whatever the size of their camera's."""
    shapes = {device.name: frame_shape(device) for device in config.devices if device.driver in CAMERAS}
    first = next(iter(shapes.values()), FRAME_SHAPE)
    return [_enlarge(region, shapes.get(region.camera, first)) for region in config.regions]


def _enlarge(region: Region, shape: tuple[int, int]) -> Region:
    """A region drawn in frames of `shape` (rows, cols), in pixels of the scene's."""
    wide, high = FRAME_SHAPE[1] / shape[1], FRAME_SHAPE[0] / shape[0]
    points = tuple(((x + 0.5) * wide - 0.5, (y + 0.5) * high - 0.5) for x, y in region.points_px)
    return replace(region, points_px=points)


def _bed(simulation: SimulationTable, region: Region, covered: Facet) -> Facet:
    """The bed under a region: where its slope is not stated, with that of what it covers."""
    corners = np.asarray(region.points_px)
    outline = corners.mean(axis=0) + BED_OVER_REGION * (corners - corners.mean(axis=0))
    bed = Facet(
        name=region.name,
        points_px=tuple((float(x), float(y)) for x, y in outline),
        tilt_deg=covered.tilt_deg if math.isnan(region.tilt_deg) else region.tilt_deg,
        azimuth_deg=covered.azimuth_deg if math.isnan(region.azimuth_deg) else region.azimuth_deg,
        is_reference=region.kind is RegionKind.REFERENCE,
    )
    bed = _of_sand(bed, simulation)
    if region.kind is not RegionKind.FOIL:
        return bed
    return replace(bed, albedo=FOIL_ALBEDO, emissivity=FOIL_EMISSIVITY, emissivity_broadband=FOIL_EMISSIVITY)


def _of_sand(bed: Facet, simulation: SimulationTable) -> Facet:
    return replace(
        bed,
        albedo=simulation.albedo,
        emissivity=simulation.emissivity,
        emissivity_broadband=simulation.emissivity,
        depth_m=simulation.sand_depth_m,
    )


def _most_covered(outline: Outline, beds: Sequence[Facet]) -> Facet | None:
    """The bed that shares most pixels with an outline, if one does."""
    bed = max(beds, key=partial(_shared_px, outline), default=None)
    return bed if bed and _shared_px(outline, bed) else None


def _shared_px(outline: Outline, bed: Facet) -> int:
    """Number of the scene's pixels in both."""
    regions = (Region("", RegionKind.TARGET, points) for points in (outline, bed.points_px))
    return int(np.logical_and(*(region.mask(FRAME_SHAPE) for region in regions)).sum())


def _motion(simulation: SimulationTable) -> Motion | None:
    drift_x, drift_y = simulation.drift_px
    motion = Motion((drift_x, drift_y), simulation.pan_deg, simulation.jitter_px)
    return None if motion == Motion() else motion


def _sky(config: Config, weather: str, start_ns: int) -> Sky:
    """A measured sky, or a clear one over air as warm as is usual at that site on that day."""
    if weather != "clear":
        return MeasuredSky(measured_weather(config, weather))
    day_ns = start_ns + np.arange(24) * HOUR_NS
    return ClearSky(air_temperature_k=float(np.mean(usual_air_k(day_ns, config.site))))


def measured_weather(config: Config, weather: str) -> Weather:
    """The packaged day by its name, or a SURFRAD or BSRN file of the station at the configured site.

    Raises `ConfigError`.
    """
    if weather == PACKAGED_DAY:
        return packaged_day()
    path = config.directory / Path(weather)
    if not path.is_file():
        raise ConfigError(
            f"there is no file {path}",
            place="weather",
            fix=f'name a SURFRAD or BSRN file, "clear", or the packaged day "{PACKAGED_DAY}"',
        )
    measured = read_station_file(path)
    for note in measured.notes:
        log_warning(note)
    station, site = measured.site, config.site
    apart = abs(station.latitude_deg - site.latitude_deg) + abs(station.longitude_deg - site.longitude_deg)
    if apart > NEAR_DEG:
        there = f"{station.latitude_deg:g}, {station.longitude_deg:g}"
        raise ConfigError(
            f"{path} was measured at {there}, not at the configured site",
            place="weather",
            fix="give [site] the station's latitude_deg and longitude_deg: the sky is that of the station",
        )
    return measured
