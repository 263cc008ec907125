"""Pictures ``.irg`` of InfiRay's hand-held cameras and their brandings.

A little-endian header that tells its own length and ends in ``ac ca``; the picture to look at, a byte
a pixel; the same picture as 16-bit temperatures; then what the model adds. Three public readers agree
on that (jaseg/infiray_irg, jelle737/Vevor-Thermal-Utilities, povlhp/irgdump). On what a count means
they agree for headers that begin ``ba ab`` or ``b0 0b``: a tenth of a kelvin. Those that begin
``ca ac`` hold sixteenths or tenths, by the model, which the file does not name.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import ConfigError

_KELVIN_PER_COUNT = {b"\xba\xab": 0.1, b"\xb0\x0b": 0.1, b"\xca\xac": float("nan")}
_END_MARK = b"\xac\xca"
_HEAD = struct.Struct("<2sHIHH")
_EMISSIVITY_AT, _SHORTEST_HEADER = 0x1E, 0x22
_MOST_PIXELS = 1 << 22


@dataclass(frozen=True, slots=True)
class IrgPicture:
    """Counts (rows, cols), kelvin per count (NaN where the file does not tell), the camera's emissivity."""

    counts: NDArray[np.uint16]
    kelvin_per_count: float
    emissivity: float


def read_irg(path: Path) -> IrgPicture:
    """One picture; raises `ConfigError` where the file is none, or is cut short."""
    try:
        with path.open("rb") as file:
            data = file.read(0x10000 + 3 * _MOST_PIXELS)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}", fix="check the path") from error
    if len(data) < _HEAD.size or data[:2] not in _KELVIN_PER_COUNT:
        raise _refusal(path, "it does not begin as one")
    magic, length, preview, rows, cols = _HEAD.unpack_from(data)
    if length < _SHORTEST_HEADER or data[length - 2 : length] != _END_MARK:
        raise _refusal(path, "its header does not end as one")
    if not 0 < rows * cols == preview <= _MOST_PIXELS or len(data) < length + 3 * preview:
        raise _refusal(path, f"{rows} x {cols} pixels are not in it")
    counts = np.frombuffer(data, "<u2", rows * cols, length + preview).reshape(rows, cols)
    (emissivity,) = struct.unpack_from("<I", data, _EMISSIVITY_AT)
    return IrgPicture(counts.astype(np.uint16), _KELVIN_PER_COUNT[magic], emissivity / 1e4)


def _refusal(path: Path, why: str) -> ConfigError:
    return ConfigError(
        f"{path} is no .irg picture that fieldkit knows: {why}",
        fix="export it from the camera's program as 16-bit TIFF, and import that",
    )
