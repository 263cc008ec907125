"""From camera counts to brightness temperature, for cameras whose law is more than a factor.

A stream names its law (`StreamInfo.law`), which is in `LAWS`. A law takes the counts, the
metadata rows of the same frame and the stream's settings, and returns kelvin for emissivity 1 in single
precision. Look-up tables are cached by their parameters. ``linear`` is counts x scale + offset.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray, FloatArray, SingleArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.units import CELSIUS_ZERO_K

Law = Callable[[CountArray, CountArray, Mapping[str, Any]], SingleArray]

NO_VALUE = "no_value_count"
"""Key of a stream's settings: the count of a pixel that has no value, in frames of other programs."""
HT301_COUNTS = 0x3FFF
"""The highest count: fourteen of the sixteen bits."""


def law_named(name: str) -> Law:
    """A key of `LAWS` as what it is; raises `ValueError` if the law is unknown."""
    if name not in LAWS:
        raise ValueError(f"unknown camera law {name!r}; known laws: linear, {', '.join(LAWS)}")
    return LAWS[name]


def has_temperatures(info: StreamInfo) -> bool:
    """True if counts can be converted to kelvin: the law is known and, if linear, its scale is finite."""
    return math.isfinite(info.scale) if info.law == "linear" else info.law in LAWS


def frame_k(
    info: StreamInfo,
    counts: CountArray,
    metadata_rows: CountArray,
    dtype: type[np.floating[Any]] = np.float64,
) -> AnyArray:
    """Brightness temperature of one frame of a camera's stream, or of some of its pixels.

    Parameters
    ----------
    info
        The stream, with its law, scale and settings.
    counts
        Raw counts, any shape.
    metadata_rows
        Rows that the camera sent with the frame, shape (rows, cols).
    dtype
        Precision of the result; single precision is good to 3e-5 K.

    Returns
    -------
    Shape of `counts`, for emissivity 1; NaN where law or scale is unknown or has no solution. [K]
    """
    if not has_temperatures(info):
        return np.full(counts.shape, np.nan, dtype)
    if info.law == "linear":
        kelvin = linear(counts, info.scale, info.offset, dtype)
        if NO_VALUE in info.settings:
            kelvin[counts == info.settings[NO_VALUE]] = np.nan
        return kelvin
    try:
        return LAWS[info.law](counts, metadata_rows, info.settings).astype(dtype, copy=False)
    except (ValueError, TypeError, LookupError, ArithmeticError):  # constants or metadata rows of another law
        return np.full(counts.shape, np.nan, dtype)


def needs_metadata_rows(info: StreamInfo) -> bool:
    """True if the parameters of the camera's law come with each frame, in its metadata rows."""
    return info.law == "ht301"


def frames_k(info: StreamInfo, counts: CountArray, metadata_rows: CountArray) -> FloatArray:
    """Brightness temperature of several frames, counts (n, ...) with metadata rows (n, rows, cols); see
    `frame_k`.
    """
    if not needs_metadata_rows(info):
        return frame_k(info, counts, metadata_rows[:0])
    frames = [frame_k(info, *frame) for frame in zip(counts, metadata_rows, strict=True)]
    return np.array(frames, np.float64).reshape(counts.shape)


def linear(
    counts: CountArray, scale: float, offset: float = 0.0, dtype: type[np.floating[Any]] = np.float32
) -> AnyArray:
    """Counts x scale + offset, of any shape; in kelvin; single precision is good to 3e-5 K."""
    kelvin = counts.astype(dtype)  # then in place: half the time of multiplying mixed types
    kelvin *= scale
    if offset:
        kelvin += offset
    return kelvin


@dataclass(frozen=True, slots=True)
class Ht301Parameters:
    """Parameters of the HT-301 law from the metadata rows of one frame; temperatures in °C."""

    width: int
    cal_00: int
    fpa_raw: int
    shutter_c: float
    c1: float
    c2: float
    c3: float
    c4: float
    c5: float


_HT301_FPA = {640: (6867.0, 33.8), 384: (7800.0, 36.0), 256: (8617.0, 37.682), 240: (7800.0, 36.0)}
"""Width: a, b of ``t_fpa = 20 - (raw - a) / b``."""


def ht301_area(width: int) -> int:
    """First word of the calibration area in the metadata rows, counted from their first word."""
    return 3 * width if width in (384, 640) else width


def ht301_parameters(metadata_rows: CountArray) -> Ht301Parameters:
    """Parse the parameters of a frame from the four rows below the image, shape (4, width).

    Raises `ValueError` if the width is none of 640, 384, 256, 240 or there are fewer than four rows.
    """
    rows, width = metadata_rows.shape
    if width not in _HT301_FPA or rows < 4:
        raise ValueError(f"no metadata of the HT-301 family: {rows} rows of {width}")
    words = np.ascontiguousarray(metadata_rows).ravel()
    area = ht301_area(width)
    coefficients = words[area + 3 : area + 13].view("<f4").tolist()
    shutter_c = float(words[area + 1]) / 10 - CELSIUS_ZERO_K
    return Ht301Parameters(width, int(words[area]), int(words[1]), shutter_c, *coefficients)


def ht301_fpa_c(width: int, fpa_raw: int) -> float:
    """Temperature of the sensor in °C from its raw word."""
    a, b = _HT301_FPA[width]
    return 20.0 - (fpa_raw - a) / b


