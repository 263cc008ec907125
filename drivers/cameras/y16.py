"""Any camera that delivers Y16: counts, and a temperature only if the scale is configured.

Nothing is guessed: without `kelvin_per_count` the stream is counts and every frame is flagged `no_value`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import Decode, DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, cameras, open_source
from fieldkit.drivers.decoding import Decoded, Rejected
from fieldkit.drivers.options import decoding_settings, kelvin_per_count
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError

SIZES = (
    (640, 512),
    (640, 480),
    (384, 288),
    (336, 256),
    (320, 256),
    (320, 240),
    (256, 192),
    (160, 120),
    (80, 60),
)
LONGEST_SIDE = 16_384


def decode(
    data: bytes, width: int, height: int, scale: float = math.nan, offset: float = 0.0
) -> DecodedFrame | Rejected:
    """A frame of width x height words."""
    if len(data) != 2 * width * height:
        return Rejected(len(data), f"{len(data)} bytes; a frame of {width}x{height} has {2 * width * height}")
    return DecodedFrame(pixel_view(data, (height, width)), scale=scale, offset=offset)


def sizes_of(settings: DeviceSettings) -> tuple[tuple[int, int], ...]:
    """The size that `settings` state, else the usual ones."""
    width, height = size_of(settings)
    return ((width, height),) if width > 0 and height > 0 else SIZES


def size_of(settings: DeviceSettings) -> tuple[int, int]:
    """The options `width` and `height`, 0 where they are not given."""
    width, height = (options.whole(settings, key, 0, (0, LONGEST_SIDE)) for key in ("width", "height"))
    return width, height


def decoder(settings: DeviceSettings, width: int, height: int) -> Decode:
    """Decoder of frames of that size, by the options `kelvin_per_count` and `kelvin_offset`."""
    offset = options.number(settings, "kelvin_offset", 0.0)
    return partial(decode, width=width, height=height, scale=kelvin_per_count(settings), offset=offset)


class Y16(CameraDriver):
    """Driver of any other camera with Y16.

    Options: those of every camera, `width` and `height` (else the first usual size the camera
    offers), `kelvin_per_count` with `kelvin_offset`, and `rate_hz`.
    """

    name = "y16"
    title = "any camera with Y16"
    video = CameraFormat((), "Y16 ", SIZES)
    quantity = "counts"
    options: tuple[str, ...] = (
        *camera.OPTIONS,
        "width",
        "height",
        "kelvin_per_count",
        "kelvin_offset",
        "rate_hz",
    )

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; options `width`, `height`, `kelvin_per_count`, `kelvin_offset`."""
        settings = decoding_settings(self.name, options)
        sizes = sizes_of(settings)
        if sizes is SIZES:
            sizes = tuple(size for size in SIZES if len(data) % (2 * size[0] * size[1]) == 0)
        if not sizes:
            reason = f"{len(data)} bytes; no usual size divides them: give -o width=... -o height=..."
            return Decoded((), (Rejected(len(data), reason),))
        width, height = sizes[0]
        return decode_frames(data, decoder(settings, width, height), (2 * width * height,))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera that identity or port name; there is no default."""
        if not (settings.identity or settings.port or settings.source):
            present = ", ".join(usb.as_text() for _, usb in cameras()) or "none"
            raise ConfigError(
                f"y16 reads any camera, so one must be named; connected: {present}",
                place=settings.name,
                fix='set identity = "vendor:product", as the list of devices shows it',
            )
        sizes = sizes_of(settings)
        handle = open_source(settings, CameraFormat((), "Y16 ", sizes), clock)
        width, height = getattr(handle.source, "size", sizes[0])
        read = decoder(settings, width, height)
        first = camera.first_frame(handle.source, read, settings.name, clock)
        facts = {"scale_from": "unknown" if math.isnan(first.scale) else "configuration"}
        rate_hz = options.number(settings, "rate_hz", 0.0, options.POSITIVE)
        info = camera.describe(settings, handle, first, facts, rate_hz=rate_hz)
        return camera.ThermalCamera(info, handle.source, read, clock)
