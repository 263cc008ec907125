"""Thermal Master P2 (UVC), P1, P3 and Vantrue TS2 (bulk): kelvin x 64 below a grey picture and two rows.

A frame is h rows of picture, 2 of metadata (not understood, kept) and h of temperatures. The P2 comes as YUYV
256x386; layout sure by two sources. The others stand on one; their counters tell every lost picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera, p2pro
from fieldkit.drivers.cameras.picture import Picture, decode_frames, extremes, words
from fieldkit.drivers.cameras.source import OpenedSource, Wanted, cameras, find_cameras, open_source
from fieldkit.drivers.cameras.thermal_master_bulk import (
    BEGIN,
    FINISH,
    KINDS,
    MARKER,
    PART_NUMBER,
    SERIAL_NUMBER,
    BulkSource,
    identity_of,
    marker,
)
from fieldkit.drivers.records import Decoded, Rejected
from fieldkit.drivers.usb import find_usb
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import NO_COUNTER

WANTED = Wanted(((0x3474, 0x4281),), "YUYV", ((256, 386),))
SIZES = ((256, 192), (160, 120))
LENGTHS = {2 * (2 * height + 2) * width: (width, height) for width, height in SIZES}
MARKED = (0, MARKER.size, 2 * MARKER.size)
"""Bytes beside a frame: public programs keep it bare, with the marker before it, or with both."""

MODELS = ("auto", "p2", "bulk")


def decode(data: bytes) -> Picture | Rejected:
    """A frame without markers, with the one before it, or with both, by the byte count."""
    bare = next((length for length in LENGTHS if len(data) - length in MARKED), None)
    if bare is None:
        lengths = " or ".join(str(length) for length in sorted(LENGTHS))
        return Rejected(len(data), f"{len(data)} bytes; a frame has {lengths}, 12 more for each marker")
    counter = NO_COUNTER
    if len(data) > bare:
        begin, end = marker(data, BEGIN), marker(data[MARKER.size + bare :], FINISH)
        if begin is None or (end is None and len(data) > bare + MARKER.size):
            return Rejected(len(data), f"{bare} bytes with more around them, but no markers")
        if end is not None and begin.counter != end.counter:
            return Rejected(len(data), f"markers disagree: picture {begin.counter} and {end.counter}")
        counter, data = begin.counter, data[MARKER.size : MARKER.size + bare]
    width, height = LENGTHS[bare]
    pixels = words(data, (2 * height + 2, width))
    rows, counts = pixels[height : height + 2], pixels[height + 2 :]
    found = extremes(counts)
    return Picture(counts, found, rows, p2pro.SCALE, quality=p2pro.flags(counts, found), device_seq=counter)


class ThermalMaster:
    """Driver of the Thermal Master family.

    Options: those of every camera, and `model` (``p2``, ``bulk`` for P1, P3 and TS2, or ``auto``).
    """

    name = "thermal-master"
    title = "Thermal Master P1, P2, P3"
    quantity = "brightness_temperature"
    options = (*camera.OPTIONS, "model")

    def find(self) -> list[Found]:
        """Cameras of the family that are plugged in, with and without a kernel driver."""
        return find_cameras(self.name, self.title, WANTED) + find_usb(self.name, self.title, tuple(KINDS))

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.records.Decodes`."""
        return decode_frames(data, decode, tuple(length + more for length in LENGTHS for more in MARKED))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open whichever of the family is there."""
        model = options.text(settings, "model", "auto", MODELS)
        if settings.source is None and (model == "bulk" or (model == "auto" and not _has_video(settings))):
            source = BulkSource(settings, clock)
            opened = OpenedSource(source, identity_of(source), settings.identity or source.usb.written())
            return self._start(settings, clock, opened, source)
        return self._start(settings, clock, open_source(settings, WANTED, clock), None)

    def _start(
        self, settings: DeviceSettings, clock: Clock, opened: OpenedSource, bulk: BulkSource | None
    ) -> camera.ThermalCamera:
        first = camera.first_picture(opened.source, decode, settings.name, clock)
        info = p2pro.describe(settings, opened, first, _facts(bulk))
        info = replace(info, vendor="Thermal Master")
        return camera.ThermalCamera(info, opened.source, decode, clock, bulk.run_shutter if bulk else None)


def _has_video(settings: DeviceSettings) -> bool:
    """Whether a member with a kernel driver is meant."""
    members = [usb for _, usb in cameras() if (usb.vendor, usb.product) in WANTED.kinds]
    return any(not settings.identity or usb.matches(settings.identity) for usb in members)


def _facts(bulk: BulkSource | None) -> dict[str, Any]:
    if bulk is None:
        return {"commands": "not documented"}
    try:
        return {
            "serial_number": bulk.text(SERIAL_NUMBER),
            "model": bulk.text(PART_NUMBER),
            "gain": bulk.gain(),
        }
    except DeviceError as error:
        return {"commands": error.message}
