"""InfiRay P2 Pro, Topdon TC001 and TS001, UNI-T UTi261M and relatives, 256x192.

Raw format YUYV 256x384 at 25 Hz: rows 0-191 a grey picture, rows 192-383 little-endian words of kelvin x 64.
Sure by five public viewers and a decoded public picture. The ids 0bda:5830 and :5840 belong to a chip maker
and are shared by webcams, so the frame size is the real signature. The camera has no clock, counter or
shutter flag: a running correction shows as pictures that stand still. In its first nine seconds pictures
are 0x8000 everywhere, then uncorrected; both are flagged.

Commands go beside the stream as vendor requests; see `fieldkit.drivers.cameras.infiray`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera, infiray
from fieldkit.drivers.cameras.picture import Picture, decode_frames, doubts, extremes, words
from fieldkit.drivers.cameras.source import OpenedSource, Wanted, find_cameras, open_source
from fieldkit.drivers.records import Decoded, Rejected
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found, StreamInfo
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import Quality

WIDTH, HEIGHT = 256, 192
LENGTH = 2 * WIDTH * 2 * HEIGHT
WANTED = Wanted(((0x0BDA, 0x5830), (0x0BDA, 0x5840)), "YUYV", ((WIDTH, 2 * HEIGHT),))
SCALE = 1 / 64
RATE_HZ = 25.0
GREY = (0x8000, 0x80FF)  # a grey picture taken for temperatures; a camera that starts sends 0x8000
UNCORRECTED_STEP = 100.0  # mean difference of neighbours: about 6 when clean, 320 before the first correction


def decode(data: bytes) -> Picture | Rejected:
    """The temperature half of a frame; its grey half is dropped."""
    if len(data) != LENGTH:
        return Rejected(len(data), f"{len(data)} bytes; a frame of {WIDTH}x{2 * HEIGHT} has {LENGTH}")
    counts = words(data, (HEIGHT, WIDTH), LENGTH // 2)
    found = extremes(counts)
    return Picture(counts, found, scale=SCALE, quality=flags(counts, found))


def flags(counts: NDArray[np.uint16], found: tuple[float, float]) -> Quality:
    """What the temperatures alone betray: end of scale, not started, not corrected, or the grey half."""
    quality = doubts(found, (0, 0xFFFF), SCALE)
    middle = len(counts) // 2
    row = counts[middle].astype(np.int32)
    step = np.abs(row[1:] - row[:-1]).mean()
    # halves that are exchanged or shifted leave one of these rows grey
    if step > UNCORRECTED_STEP or any(_is_grey(counts[place]) for place in (0, middle, -1)):
        quality |= Quality.NO_VALUE
    return quality


def _is_grey(row: NDArray[np.uint16]) -> bool:
    coldest, hottest = extremes(row)
    return GREY[0] <= coldest <= hottest <= GREY[1]


class P2Pro:
    """Driver of the InfiRay 256x192 family.

    Options: those of every camera, and what is set in the camera and read back when opening: `gain` (``high``
    or ``low``), `emissivity` (1.0 leaves the correction to fieldkit), `distance_m`, `auto_shutter`.
    """

    name = "p2pro"
    title = "InfiRay P2 Pro / Topdon TC001"
    quantity = "brightness_temperature"
    options = (*camera.OPTIONS, "gain", "emissivity", "distance_m", "auto_shutter")

    def find(self) -> list[Found]:
        """Cameras with the chip maker's ids; the frame size tells when opening."""
        doubt = "webcams share this id; only the frame size 256x384 tells"
        return find_cameras(self.name, self.title, WANTED, doubt)

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.records.Decodes`."""
        return decode_frames(data, decode, (LENGTH,))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera, set in it what the options ask for, record what its commands tell."""
        wanted = infiray.wishes(settings)
        opened = open_source(settings, WANTED, clock)
        first = camera.first_picture(opened.source, decode, settings.name, clock)
        try:
            commands, facts = infiray.connect(opened.usb, clock, wanted)
        except DeviceError:
            opened.source.close()
            raise
        info = describe(settings, opened, first, facts)
        return camera.ThermalCamera(
            info, opened.source, decode, clock, commands.calibrate if commands else None
        )


def describe(
    settings: DeviceSettings, opened: OpenedSource, first: Picture, facts: Mapping[str, Any]
) -> StreamInfo:
    """The stream of a camera of kelvin x 64, shared with its cousins."""
    facts = dict(facts)
    return StreamInfo(
        name=settings.name,
        quantity="brightness_temperature",
        unit="K",
        shape=first.counts.shape,
        scale=SCALE,
        metadata_shape=first.metadata_rows.shape if first.metadata_rows.size else (0, 0),
        rate_hz=RATE_HZ,
        driver=settings.driver,
        vendor="InfiRay",
        model=str(facts.pop("model", "")) or opened.usb.title,
        serial_number=str(facts.pop("serial_number", "")) or opened.usb.serial,
        firmware=str(facts.pop("firmware", "")),
        port=opened.source.port,
        identity=opened.identity,
        latency_s=options.number(settings, "latency_s", 0.0),
        accuracy=options.number(settings, "accuracy", math.nan),
        settings={"backend": opened.source.backend, **facts},
    )
