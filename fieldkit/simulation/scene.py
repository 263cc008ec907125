"""The simulated field as a pure function of time and seed, and its truth; `sand_slopes` is the scene of the
demo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.site import Region, Site
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.boards import Board
from fieldkit.simulation.camera_frame import CameraModel, Correction, Motion
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.faults import (
    COOLED_WITHIN_NS,
    MOVED_PX,
    WARMED_K,
    WARMED_WITHIN_NS,
    Fault,
    LightStep,
    cloud_transmission,
    step_transmission,
)
from fieldkit.simulation.scene_series import EXCHANGE, Exchange, SceneModel, SceneSeries, SceneState
from fieldkit.simulation.sky import MeasuredSky, Sky
from fieldkit.simulation.terrain import Terrain, TerrainSeries
from fieldkit.weather import packaged_day

LEAD_S = 3 * 3600.0
"""Time before the start at which the sand begins to store heat."""
AFTER_S = 1800.0
"""Time that the scene continues after its planned end, for instruments that are still reading."""

_LUX_NOISE = 0.002
_PROBE_NOISE_K = 0.03
_DISK_BEFORE, _DISK_FLOOR = 2_000_000_000, 40_000_000  # below the reserve of every recorder

ALAMOSA_NOON_NS = 1_451_674_800_000_000_000
"""2016-01-01 12:00 at UTC-7, when the session of the demo begins."""

BEDS = (
    Facet("flat", ((12, 74), (70, 70), (72, 104), (8, 110)), 0.0, 180.0, is_reference=True),
    Facet("b05", ((86, 70), (146, 74), (152, 110), (88, 104)), 5.0, 180.0),
    Facet("b15", ((24, 26), (72, 24), (72, 56), (18, 60)), 15.0, 180.0),
    Facet("b25", ((86, 24), (134, 26), (142, 60), (86, 56)), 25.0, 180.0),
)
"""A flat bed for reference and three that face south, like the paper's of December 11."""


