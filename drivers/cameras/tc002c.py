"""Topdon TC002C Duo: kelvin x 16 above an image, in YUYV 512x484 at 25 Hz.

Rows 0-95 hold 256x192 words, two rows of the sensor in each; rows 96-97 are telemetry (not understood, kept),
98-481 an image of 512x384, 482-483 telemetry again. One public description, of one unit
(AronNovak/PyThermalCamera, docs/TC002C-DUO.md); errors of several kelvin are reported there.

Hikvision's id 2bdf:0102 is shared with its HIKMICRO modules (JS-MINI256, Mini), whose frames of 256x192,
256x196 and 256x392 hold images of 8 bits alone: only the frame size tells them apart, and asking for a size
that is announced but does not exist disturbs the stream, so no other is tried.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldkit.drivers.cameras import camera, p2pro
from fieldkit.drivers.cameras.camera import DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, open_source
from fieldkit.drivers.decoding import Decoded, Rejected
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings

WIDTH, HEIGHT = 256, 192
FRAME = (484, 512)
TELEMETRY = slice(HEIGHT // 2, HEIGHT // 2 + 2)
LENGTH = 2 * FRAME[0] * FRAME[1]
WANTED = CameraFormat(
    ((0x2BDF, 0x0102),),
    "YUYV",
    ((FRAME[1], FRAME[0]),),
    otherwise="a HIKMICRO module (JS-MINI256, Mini), which sends images of 8 bits and no temperatures",
)
SCALE = 1 / 16
RATE_HZ = 25.0


def decode(data: bytes) -> DecodedFrame | Rejected:
    """The temperatures of a frame; its image is dropped."""
    if len(data) != LENGTH:
        return Rejected(len(data), f"{len(data)} bytes; a frame of {FRAME[1]}x{FRAME[0]} has {LENGTH}")
    counts, rows = pixel_view(data, (HEIGHT, WIDTH)), pixel_view(data, FRAME)[TELEMETRY]
    return DecodedFrame(counts, rows, SCALE, flags=p2pro.flags(counts, SCALE))


class Tc002c(CameraDriver):
    """Driver of the Topdon TC002C Duo; options are those of every camera."""

    name = "tc002c"
    title = "Topdon TC002C Duo"
    options: tuple[str, ...] = camera.OPTIONS
    video = WANTED
    caveat = "HIKMICRO modules without temperatures share this id; only the frame size 512x484 decides"

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        return decode_frames(data, decode, (LENGTH,))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera; none of its commands are known."""
        handle = open_source(settings, WANTED, clock)
        first = camera.first_frame(handle.source, decode, settings.name, clock)
        facts = {"commands": "not documented"}
        info = camera.describe(settings, handle, first, facts, vendor="Topdon", rate_hz=RATE_HZ)
        return camera.ThermalCamera(info, handle.source, decode, clock)
