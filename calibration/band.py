"""Response of a camera's band to a black surface: flat 8-14 micrometres, a measured response, or R, B, F, O.

An emissivity is a ratio of differences of band signals, so only the shape of the band matters: a factor and
an offset (a FLIR camera's R and O) cancel. Kelvin; signals in a unit of the band's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.text_file import read_text
from fieldkit.physics.camera_laws import Planck, path_transmission
from fieldkit.physics.constants import SECOND_RADIATION
from fieldkit.physics.radiance import band_radiance, band_temperature


class Band(Protocol):
    """Conversion between temperature and signal of a black surface."""

    @property
    def label(self) -> str:
        """Name of the band in a record."""

    def signal(self, temperature_k: ArrayLike) -> FloatArray:
        """Signal of a black surface at a temperature [K], same shape."""

    def temperature(self, signal: ArrayLike) -> FloatArray:
        """Temperature of a black surface with a signal, kelvin, same shape."""


@dataclass(frozen=True, slots=True)
class FlatBand:
    """Planck's law over 8-14 micrometres with a flat response."""

    label: str = "8-14 um, flat"

    def signal(self, temperature_k: ArrayLike) -> FloatArray:
        """Exitance within the band, W/m2."""
        return band_radiance(temperature_k)

    def temperature(self, signal: ArrayLike) -> FloatArray:
        """See `Band`."""
        return band_temperature(signal)


FLAT = FlatBand()


@dataclass(frozen=True, slots=True)
class CameraBand:
    """Law of a FLIR camera, ``R / (exp(B/T) - F) - O``."""

    b: float
    f: float = 1.0
    r: float = 1.0
    o: float = 0.0

    @property
    def label(self) -> str:
        """See `Band`."""
        return f"camera, B {self.b:g} K, F {self.f:g}"

    def signal(self, temperature_k: ArrayLike) -> FloatArray:
        """Counts of a black surface."""
        return np.asarray(self.r / (np.exp(self.b / np.asarray(temperature_k, np.float64)) - self.f) - self.o)

    def temperature(self, signal: ArrayLike) -> FloatArray:
        """See `Band`."""
        return np.asarray(self.b / np.log(self.r / (np.asarray(signal, np.float64) + self.o) + self.f))


class ResponseBand:
    """Planck's law weighted with a response at wavelengths (n,) in micrometres, linear in between."""

    def __init__(self, wavelength_um: ArrayLike, response: ArrayLike, label: str = "given response") -> None:
        wavelength, weight = np.asarray(wavelength_um, np.float64), np.asarray(response, np.float64)
        if wavelength.size < 2 or not (np.diff(wavelength, prepend=0.0) > 0.0).all():
            raise ConfigError("a response needs two or more increasing wavelengths in micrometres")
        if not ((weight >= 0.0) & np.isfinite(weight)).all() or not np.any(weight > 0.0):
            raise ConfigError("a response must be finite numbers of 0 or more, not zero everywhere")
        self.label = label
        fine = np.linspace(wavelength[0], wavelength[-1], 600)
        self._temperatures = np.arange(150.0, 500.0, 0.25)
        grid = 1e6 * SECOND_RADIATION / np.outer(self._temperatures, fine)
        spectral = np.interp(fine, wavelength, weight) / fine**5 / np.expm1(grid)
        self._signals = np.trapezoid(spectral, fine, axis=1)

    @classmethod
    def read(cls, path: Path) -> ResponseBand:
        """Read a table of wavelength in micrometres and response, comma-separated, with or without header.

        Raises `ConfigError`.
        """
        lines = read_text(path).splitlines()
        try:
            text = [line for line in lines if line[:1].isdigit()]
            table = np.array([[float(cell) for cell in line.split(",")[:2]] for line in text])
            return cls(table[:, 0], table[:, 1], f"response {path.name}")
        except (ValueError, IndexError) as error:
            problem, fix = "not a table of wavelength and response", "write two columns: micrometres,response"
            raise ConfigError(problem, place=path, fix=fix) from error

    def signal(self, temperature_k: ArrayLike) -> FloatArray:
        """See `Band`; NaN outside 150-500 K."""
        kelvin = np.asarray(temperature_k, np.float64)
        return np.asarray(np.interp(kelvin, self._temperatures, self._signals, np.nan, np.nan))

    def temperature(self, signal: ArrayLike) -> FloatArray:
        """See `Band`."""
        level = np.asarray(signal, np.float64)
        return np.asarray(np.interp(level, self._signals, self._temperatures, np.nan, np.nan))


def before_camera_settings(
    reported_k: ArrayLike, emissivity: float, reflected_k: float, band: Band = FLAT
) -> FloatArray:
    """Brightness temperature of what a camera reports, without the settings it has applied, kelvin.

    Any shape; the settings are an emissivity in (0, 1] and a reflected temperature in kelvin.
    """
    signal = emissivity * band.signal(reported_k) + (1.0 - emissivity) * band.signal(reflected_k)
    return band.temperature(signal)


def transmission(distance_m: float, air_k: float, humidity: float) -> float:
    """Transmission of the band through `distance_m` of air at `air_k` and a relative humidity from 0 to 1.

    The law of FLIR cameras: W. Minkina and S. Dudzik, Infrared Thermography: Errors and Uncertainties, Wiley,
    2009.
    """
    # the law is written for half of a path with a window in its middle
    path = Planck(1.0, 1.0, 1.0, 0.0, distance_m=2.0 * distance_m, air_k=air_k, humidity=humidity)
    return path_transmission(path)


def own_part_k(seen_k: ArrayLike, share: float, rest_k: ArrayLike, band: Band = FLAT) -> FloatArray:
    """Temperature of a surface that is a part of what is seen: through air, or under a tape that reflects.

    `seen_k` are brightness temperatures at the camera, any shape; `share`, in (0, 1], is that of the
    surface's own signal: `transmission` of the air, emissivity of the tape; `rest_k` is the temperature of
    the rest: of the air along the path, of what the tape reflects. Same shape, kelvin.
    """
    own = band.signal(seen_k) - (1.0 - share) * band.signal(rest_k)
    return band.temperature(own / share)
