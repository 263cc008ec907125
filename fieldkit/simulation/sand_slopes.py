"""The scene of the demo and of most tests: four sand beds under the clear sky of Alamosa."""

from __future__ import annotations

from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import Fault, LightStep
from fieldkit.simulation.scene import Scene
from fieldkit.simulation.sky import MeasuredSky
from fieldkit.weather import packaged

ALAMOSA_NOON_NS = 1_451_674_800_000_000_000
"""2016-01-01 12:00 at UTC-7, when the session of the demo begins."""

BEDS = (
    Facet("flat", ((12, 74), (70, 70), (72, 104), (8, 110)), 0.0, 180.0, is_reference=True),
    Facet("b05", ((86, 70), (146, 74), (152, 110), (88, 104)), 5.0, 180.0),
    Facet("b15", ((24, 26), (72, 24), (72, 56), (18, 60)), 15.0, 180.0),
    Facet("b25", ((86, 24), (134, 26), (142, 60), (86, 56)), 25.0, 180.0),
)
"""A flat bed for reference and three that face south, like the paper's of December 11."""


def sand_slopes(
    *,
    start_ns: int = ALAMOSA_NOON_NS,
    duration_s: float = 3 * 3600.0,
    seed: int = 1,
    faults: tuple[Fault, ...] = (),
    light_steps: tuple[LightStep, ...] = (),
) -> Scene:
    """Three hours of sand slopes from noon on, under the measured sky that comes with the package."""
    weather = packaged()
    sky = MeasuredSky(weather)
    return Scene(weather.site, sky, BEDS, start_ns, duration_s, seed, faults, light_steps)
