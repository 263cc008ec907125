"""From a configuration to a simulated field: the scene that its regions and its sky describe."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.config import Config
from fieldkit.config.toml_schema import SimulationTable
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import ClearSky, Facet, Fault, FaultKind, MeasuredSky, Scene, Sky
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.simulated_clock import SimulatedClock
from fieldkit.weather import Weather, packaged, read_station_file

PACKAGED_DAY = "alamosa-2016-01-01"
FOIL_ALBEDO, FOIL_EMISSIVITY = 0.80, 0.04
"""Crumpled aluminium: it mirrors, and shows a camera the sky."""
NEAR_DEG = 0.2
BED_OVER_REGION = 1.18
"""Beds are larger than the regions somebody careful draws on them."""


@contextmanager
def simulated_field(config: Config, duration_s: float) -> Iterator[tuple[SimulatedClock, SimulatedField]]:
    """The clock and the instruments of the configured scene, pulled and closed at the end."""
    scene = scene_of(config, duration_s)
    simulation = config.tables.simulation
    speed = 1.0 if simulation is None else simulation.speed
    clock = SimulatedClock(scene.start_ns, math.inf if speed == "max" else speed)
    with clock, SimulatedField(scene, clock) as field:
        yield clock, field


def scene_of(config: Config, duration_s: float) -> Scene:
    """The configured scene; every region with a known tilt is a bed of sand that slopes so.

    Beds of the usual field on which no region is drawn yet lie there as well, to be seen before they are.

    Raises `ConfigError` where the configuration does not describe one.
    """
    simulation = config.simulation
    if simulation is None:
        raise ConfigError(
            "the devices are simulated, but there is no [simulation] table",
            fix="add [simulation] to fieldkit.toml; fieldkit init --simulated shows one",
        )
    start_ns = ALAMOSA_NOON_NS
    if simulation.start is not None:
        start_ns = round(simulation.start.timestamp()) * SECOND_NS
    drawn = tuple(_bed(config, region) for region in config.regions)
    facets = (*drawn, *_undrawn(simulation, drawn))
    faults = tuple(_fault(name) for name in simulation.faults)
    return Scene(
        config.site, _sky(config, simulation.weather), facets, start_ns, duration_s, simulation.seed, faults
    )


def _bed(config: Config, region: Region) -> Facet:
    simulation = config.simulation
    assert simulation is not None
    corners = np.asarray(region.vertices)
    outline = corners.mean(axis=0) + BED_OVER_REGION * (corners - corners.mean(axis=0))
    bed = Facet(
        name=region.name,
        vertices=tuple((float(x), float(y)) for x, y in outline),
        tilt_deg=0.0 if math.isnan(region.tilt_deg) else region.tilt_deg,
        azimuth_deg=180.0 if math.isnan(region.azimuth_deg) else region.azimuth_deg,
        is_reference=region.kind is RegionKind.REFERENCE,
    )
    bed = _of_sand(bed, simulation)
    if region.name != simulation.foil:
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


def _undrawn(simulation: SimulationTable, drawn: Sequence[Facet]) -> Iterator[Facet]:
    """Beds of the usual field under no region; none where a region lies off it: then the field is another."""
    usual = {bed.name: _covered(bed) for bed in BEDS}
    under = [{name for name, mask in usual.items() if (mask & _covered(bed)).any()} for bed in drawn]
    if all(under):
        taken = set[str]().union(*under)
        for bed in BEDS:
            if bed.name not in taken:
                yield _of_sand(replace(bed, name=f"undrawn {bed.name}"), simulation)


def _covered(bed: Facet) -> NDArray[np.bool_]:
    return Region(bed.name, RegionKind.TARGET, bed.vertices).mask(FRAME_SHAPE)


def _fault(name: str) -> Fault:
    try:
        return Fault(FaultKind(name))
    except ValueError as error:
        known = ", ".join(FaultKind)
        raise ConfigError(f"there is no fault {name!r}", fix=f"simulated faults are {known}") from error


def _sky(config: Config, weather: str) -> Sky:
    return ClearSky() if weather == "clear" else MeasuredSky(measured_weather(config, weather))


def measured_weather(config: Config, weather: str) -> Weather:
    """The packaged day by its name, or a SURFRAD or BSRN file of the station at the configured site.

    Raises `ConfigError`.
    """
    if weather == PACKAGED_DAY:
        return packaged()
    path = config.directory / Path(weather)
    if not path.is_file():
        raise ConfigError(
            f"weather: there is no file {path}",
            fix=f'name a SURFRAD or BSRN file, "clear", or the packaged day "{PACKAGED_DAY}"',
        )
    found = read_station_file(path)
    if _degrees_apart(found.site, config.site) > NEAR_DEG:
        there = f"{found.site.latitude_deg:g}, {found.site.longitude_deg:g}"
        raise ConfigError(
            f"weather: {path} was measured at {there}, not at the configured site",
            fix="give [site] the station's latitude_deg and longitude_deg: the sky is that of the station",
        )
    return found


def _degrees_apart(one: Site, other: Site) -> float:
    return abs(one.latitude_deg - other.latitude_deg) + abs(one.longitude_deg - other.longitude_deg)
