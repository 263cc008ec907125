"""Which stream serves for what, and what the readings of a minute amount to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.device import StreamInfo
from fieldkit.estimation.bins import OpenMinute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.facet import VERTICAL, FloatArray, normal
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.samples import Quality, Reading, is_usable
from fieldkit.site import Site


@dataclass(frozen=True, slots=True)
class Light:
    """Light readings of one minute in order of time: beam, and reading over its clear expectation.

    `clearness` is NaN while the sun is low.
    """

    readings: list[Reading]
    direct_w_m2: FloatArray
    clearness: FloatArray
    illuminance_lx: float
    flags: Quality


class Instruments:
    """Which stream serves for what."""

    def __init__(self, streams: Sequence[StreamInfo], model: IrradianceModel) -> None:
        self._streams = {info.name: info for info in streams}
        pictures = [s for s in streams if s.is_camera and s.quantity == "brightness_temperature"]
        self.camera = pictures[0] if pictures else None
        lux, beam = self._first("illuminance"), self._first("irradiance")
        self.lux = lux
        self.model = (
            model if lux is not None and not model.is_direct else IrradianceModel(kind="pyrheliometer")
        )
        if model.is_direct:
            self.model = model
        self.light_stream = beam if self.model.is_direct else lux

    def _first(self, quantity: str) -> StreamInfo | None:
        return next((info for info in self._streams.values() if info.quantity == quantity), None)

    def light(self, minute: OpenMinute, site: Site, settings: EstimatorSettings) -> Light:
        """Direct irradiance of every light reading at its own time."""
        lux = (
            [r.values[0] for r in minute.sorted_readings(self.lux.name) if is_usable(r.quality)]
            if self.lux
            else []
        )
        name = self.light_stream.name if self.light_stream is not None else ""
        readings = minute.sorted_readings(name)
        flags = Quality.GOOD
        for reading in readings:
            flags |= reading.quality
        times = np.array([reading.time_ns for reading in readings], np.int64)
        sun = sun_vectors(times, site, refraction=settings.refraction)
        values = np.array([r.values[0] if is_usable(r.quality) else np.nan for r in readings], np.float64)
        direct = direct_normal(self.model, values, sun, times) if len(readings) else values
        # near the horizon clear light itself changes as fast as a cloud does
        high = sun.reshape(-1, 3)[:, 2] >= np.sin(np.radians(settings.low_sun_deg))
        clearness = np.where(high, self._clearness(values, sun), np.nan)
        return Light(readings, direct, clearness, mean_of(np.array(lux)), flags)

    def _clearness(self, values: FloatArray, sun: FloatArray) -> FloatArray:
        """Readings over the cosine of the sun on the meter's plane, NaN for a grazing sun."""
        if self.model.is_direct or self.model.mounting == "sun-pointing":
            return values
        facet = VERTICAL
        if self.model.mounting == "in-plane":
            facet = normal(self.model.plane_tilt_deg, self.model.plane_azimuth_deg)
        cosine = sun.reshape(-1, 3) @ facet
        return np.asarray(values / np.where(cosine > 0.1, cosine, np.nan))

    def mean(self, minute: OpenMinute, quantity: str) -> float:
        """Mean of the first stream of a quantity, NaN without one."""
        info = self._first(quantity)
        if info is None:
            return float("nan")
        return mean_of(
            np.array([r.values[0] for r in minute.sorted_readings(info.name) if is_usable(r.quality)])
        )

    def contact_k(self, minute: OpenMinute) -> tuple[float, ...]:
        """Mean of each channel of all contact thermometers, kelvin."""
        means: list[float] = []
        for info in self._streams.values():
            if info.quantity != "temperature":
                continue
            table = np.full((0, info.shape[0]), np.nan)
            if rows := [r.values for r in _usable(minute, info)]:
                table = np.array(rows, np.float64)
            zero = 0.0 if info.unit == "K" else 273.15
            means.extend(mean_of(table[:, channel]) + zero for channel in range(table.shape[1]))
        return tuple(means)


def _usable(minute: OpenMinute, info: StreamInfo) -> list[Reading]:
    return [reading for reading in minute.sorted_readings(info.name) if is_usable(reading.quality)]


def mean_of(values: NDArray[np.float64]) -> float:
    """Mean of what is finite, NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
