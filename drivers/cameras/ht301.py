"""HT-301, T3S, Xtherm, T2S+ and T2L: counts with four rows of metadata below them.

Announced as YUYV of 384x292, 256x196, 240x184 or 640x516: the frame and four rows. In the temperature
mode each word holds 14 bits of counts; the rows carry the temperatures of sensor and shutter and the
calibration of the same frame, so they are kept and the conversion (`fieldkit.physics.camera_laws`, law
``ht301``) can be repeated. Layout and main law are sure by three public programs; other models than the
HT-301 by width only.

Commands are values written to the absolute zoom control: 0x8004 temperatures, 0x8000 close the shutter and
calibrate, 0x8020 and 0x8021 the range of -20 to 120 °C and the upper one, whose law is disputed: there the
stream is counts. T2S+ of the second version (04b4:0100) deliver uncorrected data and are refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, cast

import numpy as np

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import PLAUSIBLE_K, DecodedFrame, decode_frames, extremes, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, cannot_command, open_source
from fieldkit.drivers.decoding import Decoded, Rejected, text_of
from fieldkit.model.arrays import CountArray
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, FrameSource
from fieldkit.model.samples import Quality
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.camera_laws import HT301_COUNTS, ht301_area, ht301_curve, ht301_fpa_c, ht301_parameters

ROWS = 4
WANTED = CameraFormat(((0x1514, 0x0001),), "YUYV", ((384, 292), (256, 196), (240, 184), (640, 516)))
SHAPES = {2 * width * height: (height, width) for width, height in WANTED.sizes}
TEMPERATURES, CALIBRATE, NORMAL_RANGE, HIGH_RANGE = 0x8004, 0x8000, 0x8020, 0x8021
RANGES = {"normal": NORMAL_RANGE, "high": HIGH_RANGE}
SETTLES_S = 0.3  # the camera ignores commands right after the stream begins
RATE_HZ = 25.0
_USER_BLOCK = 127
_USER = ("camera_correction", "camera_reflected_c", "camera_air_c", "camera_humidity", "camera_emissivity")


def decode(data: bytes, law: str = "ht301") -> DecodedFrame | Rejected:
    """A frame by its byte count; words beyond 14 bits are the camera's ordinary image."""
    shape = SHAPES.get(len(data))
    if shape is None:
        sizes = " or ".join(str(size) for size in sorted(SHAPES))
        return Rejected(len(data), f"{len(data)} bytes; a frame of this family has {sizes}")
    pixels = pixel_view(data, shape)
    counts, rows = pixels[:-ROWS], pixels[-ROWS:]
    coldest, hottest = extremes(counts)
    if hottest > HT301_COUNTS:
        return Rejected(len(data), "an ordinary image, not temperatures: the camera is in the wrong mode")
    parameters = ht301_parameters(rows)
    scale, offset, zero = ht301_curve(parameters)
    warm = [math.sqrt(max(count * scale + offset, 0.0)) + zero for count in (coldest, hottest)]
    # NaN is in no range
    is_plausible = law == "ht301" and warm[1] >= PLAUSIBLE_K[0] and warm[0] <= PLAUSIBLE_K[1]
    flags, ends = Quality.GOOD if is_plausible else Quality.NO_VALUE, (0, HT301_COUNTS)
    fpa_k = ht301_fpa_c(parameters.width, parameters.fpa_raw) + CELSIUS_ZERO_K
    return DecodedFrame(counts, rows, law=law, ends=ends, flags=flags, fpa_temperature_k=fpa_k)


def user_block(rows: CountArray) -> dict[str, Any]:
    """Settings of the camera itself, recorded and not applied; and its firmware and serial number."""
    flat = np.ascontiguousarray(rows).ravel()
    area = flat[ht301_area(rows.shape[1]) :]
    block = area[_USER_BLOCK : _USER_BLOCK + 10].view("<f4").tolist()
    texts = {
        name: area[place : place + 8].tobytes() for name, place in (("firmware", 24), ("serial_number", 32))
    }
    facts = {name: text_of(text) for name, text in texts.items()}
    return {**facts, **dict(zip(_USER, block, strict=True)), "camera_distance_m": int(area[_USER_BLOCK + 10])}


class Ht301(CameraDriver):
    """Driver of the metadata-rows family.

    Options: those of every camera, and `range` (``normal`` or ``high``).
    """

    name = "ht301"
    title = "HT-301 / T3S / T2L"
    options: tuple[str, ...] = (*camera.OPTIONS, "range")
    video = WANTED

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        return decode_frames(data, decode, tuple(SHAPES))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera and switch it to temperatures."""
        chosen = options.text(settings, "range", "normal", tuple(RANGES))
        handle = open_source(settings, WANTED, clock)
        command = _zoom_of(handle.source)
        clock.sleep(SETTLES_S)
        command(RANGES[chosen])
        command(TEMPERATURES)
        read = partial(decode, law="ht301" if chosen == "normal" else "ht301-high")
        first = camera.first_frame(handle.source, read, settings.name, clock)
        facts = {"range": chosen, **user_block(first.metadata_rows)}
        facts["model"] = handle.usb.title or "HT-301 family"
        # the law of the high range is not known
        declared = first if chosen == "normal" else first._replace(law="linear")
        info = camera.describe(settings, handle, declared, facts, vendor="Infiray / Xtherm", rate_hz=RATE_HZ)
        return camera.ThermalCamera(info, handle.source, read, clock, partial(command, CALIBRATE))


def _zoom_of(source: FrameSource) -> Callable[[int], None]:
    """The source's way of writing the absolute zoom; raises `DeviceError` if it has none."""
    if not hasattr(source, "set_zoom"):
        raise cannot_command(source)
    return cast("Callable[[int], None]", source.set_zoom)
