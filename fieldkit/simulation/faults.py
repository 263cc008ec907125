"""Faults as part of a scene: what goes wrong, when and for how long; and the clouds they bring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import MINUTE_NS, SECOND_NS

CLOCK_STEP_S = 3600.0
SHUTTER_STEP_K = 0.8
MOVED_PX = (32.0, 24.0)
"""Columns and rows by which the frame's content moves: too far to be followed."""
WARMED_K, WARMED_WITHIN_NS, COOLED_WITHIN_NS = 3.0, 2 * MINUTE_NS, 8 * MINUTE_NS


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault; it begins in the middle of the scene and lasts as long as its kind, unless given."""

    kind: FaultKind
    after_s: float | None = None
    duration_s: float | None = None

    def span_ns(self, start_ns: int, scene_s: float) -> tuple[int, int]:
        """Begin and end in UTC nanoseconds, in a scene that starts at `start_ns` and lasts `scene_s`."""
        lasts_s = self.kind.lasts_s if self.duration_s is None else self.duration_s
        after_s = scene_s / 2.0 if self.after_s is None else self.after_s
        begin_ns = start_ns + round(after_s * SECOND_NS)
        return begin_ns, begin_ns + round(lasts_s * SECOND_NS)


@dataclass(frozen=True, slots=True)
class LightStep:
    """From `time_ns` on, sunlight and skylight are multiplied by `factor`."""

    time_ns: int
    factor: float


@dataclass(frozen=True, slots=True)
class CloudTransmission:
    """Changes of the light: factors at times (n,) in seconds, linear in between."""

    time_s: FloatArray
    direct: FloatArray
    diffuse: FloatArray
    longwave_w_m2: FloatArray

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Factors of direct and diffuse light and added longwave, each of the shape of `time_s`."""
        direct, diffuse, longwave = (
            np.interp(time_s, self.time_s, column)
            for column in (self.direct, self.diffuse, self.longwave_w_m2)
        )
        return direct, diffuse, longwave


def cloud_transmission(begin_s: float, end_s: float) -> CloudTransmission:
    """A small cumulus before the sun: 20 % of the beam remains, diffuse light and longwave increase."""
    edge_s = min(20.0, (end_s - begin_s) / 3.0)
    times = np.array([begin_s, begin_s + edge_s, end_s - edge_s, end_s])
    inside = np.array([0.0, 1.0, 1.0, 0.0])
    return CloudTransmission(times, 1.0 - 0.8 * inside, 1.0 + 0.6 * inside, 15.0 * inside)


def step_transmission(at_s: float, factor: float) -> CloudTransmission:
    """A step of all light within a microsecond, as from a shutter in front of a lamp."""
    factors = np.array([1.0, factor])
    return CloudTransmission(np.array([at_s - 1e-6, at_s]), factors, factors, np.zeros(2))