@lru_cache(maxsize=4)
def ht301_curve(parameters: Ht301Parameters) -> tuple[float, float, float]:
    """Coefficients (a, b, c) of ``T = sqrt(a x + b) + c`` for counts x, T in kelvin.

    They are not finite where the metadata rows are implausible. The published form is
    ``T0 = sqrt(((x - off) g + s) / c1 + q) - p`` with ``p = c2 / 2 c1``, ``q = p^2``,
    ``s = c1 ts^2 + c2 ts``, ``g = c3 tf^2 + c4 tf + c5``, in °C. Two public programs for the -20 to 120 °C
    range agree on it. The upper range of the camera is disputed and not covered.
    """
    t_fpa, t_shutter = ht301_fpa_c(parameters.width, parameters.fpa_raw), parameters.shutter_c
    offset = parameters.cal_00 - (170 if parameters.width == 256 else max(0, int(390 - 7.05 * t_fpa)))
    if parameters.c1 == 0:
        return math.nan, math.nan, math.nan
    p = parameters.c2 / (2 * parameters.c1)
    s = parameters.c1 * t_shutter**2 + parameters.c2 * t_shutter
    g = parameters.c3 * t_fpa**2 + parameters.c4 * t_fpa + parameters.c5
    return g / parameters.c1, (s - offset * g) / parameters.c1 + p * p, CELSIUS_ZERO_K - p


def ht301(counts: CountArray, metadata_rows: CountArray, settings: Mapping[str, Any]) -> SingleArray:
    """Law of the HT-301, T3S, T2S+ and T2L; its parameters come with every frame, in metadata rows (4,
    width), K.

    Raises `ValueError` if the metadata rows are not those of this family.
    """
    a, b, c = ht301_curve(ht301_parameters(metadata_rows))
    with np.errstate(all="ignore"):
        kelvin = counts.astype(np.float32)
        kelvin *= np.float32(a)
        kelvin += np.float32(b)
        np.sqrt(kelvin, out=kelvin)
        kelvin += np.float32(c)
    return kelvin


@dataclass(frozen=True, slots=True)
class Planck:
    """Constants of a FLIR camera's Planck law, and the path between object and camera.

    Temperatures in kelvin, `distance_m` in metres, `humidity` a fraction. The object's own emissivity
    is 1 here when brightness temperature is wanted.
    """

    r1: float
    b: float
    f: float
    o: float
    r2: float = 1.0
    emissivity: float = 1.0
    distance_m: float = 0.0
    reflected_k: float = 293.15
    air_k: float = 293.15
    window_k: float = 293.15
    window_transmission: float = 1.0
    humidity: float = 0.5
    alpha1: float = 0.006569
    alpha2: float = 0.01262
    beta1: float = -0.002276
    beta2: float = -0.00667
    x: float = 1.9


def planck_counts(temperature_k: float, constants: Planck) -> float:
    """Counts of a black body, ``S = R1 / (R2 (exp(B/T) - F)) - O``, not rounded."""
    return constants.r1 / (constants.r2 * (math.exp(constants.b / temperature_k) - constants.f)) - constants.o


def path_transmission(constants: Planck) -> float:
    """Transmission of one half of the path, 1 at no distance; the window, if any, is in its middle."""
    air_c = constants.air_k - CELSIUS_ZERO_K
    saturation = math.exp(1.5587 + 0.06939 * air_c - 0.00027816 * air_c**2 + 6.8455e-7 * air_c**3)
    water = constants.humidity * saturation
    root, depth = math.sqrt(water), math.sqrt(constants.distance_m / 2)
    first = math.exp(-depth * (constants.alpha1 + constants.beta1 * root))
    second = math.exp(-depth * (constants.alpha2 + constants.beta2 * root))
    return constants.x * first + (1 - constants.x) * second


def _object_counts(constants: Planck) -> tuple[float, float]:
    """(gain, offset) with ``S_object = gain S + offset``: reflection, air and window taken out."""
    e, tau, window = constants.emissivity, path_transmission(constants), constants.window_transmission
    air = planck_counts(constants.air_k, constants)
    offset = (
        -(1 - e) / e * planck_counts(constants.reflected_k, constants)
        - (1 - tau) / (e * tau) * air
        - (1 - window) / (e * tau * window) * planck_counts(constants.window_k, constants)
        - (1 - tau) / (e * tau**2 * window) * air
    )
    return 1 / (e * tau**2 * window), offset


@lru_cache(maxsize=4)
def planck_table(constants: Planck) -> SingleArray:
    """Kelvin of all 65536 counts, ``T = B / ln(R1 / (R2 (S + O)) + F)``; NaN without a solution."""
    gain, offset = _object_counts(constants)
    with np.errstate(all="ignore"):
        counts = np.arange(0x10000) * gain + offset
        kelvin = constants.b / np.log(constants.r1 / (constants.r2 * (counts + constants.o)) + constants.f)
    table: SingleArray = kelvin.astype(np.float32)
    table[~np.isfinite(table) | (table <= 0)] = np.nan
    return table


def planck(counts: CountArray, metadata_rows: CountArray, settings: Mapping[str, Any]) -> SingleArray:
    """Law of FLIR files; `settings` holds the fields of `Planck` by name."""
    names = {field.name for field in fields(Planck)}
    constants = Planck(**{key: float(value) for key, value in settings.items() if key in names})
    return planck_k(counts, constants)


def planck_k(counts: CountArray, constants: Planck) -> SingleArray:
    """Kelvin of counts of any shape by the constants of a FLIR file; NaN without a solution."""
    import cv2  # numpy's take needs five times as long

    if counts.size == 0:
        return np.empty(counts.shape, np.float32)
    # rows and columns only: more axes would be channels
    flat = np.ascontiguousarray(counts, np.uint16).reshape(-1, counts.shape[-1] if counts.ndim else 1)
    return np.asarray(cv2.LUT(flat, planck_table(constants)), np.float32).reshape(counts.shape)


LAWS: Mapping[str, Law] = MappingProxyType({"ht301": ht301, "planck": planck})
"""Every law but the linear one, by the name a stream gives."""
