"""What one buffer of a camera means, before the session's clock and the pictures around it are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from fieldkit.drivers.records import Decoded, Rejected, Value
from fieldkit.model.samples import NO_COUNTER, Quality
from fieldkit.physics.camera_laws import temperature_k

PLAUSIBLE_K = (200.0, 700.0)
"""Scenes outside are a wrong scale, not weather."""

_GOOD, _SATURATED, _NO_VALUE = Quality.GOOD, Quality.SATURATED, Quality.NO_VALUE
"""By plain names: looking them up in their class takes as long as finding them."""

NO_ROWS = np.empty((0, 0), np.uint16)
_NEW: Any = None  # for OpenCV to make; its type hints want an array
_WORD = np.dtype("<u2")  # made once: reading its name takes as long as finding a row


class Picture(NamedTuple):
    """One picture as its bytes alone tell it; a tuple, because one is made for every frame.

    `extremes` are the coldest and the hottest of the counts. Kelvin are ``counts * scale + offset`` if `law`
    is linear; `scale` is NaN where they are not, or unknown.
    `shutter` is whether a correction runs or has just run, None where the camera does not tell.
    """

    counts: NDArray[np.uint16]
    extremes: tuple[float, float]
    metadata_rows: NDArray[np.uint16] = NO_ROWS
    scale: float = math.nan
    offset: float = 0.0
    law: str = "linear"
    quality: Quality = Quality.GOOD
    shutter: bool | None = None
    device_time: int = NO_COUNTER
    device_seq: int = NO_COUNTER
    fpa_temperature_k: float = math.nan
    housing_temperature_k: float = math.nan
    gain: str = ""


Decode = Callable[[bytes], Picture | Rejected]


def words(data: bytes, shape: tuple[int, int], start: int = 0) -> NDArray[np.uint16]:
    """Bytes from `start`, at least as many as that shape needs, as little-endian words, without copying."""
    return np.ndarray(shape, _WORD, data, start)


def extremes(counts: NDArray[np.uint16]) -> tuple[float, float]:
    """Coldest and hottest pixel; OpenCV finds both in one pass, numpy in two."""
    coldest, hottest, _, _ = cv2.minMaxLoc(counts)
    return coldest, hottest


def doubts(
    extremes: tuple[float, float], ends: tuple[int, int], scale: float = math.nan, offset: float = 0.0
) -> Quality:
    """`SATURATED` with a pixel at either end of what the camera can count, `NO_VALUE` without a scene.

    A scale that puts even the warmest pixel below, or the coldest above, anything on this Earth is wrong.
    """
    coldest, hottest = extremes
    low, high = PLAUSIBLE_K
    is_scene = hottest * scale + offset >= low and coldest * scale + offset <= high  # NaN is in no range
    if coldest > ends[0] and hottest < ends[1]:
        return _GOOD if is_scene else _NO_VALUE
    return _SATURATED if is_scene else _SATURATED | _NO_VALUE


def decode_frames(data: bytes, decode: Decode, lengths: tuple[int, ...]) -> Decoded:
    """Explain a file or line of hex as pictures of one length.

    `lengths` are those the family has; the one that divides the data is taken, the longest that
    fits otherwise, and what else it could be is noted. A picture becomes its minimum, mean and maximum.
    """
    length = _frame_length(len(data), lengths)
    whole = len(data) // length * length if length else 0
    values: list[Value] = []
    rejected: list[Rejected] = []
    notes: list[str] = []
    for start in range(0, whole, length or 1):
        picture = decode(data[start : start + length])
        if isinstance(picture, Rejected):
            rejected.append(Rejected(length, picture.reason, start))
        else:
            values.extend(summary(picture))
            notes.append(_note(picture))
    notes += _other_readings(len(data), length, lengths)
    return Decoded(tuple(values), tuple(rejected), len(data) - whole, tuple(notes))


def _other_readings(size: int, length: int, lengths: tuple[int, ...]) -> list[str]:
    """What else so many bytes could be, or what they would have to be."""
    if not size:
        return []
    if not length or size % length:
        sizes = " or ".join(str(one) for one in sorted(lengths))
        return [f"a picture of this family has {sizes} bytes"]
    others = [one for one in sorted(lengths) if one != length and size % one == 0]
    return [f"could also be {size // one} pictures of {one} bytes; cut the file to tell" for one in others]


def _note(picture: Picture) -> str:
    height, width = picture.counts.shape
    parts = [f"picture of {width}x{height}"]
    if picture.gain:
        parts.append(f"gain {picture.gain}")
    if picture.device_seq != NO_COUNTER:
        parts.append(f"counter {picture.device_seq}")
    return ", ".join(parts)


def _frame_length(size: int, lengths: tuple[int, ...]) -> int:
    dividing = [length for length in lengths if size and size % length == 0]
    fitting = [length for length in lengths if length <= size]
    return max(dividing, default=max(fitting, default=0))


def summary(picture: Picture) -> list[Value]:
    """Minimum, mean and maximum in kelvin, in counts where no temperature is known, and the sensor's own."""
    quality = picture.quality | (Quality.SHUTTER if picture.shutter else Quality.GOOD)
    known = picture.law != "linear" or not math.isnan(picture.scale)
    unit = "K" if known else "counts"
    image = kelvin(picture) if known else picture.counts
    figures = {"minimum": image.min(), "mean": image.mean(dtype=np.float64), "maximum": image.max()}
    values = [Value(float(figure), unit, name, quality) for name, figure in figures.items()]
    sensors = {"fpa": picture.fpa_temperature_k, "housing": picture.housing_temperature_k}
    values += [Value(number, "K", name) for name, number in sensors.items() if not math.isnan(number)]
    return values


def kelvin(picture: Picture) -> NDArray[np.float32]:
    """Brightness temperature of a picture, float32.

    OpenCV converts and scales in one pass where numpy needs two, but only to a largest value that is told.
    """
    if picture.law != "linear":
        return temperature_k(picture.law, picture.counts, picture.metadata_rows, {})
    hottest_k = picture.extremes[1] * picture.scale
    made = cv2.normalize(picture.counts, _NEW, hottest_k, 0.0, cv2.NORM_INF, cv2.CV_32F)
    image = cast("NDArray[np.float32]", made)
    if picture.offset:
        image += picture.offset
    return image
