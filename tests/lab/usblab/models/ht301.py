"""HT-301: 384x288 counts and four rows of metadata, commands through the UVC zoom control.

Sources: the layout, temperature law and commands on which three public programs agree. The
calibration constants are ours, chosen so that -20 to 120 °C fits the 14 bits.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import CountArray, FloatArray
from usblab.models import Kelvin, luma
from usblab.uvc.camera import Control, UvcCamera
from usblab.uvc.descriptors import (
    CAMERA_TERMINAL,
    ZOOM_ABSOLUTE,
    ZOOM_BIT,
    CameraShape,
    Endpoint,
    PictureFormat,
    fourcc_guid,
)

WIDTH, HEIGHT, ROWS = 384, 288, 292
CALIBRATE, TEMPERATURES, PICTURE = 0x8000, 0x8004, 0x8005
SHUTTER_CLOSES_S, SHUTTER_OPENS_S = 0.35, 0.80
ZOOM = (CAMERA_TERMINAL, ZOOM_ABSOLUTE)
SHAPE = CameraShape(
    0x1514, 0x0001, "Xinfrared", "HT-301", (PictureFormat(fourcc_guid("YUY2"), 16, ((WIDTH, ROWS),)),),
    400_000, Endpoint(0x81, isochronous=True, max_packet=0x1400, interval=3), "HT301-00042",
    terminal_controls=ZOOM_BIT,
)  # fmt: skip


@dataclass(frozen=True)
class Calibration:
    """The constants in the metadata rows; temperatures in °C."""

    cal_00: int = 6000
    coefficients: tuple[float, float, float, float, float] = (0.001, 1.0, 0.0, 1e-4, 0.018)
    fpa_c: float = 25.0
    shutter_c: float = 30.05  # 303.2 K, in the tenths the camera tells

    def counts(self, celsius: FloatArray) -> CountArray:
        """Counts the sensor gives for a black body: the public temperature law solved for them."""
        c1, c2, c3, c4, c5 = self.coefficients
        offset = self.cal_00 - max(0, int(390 - 7.05 * self.fpa_c))
        gain = c3 * self.fpa_c**2 + c4 * self.fpa_c + c5
        beyond = (c1 * celsius**2 + c2 * celsius) - (c1 * self.shutter_c**2 + c2 * self.shutter_c)
        return np.clip(np.rint(offset + beyond / gain), 0, 0x3FFF).astype(np.uint16)


class HT301(UvcCamera):
    """The camera; `commands` lists what was written to the zoom control."""

    def __init__(self, kelvin: Kelvin, calibration: Calibration | None = None) -> None:
        super().__init__(SHAPE)
        self.calibration = calibration or Calibration()
        self._kelvin = kelvin
        self._time_s = 0.0
        self._calibrated_s = float("-inf")
        self._held: FloatArray | None = None
        self._temperatures = False
        self.commands: list[int] = []
        self.controls = {ZOOM: Control(bytes(2), run=self._command)}

    def picture(self, time_s: float) -> bytes:
        """Counts with metadata once temperatures were asked for, an ordinary picture before."""
        self._time_s = time_s
        closed = SHUTTER_CLOSES_S <= time_s - self._calibrated_s < SHUTTER_OPENS_S
        if self._held is None or not closed:
            self._held = self._kelvin(time_s)
        celsius = self._held - 273.15
        if not self._temperatures:
            return luma(celsius).tobytes().ljust(self.frame_bytes, b"\x80")
        counts = self.calibration.counts(celsius)
        return np.vstack((counts, self._metadata(counts))).tobytes()

    def _command(self, data: bytes) -> None:
        code = int.from_bytes(data, "little")
        self.commands.append(code)
        if code in (TEMPERATURES, PICTURE):
            self._temperatures = code == TEMPERATURES
        if code == CALIBRATE:
            self._calibrated_s = self._time_s

    def _metadata(self, counts: CountArray) -> CountArray:
        words = np.zeros(4 * WIDTH, np.uint16)
        words[0:2] = 7800 - 36 * (self.calibration.fpa_c - 20)
        for first, found in ((2, counts.argmax()), (5, counts.argmin())):
            y, x = divmod(int(found), WIDTH)
            words[first : first + 3] = (x, y, counts[y, x])
        words[8], words[12] = int(counts.mean()), counts[HEIGHT // 2, WIDTH // 2]
        area = words[3 * WIDTH :]
        area[0] = self.calibration.cal_00
        area[1:3] = round((self.calibration.shutter_c + 273.15) * 10)
        area[3:13] = _floats(*self.calibration.coefficients)
        area[24:32] = np.frombuffer(b"HT301 V1.0".ljust(16, b"\0"), "<u2")
        area[32:40] = np.frombuffer(b"HT301-00042".ljust(16, b"\0"), "<u2")
        area[127:137] = _floats(0.0, 20.0, 20.0, 0.5, 1.0)
        area[137] = 1
        return words.reshape(4, WIDTH)


def _floats(*values: float) -> CountArray:
    return np.frombuffer(struct.pack(f"<{len(values)}f", *values), "<u2")
