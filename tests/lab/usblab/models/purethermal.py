"""PureThermal 3 with a Lepton 3.5: Y16 with telemetry rows, the Lepton's commands as extension units.

Sources: identity, formats, unit numbers and selectors from the public PureThermal firmware;
telemetry words and status bits from its Lepton header and three other public decoders.
"""

from __future__ import annotations

import struct

import numpy as np

from fieldkit.model.arrays import CountArray, FloatArray
from usblab.models import Kelvin, luma
from usblab.uvc.camera import Control, UvcCamera
from usblab.uvc.descriptors import (
    BGR24_GUID,
    CameraShape,
    Endpoint,
    ExtensionUnit,
    PictureFormat,
    fourcc_guid,
)

AGC, OEM, RAD, SYS, VID, RAD2 = 3, 4, 5, 6, 7, 0x15
GUIDS = {
    AGC: b"pt1-lep-agc-0000", OEM: b"pt1-lep-oem-0000", RAD: b"pt1-lep-rad-0000",
    SYS: b"pt1-lep-sys-0000", VID: b"pt1-lep-vid-0000", RAD2: b"pt1-lep-rad20000",
}  # fmt: skip
RUN_FFC, FFC_STATE, GAIN_MODE, UPTIME, FPA_TEMPERATURE = (SYS, 17), (SYS, 20), (SYS, 19), (SYS, 4), (SYS, 6)
TLINEAR, TLINEAR_RESOLUTION = (RAD2, 18), (RAD2, 19)
FFC_NEVER, FFC_RUNNING, FFC_DONE = 0, 2, 3
FFC_S = 1.0
Y16_FORMAT = 2
SERIAL_NUMBER = struct.pack("<Q", 0x1A2B3C)
SOFTWARE = bytes((3, 3, 26, 0, 3, 3, 26, 0))
FPA_K100, HOUSING_K100 = 30315, 30115


def _u32(number: int) -> bytes:
    return struct.pack("<I", number)


DEFAULTS: dict[tuple[int, int], bytes] = {
    (AGC, 1): _u32(0),
    (OEM, 8): b"500-0771-01".ljust(32, b"\0"),
    (OEM, 9): SOFTWARE,
    (RAD, 5): _u32(1),
    (RAD, 12): b"\0",
    (SYS, 1): b"\0",
    (SYS, 2): bytes(8),
    (SYS, 3): SERIAL_NUMBER,
    UPTIME: _u32(0),
    (SYS, 5): struct.pack("<H", HOUSING_K100),
    FPA_TEMPERATURE: struct.pack("<H", FPA_K100),
    (SYS, 7): _u32(1),
    (SYS, 8): _u32(1),
    (SYS, 15): _u32(1),
    (SYS, 16): struct.pack("<7IHH", 1, 0, 1, 0, 0, 180_000, 0, 150, 52),
    RUN_FFC: b"\0",
    (SYS, 18): _u32(0),
    GAIN_MODE: _u32(0),
    FFC_STATE: _u32(0),
    (VID, 2): _u32(1),
    (RAD2, 17): struct.pack("<8H", 8192, 29515, 8192, 29515, 8192, 29515, 0, 29515),
    TLINEAR: _u32(1),
    TLINEAR_RESOLUTION: _u32(1),
}


ISOCHRONOUS = Endpoint(0x83, isochronous=True, max_packet=1023, interval=1)
"""At full speed, as the real board."""
BULK = Endpoint(0x83, isochronous=False, max_packet=64)
"""Loses nothing in the emulator even when this computer is busy; the board itself has no such thing."""


