"""Samples in, readings for an emissivity out: the same whether they come from a session or from a cable."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fieldkit.calibration.band import Band, before_camera_settings, transmission, without_air
from fieldkit.calibration.emissivity import (
    FOIL_EMISSIVITY,
    is_saturated,
    mirrored_temperature_k,
    refuse_saturated,
    tape_temperature_k,
)
from fieldkit.calibration.steady_pairs import Readings
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import CalibrationError
from fieldkit.model.samples import Frame, Sample, is_usable
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.camera_laws import frame_k

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setup:
    """What looks at what: streams and regions, and what lies between surface and camera.

    `foil` None means the reflected temperature is not measured by the camera; `foil_emissivity` is what it
    emits itself. `tape` is the region that stands in for a thermometer. `fahrenheit` for a thermometer that
    showed °F under another name. `camera_emissivity` is what the camera has applied itself, with
    `camera_reflected_k`.
    """

    camera: StreamInfo
    sample: Region
    band: Band
    thermometer: StreamInfo | None = None
    channel: int = 0
    foil: Region | None = None
    tape: Region | None = None
    tape_emissivity: float = 0.95
    foil_emissivity: float = FOIL_EMISSIVITY
    reflected_k: float = math.nan
    fahrenheit: bool = False
    camera_emissivity: float = 1.0
    camera_reflected_k: float = 293.15
    distance_m: float = 0.0
    air_k: float = 293.15
    humidity: float = 0.5

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Probes of the thermometer as one would call them."""
        if self.thermometer is None:
            return ()
        count = self.thermometer.shape[0]
        named = self.thermometer.channels
        return named if len(named) == count else tuple(str(number + 1) for number in range(count))


@dataclass
class Gathering:
    """Keeps what is needed of each sample; `add` is quick, `readings` works it out."""

    setup: Setup
    _camera: list[tuple[int, float, float, float]] = field(default_factory=list)
    _probes: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)
    _saturated: int = 0
    _lowest_k: float = math.inf

    def __post_init__(self) -> None:
        rows, cols = self.setup.camera.shape
        regions = (self.setup.sample, self.setup.foil, self.setup.tape)
        self._masks = [None if region is None else region.mask((rows, cols)) for region in regions]

    def add(self, sample: Sample) -> None:
        """Take a sample of any stream; those that are not usable are skipped."""
        if not is_usable(sample.quality):
            return
        probe = self.setup.thermometer
        if isinstance(sample, Frame):
            if sample.stream == self.setup.camera.name:
                self._add_frame(sample)
        elif probe is not None and sample.stream == probe.name:
            self._probes.append((sample.time_ns, sample.values))

    def _add_frame(self, frame: Frame) -> None:
        info = self.setup.camera
        kelvin = frame_k(info, frame.counts, frame.metadata_rows)
        means = [float("nan") if mask is None else float(kelvin[mask].mean()) for mask in self._masks]
        self._camera.append((frame.time_ns, *means))  # type: ignore[arg-type]
        foil = self._masks[1]
        if foil is not None and is_saturated(frame.counts[foil]):
            self._saturated += 1
            self._lowest_k = min(self._lowest_k, float(kelvin[foil].min()))

    @property
    def pictures(self) -> int:
        """Pictures that count."""
        return len(self._camera)

    def readings(self) -> Readings:
        """Camera and thermometer in kelvin, the camera's own settings and the air taken out.

        Raises `CalibrationError` for a saturated foil, or without pictures or probe readings.
        """
        setup = self.setup
        refuse_saturated(len(self._camera), self._saturated, self._lowest_k)
        if not self._camera or (setup.thermometer is not None and not self._probes):
            raise CalibrationError(
                f"no usable {'pictures' if not self._camera else 'thermometer readings'}",
                fix="fieldkit check says why samples are in doubt",
            )
        times = np.array([row[0] for row in self._camera], np.int64)
        table = np.array([row[1:] for row in self._camera], np.float64).T
        apparent, foil, tape = (self._at_surface(column) for column in table)
        # a foil on the surface is about as warm as that, and emits a few hundredths itself
        reflected = (
            np.full(times.size, setup.reflected_k)
            if setup.foil is None
            else mirrored_temperature_k(foil, apparent, setup.foil_emissivity, setup.band)
        )
        if setup.tape is not None:
            contact = tape_temperature_k(tape, setup.tape_emissivity, reflected, setup.band)
            return Readings(times, apparent, reflected, times, contact)
        probe_ns = np.array([time_ns for time_ns, _ in self._probes], np.int64)
        return Readings(times, apparent, reflected, probe_ns, self.probes_k()[:, setup.channel])

    def probes_k(self) -> FloatArray:
        """All probes, (m, channels), kelvin."""
        values = np.array([row for _, row in self._probes], np.float64)
        assert self.setup.thermometer is not None
        zero = 0.0 if self.setup.thermometer.unit == "K" else CELSIUS_ZERO_K
        kelvin = values + zero
        return (kelvin - CELSIUS_ZERO_K - 32.0) / 1.8 + CELSIUS_ZERO_K if self.setup.fahrenheit else kelvin

    def other_probes_k(self) -> dict[str, FloatArray]:
        """The probes that were not chosen, by name, without those that are open."""
        setup = self.setup
        if setup.thermometer is None:
            return {}
        probes = self.probes_k()
        return {
            name: probes[:, number]
            for number, name in enumerate(setup.channel_names)
            if number != setup.channel and np.isfinite(probes[:, number]).any()
        }

    def _at_surface(self, seen_k: FloatArray) -> FloatArray:
        setup, known = self.setup, np.array(seen_k)
        if setup.camera_emissivity != 1.0:
            known = before_camera_settings(
                known, setup.camera_emissivity, setup.camera_reflected_k, setup.band
            )
        if setup.distance_m > 0.0:
            through = transmission(setup.distance_m, setup.air_k, setup.humidity)
            known = without_air(known, through, setup.air_k, setup.band)
        return known
