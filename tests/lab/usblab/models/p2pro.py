"""InfiRay P2 Pro: 256x384 YUYV at 25 Hz, kelvin times 64 in the lower half, vendor requests for commands.

Sources: frame layout from five public viewers; the command protocol as the best known of
them puts it on the wire (requests 0x41/0x45 and 0xC1/0x44, value 0x78).
"""

from __future__ import annotations

import struct

import numpy as np

from usblab.models import Kelvin, luma
from usblab.uvc.camera import Setup, StallError, UvcCamera
from usblab.uvc.descriptors import CameraShape, Endpoint, PictureFormat, fourcc_guid

WRITE, READ = (0x41, 0x45), (0xC1, 0x44)
STATUS, COMMAND, COMMAND_WITH_DATA, DATA, LONG_DATA = 0x0200, 0x1D00, 0x9D00, 0x1D08, 0x1D10
DEVICE_INFORMATION, PROPERTIES, AUTO_SHUTTER, CALIBRATE = 0x8405, 0x8514, 0x8214, 0xC10D
SET = 0x4000
GAIN = 5
CALIBRATION_S = 0.8
INFORMATION = {1: b"20220808", 6: b"P2-256X192-25HZ".ljust(48, b"\0"), 7: b"P2PRO-0000012345"}
SHAPE = CameraShape(
    0x0BDA, 0x5830, "Generic", "USB Camera",
    (PictureFormat(fourcc_guid("YUY2"), 16, ((256, 192), (256, 384))),),
    400_000, Endpoint(0x81, isochronous=False, max_packet=512),
)  # fmt: skip


class P2Pro(UvcCamera):
    """The camera, without a serial number as sold.

    `properties` holds gain (5: 0 low, 1 high) and its fellows, `auto_shutter` the settings of
    the automatic shutter, `calibrations` counts shutter corrections.
    """

    def __init__(self, kelvin: Kelvin) -> None:
        super().__init__(SHAPE)
        self._kelvin = kelvin
        self._time_s = 0.0
        self._calibrated_s = float("-inf")
        self._held = b""
        self._answer = b""
        self._long_command: tuple[int, int, int] | None = None
        self.calibrations = 0
        self.properties = {0: 32, 1: 300, 2: 300, 3: 128, 4: 128, GAIN: 1}
        self.auto_shutter = {0: 1, 1: 5, 2: 60, 3: 36}

    def picture(self, time_s: float) -> bytes:
        """Picture half, temperatures below it in the taller size; both stand still while calibrating."""
        self._time_s = time_s
        if not self._held or time_s - self._calibrated_s >= CALIBRATION_S:
            kelvin = self._kelvin(time_s)
            self._held = luma(kelvin).tobytes() + np.rint(kelvin * 64).astype("<u2").tobytes()
        return self._held[: self.frame_bytes]

    def vendor(self, setup: Setup, data: bytes) -> bytes:
        """Commands go to a window, answers come from another, a status byte in between."""
        kind = (setup.request_type, setup.request)
        if setup.value != 0x78 or kind not in (WRITE, READ):
            raise StallError(f"vendor request {setup}")
        if kind == READ:
            return b"\0" if setup.index == STATUS else self._answer
        if setup.index == COMMAND:
            self._short(*struct.unpack("<HI", data[:6]), int.from_bytes(data[6:8], "big"))
        elif setup.index == COMMAND_WITH_DATA:
            self._long_command = (*struct.unpack("<H", data[:2]), *struct.unpack(">HI", data[2:8]))
        elif setup.index == DATA and self._long_command:
            self._long(*self._long_command)
        return b""

    def _short(self, code: int, parameter: int, length: int) -> None:
        if code == DEVICE_INFORMATION:
            self._answer = INFORMATION.get(parameter, b"").ljust(length, b"\0")[:length]
        elif code == CALIBRATE:
            self.calibrations += 1
            self._calibrated_s = self._time_s

    def _long(self, code: int, item: int, value: int) -> None:
        table = {PROPERTIES: self.properties, AUTO_SHUTTER: self.auto_shutter}.get(code & ~SET)
        if table is None or item not in table:
            raise StallError(f"long command {code:#06x}, {item}")
        if code & SET:
            table[item] = value
        else:
            self._answer = struct.pack(">H", table[item])
