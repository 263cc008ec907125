"""What a PureThermal board says besides pictures: telemetry rows and extension-unit controls.

Written from the same published layout as the driver, in the other direction: word numbers
count through both rows below a 160x120 picture, controls are (unit, selector).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from fieldkit.drivers.simulated.shutter import AUTOMATIC_NS, State
from fieldkit.model.errors import DeviceError

SERIAL = 0x00A1_0F1E_1D00_0001
RUN_FFC, RUN_RADIOMETRIC_FFC = (6, 17), (5, 12)
FFC_MODE = (6, 16)
UPTIME, HOUSING, FPA, FFC_STATUS, FFC_STATE = (6, 4), (6, 5), (6, 6), (6, 18), (6, 20)
_GAIN = (6, 19)
_FLUX, _TLINEAR, _RESOLUTION = (0x15, 17), (0x15, 18), (0x15, 19)
_SETTABLE = (FFC_MODE, _RESOLUTION)
_REVISION = 14
_COUNTS_PER_KELVIN = (10, 100)


@dataclass(frozen=True, slots=True)
class Vitals:
    """How the board is at one time."""

    uptime_ms: int
    frame_counter: int
    state: State
    corrected_ms: int
    fpa_k: float
    housing_k: float


class Board:
    """Controls as the board would keep them, and the telemetry that reports them."""

    def __init__(self) -> None:
        automatic, never_freeze, imminent = 1, 0, 150 | 52 << 16  # 1.5 K of drift, 52 frames ahead
        self._controls = {
            (4, 8): b"500-0771-01".ljust(32, b"\0"),
            (4, 9): bytes((3, 3, 26, 3, 3, 26, 0, 0)),
            (5, 5): struct.pack("<I", 1),
            (6, 2): bytes(8),
            (6, 3): struct.pack("<Q", SERIAL),
            (6, 7): struct.pack("<I", 1),
            (6, 8): struct.pack("<I", 1),
            (6, 15): struct.pack("<i", 1),
            FFC_MODE: struct.pack(
                "<8I", automatic, 0, 1, 0, 0, AUTOMATIC_NS // 10**6, never_freeze, imminent
            ),
            _GAIN: struct.pack("<I", 0),
            _FLUX: struct.pack("<8H", 8192, 29515, 8192, 29515, 8192, 29515, 0, 29515),
            _TLINEAR: struct.pack("<I", 1),
            _RESOLUTION: struct.pack("<I", 1),
        }

    @property
    def is_automatic(self) -> bool:
        """Whether the shutter runs by itself."""
        return self._controls[FFC_MODE][0] == 1

    @property
    def counts_per_kelvin(self) -> int:
        """10 or 100, by the TLinear resolution."""
        return _COUNTS_PER_KELVIN[self._controls[_RESOLUTION][0] & 1]

    def get(self, control: tuple[int, int], length: int, vitals: Vitals) -> bytes:
        """The value of a control; raises `DeviceError` if there is none of that number and length."""
        live = {
            UPTIME: struct.pack("<I", vitals.uptime_ms),
            HOUSING: struct.pack("<H", round(100 * vitals.housing_k)),
            FPA: struct.pack("<H", round(100 * vitals.fpa_k)),
            FFC_STATUS: struct.pack("<i", vitals.state is State.RUNNING),
            FFC_STATE: struct.pack("<I", vitals.state),
        }
        value = live.get(control) or self._controls.get(control)
        if value is None or len(value) != length:
            raise _no_control(control, length)
        return value

    def set(self, control: tuple[int, int], data: bytes) -> None:
        """Change a control; raises `DeviceError` for one that cannot be changed here."""
        kept = self._controls.get(control)
        if kept is None or len(kept) != len(data):
            raise _no_control(control, len(data))
        if kept != data and control not in _SETTABLE:
            raise DeviceError(f"the simulated board keeps control {control[0]}/{control[1]} as it is")
        self._controls[control] = data

    def telemetry(self, vitals: Vitals) -> bytes:
        """Two rows of 160 words."""
        fpa, housing = round(100 * vitals.fpa_k), round(100 * vitals.housing_k)
        words = np.zeros(320, dtype="<u2")
        words[0] = _REVISION
        words[1:3] = _low_first(vitals.uptime_ms)
        words[3:5] = _low_first(vitals.state << 4)
        words[5:9] = np.frombuffer(struct.pack("<Q", SERIAL), "<u2")
        words[20:22] = _low_first(vitals.frame_counter)
        words[24], words[26], words[29], words[32] = fpa, housing, fpa, housing
        words[30:32] = _low_first(vitals.corrected_ms)
        words[74] = 3  # log2 of the frames a correction averages
        words[99:107] = np.frombuffer(self._controls[_FLUX], "<u2")
        words[165:168] = self._controls[_GAIN][0]
        words[208], words[209] = self._controls[_TLINEAR][0], self._controls[_RESOLUTION][0]
        return bytes(words.tobytes())


def _low_first(value: int) -> tuple[int, int]:
    return value & 0xFFFF, value >> 16 & 0xFFFF


def _no_control(control: tuple[int, int], length: int) -> DeviceError:
    return DeviceError(f"the simulated board has no control {control[0]}/{control[1]} of {length} bytes")