@dataclass(frozen=True)
class Scene:
    """Beds under a sky, and everything that instruments can measure of them.

    Starts at `start_ns` (UTC) and lasts `duration_s`; the sand begins to store heat `LEAD_S` earlier.
    `facets` carry the true slopes. `response_s` is the time constant of the contact thermometers,
    `circumsolar_share` as in `SceneModel`, `light_factor` the light meter's reading over the truth, `motion`
    the camera's. With `terrain` the ground between the facets is in relief. Contact thermometers lie in the
    facets with the numbers `probed`, -1 for the ground; without them in each. Every value follows from time
    and `seed` alone.
    """

    site: Site
    sky: Sky
    facets: tuple[Facet, ...]
    start_ns: int
    duration_s: float
    seed: int = 1
    faults: tuple[Fault, ...] = ()
    light_steps: tuple[LightStep, ...] = ()
    ground: Facet = GROUND
    exchange: Exchange = EXCHANGE
    response_s: float = 3.0
    circumsolar_share: float = 1.0
    light_factor: float = 1.0
    motion: Motion | None = None
    terrain: Terrain | None = None
    probed: tuple[int, ...] = ()

    @property
    def end_ns(self) -> int:
        """Planned end, UTC nanoseconds."""
        return self.start_ns + round(self.duration_s * SECOND_NS)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Regions as a careful operator would draw them, with the true slopes."""
        return tuple(facet.region() for facet in self.facets)

    def at(self, time_ns: int) -> SceneState:
        """True state at one time (UTC); constant before and after the scene."""
        return self._series.at(time_ns)

    # --- what instruments read

    def frame(self, time_ns: int, number: int, correction: Correction | None = None) -> SingleArray:
        """Frame `number` as brightness temperatures, shape (120, 160), K."""
        last = correction or Correction(ended_ns=self.start_ns)
        brightness_k = self.at(time_ns).brightness_k + self._warmed_k(time_ns)
        ground_k = None if self._terrain_series is None else self._terrain_series.at(time_ns)
        return self._camera.draw(brightness_k, time_ns, number, last, self._homography(time_ns), ground_k)

    def _homography(self, time_ns: int) -> FloatArray | None:
        """Place of the content of the frame, None where it was at the start."""
        motion = self.motion
        if self.is_on(FaultKind.MOVED, time_ns):
            motion = replace(motion or Motion(), jump_px=MOVED_PX, jump_at=-1.0)
        if motion is None:
            return None
        share = (time_ns - self.start_ns) / (self.duration_s * SECOND_NS)
        return motion.homography(share, self._random(time_ns, 7))

    def lux_reading(self, time_ns: int) -> float:
        """Reading of the horizontal light meter, lx."""
        noise = float(self._random(time_ns, 4).standard_normal())
        return self.light_factor * self.at(time_ns).illuminance_lx * (1.0 + _LUX_NOISE * noise)

    def probe_readings(self, time_ns: int) -> FloatArray:
        """Readings of contact thermometers in surfaces, (probed,) or (facets,), K."""
        contact_k = self.at(time_ns).contact_k
        probes = contact_k[list(self.probed)] if self.probed else contact_k[:-1]
        return probes + _PROBE_NOISE_K * self._random(time_ns, 5).standard_normal(probes.size)

    def air_reading(self, time_ns: int) -> float:
        """Reading of a thermometer in the shade beside the beds, K."""
        noise = float(self._random(time_ns, 6).standard_normal())
        return self.at(time_ns).air_temperature_k + _PROBE_NOISE_K * noise

    def disk_free_bytes(self, time_ns: int, real: int) -> int:
        """Free space as the recorder sees it: `real`, unless a fault reduces it."""
        for begin, end in self.fault_spans(FaultKind.DISK):
            if begin <= time_ns < end:
                gone = min(1.0, 2.0 * (time_ns - begin) / (end - begin))
                return min(real, round(_DISK_BEFORE + gone * (_DISK_FLOOR - _DISK_BEFORE)))
        return real

    # --- faults

    def fault_spans(self, kind: FaultKind) -> list[tuple[int, int]]:
        """Begin and end of the faults of one kind, UTC nanoseconds, in order of time."""
        return sorted(
            fault.span_ns(self.start_ns, self.duration_s) for fault in self.faults if fault.kind is kind
        )

    def is_on(self, kind: FaultKind, time_ns: int) -> bool:
        """True if a fault of a kind is active."""
        return any(begin <= time_ns < end for begin, end in self.fault_spans(kind))

    def _warmed_k(self, time_ns: int) -> FloatArray:
        """Warming of facets and ground by the drift, (facets + 1,), K: the last warms fast, cools slowly."""
        warmed = np.zeros(len(self.facets) + 1)
        for begin, end in self.fault_spans(FaultKind.DRIFT):
            if begin <= time_ns < end:
                share = min(1.0, (time_ns - begin) / WARMED_WITHIN_NS, (end - time_ns) / COOLED_WITHIN_NS)
                warmed[-2] = WARMED_K * share
        return warmed

    # --- computed once

    @cached_property
    def _model(self) -> SceneModel:
        return SceneModel(
            site=self.site,
            sky=self.sky,
            beds=self.facets,
            ground=self.ground,
            exchange=self.exchange,
            transmissions=[
                *(step_transmission(self._at_s(step.time_ns), step.factor) for step in self.light_steps),
                *(cloud_transmission(*span) for span in self._spans_s(FaultKind.CLOUD)),
            ],
            response_s=self.response_s,
            circumsolar_share=self.circumsolar_share,
            boards=tuple(
                Board(last.name, *span)
                for last in self.facets[-1:]
                for span in self._spans_s(FaultKind.SHADE)
            ),
        )

    @cached_property
    def _series(self) -> SceneSeries:
        return self._model.series(self._origin_ns, self._length_s)

    @cached_property
    def _terrain_series(self) -> TerrainSeries | None:
        if self.terrain is None:
            return None
        return self._model.terrain_series(self.terrain, self._origin_ns, self._length_s)

    @cached_property
    def _camera(self) -> CameraModel:
        return CameraModel(self.facets, self.seed, is_raked=self.terrain is not None)

    @property
    def _origin_ns(self) -> int:
        return self.start_ns - round(LEAD_S * SECOND_NS)

    @property
    def _length_s(self) -> float:
        return LEAD_S + self.duration_s + AFTER_S

    def _spans_s(self, kind: FaultKind) -> list[tuple[float, float]]:
        return [(self._at_s(begin), self._at_s(end)) for begin, end in self.fault_spans(kind)]

    def _at_s(self, time_ns: int) -> float:
        """Seconds after the origin of the series."""
        return (time_ns - self._origin_ns) / SECOND_NS

    def _random(self, time_ns: int, purpose: int) -> np.random.Generator:
        return np.random.Generator(np.random.SFC64([self.seed, time_ns, purpose]))


def sand_slopes(start_ns: int = ALAMOSA_NOON_NS, duration_s: float = 3 * 3600.0, **more: Any) -> Scene:
    """Sand slopes under the measured sky of the packaged day, from noon on; `more` are fields of `Scene`."""
    weather = packaged_day()
    return Scene(weather.site, MeasuredSky(weather), BEDS, start_ns, duration_s, **more)
