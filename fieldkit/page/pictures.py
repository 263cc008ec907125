"""Frames as messages for browsers: 8-bit JPEG for the eye, or every count without loss.

A picture is a 16-bit length (little-endian), a JSON header and a body. Browsers colour it themselves, which
takes a tenth of the traffic of a coloured and enlarged image.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Any, Literal

import numpy as np

from fieldkit.model.arrays import CountArray, FloatArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.views import frame_image

Mode = Literal["jpeg", "exact", "off"]
JPEG_QUALITY = 80
THUMBNAIL_COLS = 160
ENDS = (0.1, 99.9)
"""Percentiles between which grey levels lie: a defect pixel must not take all of them."""
NARROWEST = 2.0
"""Least span of the grey levels, in °C or counts."""


def picture(frame: Frame, info: StreamInfo, mode: Mode, seq: int) -> bytes:
    """A frame as a message; `seq` counts the pictures of a stream, so that browsers see what was skipped."""
    values = frame_image.values(frame, info)
    origin = {"seq": seq, "stream": frame.stream, "time_ms": frame.time_ns // 1000 / 1000}
    header = _header(values, mode, frame_image.unit(info), **origin)
    if mode == "jpeg":
        return _message(header, _jpeg(values, header))
    counts, scale, offset = _linear(frame.counts, values, info)
    return _message({**header, "scale": scale, "offset": offset}, _exact(counts))


def thumbnail(kelvin: FloatArray) -> bytes:
    """A frame of a past session in few bytes, `THUMBNAIL_COLS` pixels wide at most."""
    rows, cols = kelvin.shape
    smaller = min(1.0, THUMBNAIL_COLS / cols)
    values = frame_image.resize(kelvin - CELSIUS_ZERO_K, round(rows * smaller), round(cols * smaller))
    header = _header(values, "jpeg", "°C")
    return _message(header, _jpeg(values, header))


def still(kelvin: FloatArray) -> bytes:
    """A frame of a past session, as an exact picture; its time is no longer of interest."""
    values = kelvin - CELSIUS_ZERO_K
    whole = {"seq": 0, "stream": "", "time_ms": None, "scale": 0.01, "offset": -CELSIUS_ZERO_K}
    return _message(_header(values, "exact", "°C", **whole), _exact(_hundredths(values)))


def _header(values: FloatArray, mode: Mode, unit: str, **more: Any) -> dict[str, Any]:
    (rows, cols), (low, high) = values.shape, _ends(values)
    return {"rows": rows, "cols": cols, "mode": mode, "unit": unit, "low_c": low, "high_c": high, **more}


def _message(header: dict[str, Any], body: bytes) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<H", len(text)) + text + body


def _ends(values: FloatArray) -> tuple[float, float]:
    """Whole values around nearly all of a frame: they change less often than its extremes."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, NARROWEST
    low, high = (float(value) for value in np.percentile(finite, ENDS))
    return math.floor(low), max(math.ceil(high), math.floor(low) + NARROWEST)


def _jpeg(values: FloatArray, header: dict[str, Any]) -> bytes:
    import cv2

    low, high = header["low_c"], header["high_c"]
    grey = np.nan_to_num(np.clip((values - low) * (255.0 / (high - low)), 0.0, 255.0))
    ok, data = cv2.imencode(".jpg", np.rint(grey).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert ok
    return data.tobytes()


def _linear(counts: CountArray, values: FloatArray, info: StreamInfo) -> tuple[CountArray, float, float]:
    """Counts with the scale and offset that turn them into °C (or leave them counts).

    A camera of another law has none: its temperatures become counts of a hundredth of a kelvin.
    """
    if frame_image.unit(info) == "counts":
        return counts, 1.0, 0.0
    if info.law == "linear":
        return counts, info.scale, info.offset - CELSIUS_ZERO_K
    return _hundredths(values), 0.01, -CELSIUS_ZERO_K


def _hundredths(values: FloatArray) -> CountArray:
    """Degrees Celsius as hundredths of a kelvin."""
    kelvin = np.nan_to_num(values + CELSIUS_ZERO_K)
    return np.clip(np.rint(kelvin * 100.0), 0, 65_535).astype(np.uint16)


def _exact(counts: CountArray) -> bytes:
    """Each row as its first count and the differences to the left neighbour (16 bits), deflated."""
    differences = np.diff(counts.astype(np.uint16), axis=1, prepend=np.uint16(0))
    return zlib.compress(differences.astype("<u2").tobytes(), level=1)
