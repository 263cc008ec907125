"""What the lab's instruments look at: fieldkit's simulated scene, at the guest's own time of day."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.simulation import Correction, Scene, sand_slopes

START = "2016-01-01T19:00:00"
"""UTC of the guest's power-on: noon of the packaged day at Alamosa."""
CORRECTIONS, CORRECTION_AGE_NS = 3, 93_000_000_000
"""How a simulated Lepton stands in its first minute: level and fine pattern follow from it."""


class Field:
    """The scene, seen by cameras of different sizes; times are seconds of this computer's monotonic clock."""

    def __init__(self, scene: Scene | None = None) -> None:
        self.scene = scene or sand_slopes(duration_s=1800.0)
        self._utc_ns: Callable[[float], int] = lambda host_s: self.scene.start_ns
        self._numbers = itertools.count()
        self.lepton(0.0)  # the scene computes its day with the first picture, which would come late

    def follow(self, utc_ns: Callable[[float], int]) -> None:
        """Take the time of day from the guest from now on."""
        self._utc_ns = utc_ns

    def lepton(self, host_s: float) -> FloatArray:
        """A picture of the Lepton's 120x160 pixels in kelvin, with its noise."""
        time_ns = self._utc_ns(host_s)
        corrected = Correction(CORRECTIONS, time_ns - CORRECTION_AGE_NS)
        return self.scene.frame(time_ns, next(self._numbers), corrected).astype(np.float64)

    def wide(self, rows: int, cols: int) -> Callable[[float], FloatArray]:
        """The same scene for a camera of more pixels, by repeating those of the Lepton."""
        row, col = np.arange(rows) * 120 // rows, np.arange(cols) * 160 // cols

        def kelvin(host_s: float) -> FloatArray:
            return self.lepton(host_s)[np.ix_(row, col)]

        return kelvin

    def lux(self) -> float:
        """What the light meter shows now, lx."""
        return self.scene.lux_reading(self._utc_ns(time.monotonic()))

    def probes_k(self) -> FloatArray:
        """What the contact thermometers show now, kelvin."""
        return self.scene.probe_readings(self._utc_ns(time.monotonic()))