def shape(serial_number: str, endpoint: Endpoint = ISOCHRONOUS) -> CameraShape:
    """The descriptors: five formats, Y16 the second."""
    plain = ((160, 120),)
    formats = (
        PictureFormat(fourcc_guid("UYVY"), 16, plain),
        PictureFormat(fourcc_guid("Y16 "), 16, (*plain, (160, 122))),
        PictureFormat(fourcc_guid("Y8  "), 8, plain),
        PictureFormat(fourcc_guid("RGBP"), 16, plain),
        PictureFormat(BGR24_GUID, 24, plain),
    )
    extensions = tuple(
        ExtensionUnit(unit, guid, tuple(selector for known, selector in DEFAULTS if known == unit))
        for unit, guid in GUIDS.items()
    )
    return CameraShape(
        0x1E4E, 0x0100, "GroupGets", "PureThermal (fw:v1.3.0)", formats, 1_111_111, endpoint,
        serial_number, high_speed=False, extensions=extensions, status_endpoint=0x82,
    )  # fmt: skip


class PureThermal(UvcCamera):
    """The camera; `ffc_runs` counts the shutter corrections it was commanded to make."""

    def __init__(
        self, kelvin: Kelvin, serial_number: str = "8007000b-5113-3037-3231", endpoint: Endpoint = ISOCHRONOUS
    ) -> None:
        super().__init__(shape(serial_number, endpoint))
        self.kelvin = kelvin
        self._time_s = 0.0
        self._ffc_time_s = float("-inf")
        self._number = 0
        self._held: CountArray | None = None
        self.ffc_runs = 0
        self.controls = {key: Control(value) for key, value in DEFAULTS.items()}
        self.controls[RUN_FFC].run = lambda _: self._close_shutter()
        self.controls[FFC_STATE].read = lambda: _u32(self.ffc_state)
        self.controls[UPTIME].read = lambda: _u32(self._uptime_ms(self._time_s))

    @property
    def ffc_state(self) -> int:
        """The Lepton's own words: 0 never, 2 running, 3 done."""
        if self.ffc_runs == 0:
            return FFC_NEVER
        return FFC_RUNNING if self._time_s - self._ffc_time_s < FFC_S else FFC_DONE

    def picture(self, time_s: float) -> bytes:
        """One picture; in Y16 the taller size carries two telemetry rows at its foot."""
        self._time_s = time_s
        self._number += 1
        if self._held is None or self.ffc_state != FFC_RUNNING:  # the picture stands still behind the shutter
            self._held = self._counts(self.kelvin(time_s))
        if self.format != Y16_FORMAT:
            shown = luma(self._held.astype(np.float64)).tobytes()
            return shown.ljust(self.frame_bytes, b"\0")[: self.frame_bytes]
        rows = [self._held] if self.size == (160, 120) else [self._held, self._telemetry(self._held)]
        return np.vstack(rows).tobytes()

    def _counts(self, kelvin: FloatArray) -> CountArray:
        return np.rint(kelvin * (100 if self._setting(TLINEAR_RESOLUTION) else 10)).astype(np.uint16)

    def _telemetry(self, picture: CountArray) -> CountArray:
        words = np.zeros(320, np.uint16)
        words[0] = 14
        words[1:3] = _words(self._uptime_ms(self._time_s))
        words[3:5] = _words(self.ffc_state << 4)
        words[5:9] = np.frombuffer(SERIAL_NUMBER, "<u2")
        words[13:17] = np.frombuffer(SOFTWARE, "<u2")
        words[20:22] = _words(3 * self._number)  # counts at the sensor's 27 Hz
        words[22] = int(picture.mean())
        words[24] = words[29] = FPA_K100
        words[26] = words[32] = HOUSING_K100
        words[30:32] = _words(self._uptime_ms(self._ffc_time_s))
        words[99:103] = (8192, 29515, 8192, 29515)
        words[165:168] = self._setting(GAIN_MODE)
        words[208], words[209] = self._setting(TLINEAR), self._setting(TLINEAR_RESOLUTION)
        return words.reshape(2, 160)

    def _uptime_ms(self, time_s: float) -> int:
        return max(0, int((max(time_s, self.power_on_s) - self.power_on_s) * 1000))

    def _setting(self, key: tuple[int, int]) -> int:
        return int.from_bytes(self.controls[key].value, "little")

    def _close_shutter(self) -> None:
        self.ffc_runs += 1
        self._ffc_time_s = self._time_s


def _words(number: int) -> tuple[int, int]:
    return number & 0xFFFF, number >> 16 & 0xFFFF
