"""PureThermal boards (1, 2, 3, Mini) with a FLIR Lepton 2.5, 3.1R or 3.5.

Raw format Y16, little-endian words: 160x120 (Lepton 3.x) or 80x60 (2.x), and the same with
telemetry rows below it (160x122, 80x63). Certain, by the board's firmware, the Lepton headers and a
decoded public recording: formats, scale, extension units, words 0-79 of the telemetry. From one
source: words from 160 on (gain, TLinear), placed by counting on through the rows.

Words of the telemetry: 0 revision; 1-2 uptime ms; 3-4 status (bits 4-5 FFC: 0 never, 1 imminent,
2 running, 3 done); 20-21 frame counter; 24 FPA K x 100; 26 housing K x 100; 30-31 uptime ms at the last FFC;
99 emissivity (8192 = 1); 166 gain in effect; 208 TLinear on; 209 TLinear resolution (0: 0.1 K, 1: 0.01 K).

The payload carries no hardware time; uptime and counter are the camera's own clock.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Protocol, runtime_checkable

from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import WORD_ENDS, DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, cannot_command, open_source
from fieldkit.drivers.decoding import Decoded, Rejected, text_of
from fieldkit.drivers.options import decoding_settings, kelvin_per_count
from fieldkit.model.arrays import CountArray
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, FrameSource
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import Quality

WANTED = CameraFormat(((0x1E4E, 0x0100),), "Y16 ", ((160, 122), (80, 63), (160, 120), (80, 60)))
SHAPES = {2 * width * height: (height, width) for width, height in WANTED.sizes}
IMAGE_ROWS = {80: 60, 160: 120}
SETTLING_MS = 10_000  # levels creep after a correction
RESOLUTION_K = {(1, 0): 0.1, (1, 1): 0.01}
"""K per count by TLinear (1: on) and its resolution."""

COUNTS_ENDS = (0, 0x3FFF)
"""The ends of a pixel's range without TLinear, of 14 bits."""

GAINS = {0: "high", 1: "low", 2: "automatic"}
EMISSIVITY_WORD, EMISSIVITY_1 = 99, 8192
FFC, OLD_FFC, OLD_REVISION = (2, 3), (1, 2), 8
"""The states "running" and "done" of a correction; one revision of the telemetry has no "imminent"."""

COLDEST_FPA, HOTTEST_FPA = 20_000, 40_000  # no sensor works outside of 200 to 400 K
RATE_HZ = 8.7
SYSTEM_UNIT, OEM_UNIT, RADIOMETRY_UNIT = 6, 4, 0x15
SERIAL, PART_NUMBER, RUN_FFC = (SYSTEM_UNIT, 3), (OEM_UNIT, 8), (SYSTEM_UNIT, 17)
TLINEAR, TLINEAR_RESOLUTION = (RADIOMETRY_UNIT, 18), (RADIOMETRY_UNIT, 19)
# words 0, 1-2, 3-4, 20-21, 24, 26, 30-31, 166, 208 and 209
_TELEMETRY = struct.Struct("<H I I 30x I 4x H 2x H 6x I 268x H 82x H H")


def decode(data: bytes, default_scale: float = math.nan) -> DecodedFrame | Rejected:
    """A frame by its byte count; `default_scale` (K per count) is for frames without telemetry."""
    shape = SHAPES.get(len(data))
    if shape is None:
        sizes = " or ".join(map(str, sorted(SHAPES)))
        return Rejected(len(data), f"{len(data)} bytes; a Lepton's frame has {sizes}")
    pixels, height = pixel_view(data, shape), IMAGE_ROWS[shape[1]]
    counts, rows = pixels[:height], pixels[height:]
    if height == shape[0]:
        return DecodedFrame(counts, rows, default_scale, ends=_ends(counts, default_scale))
    fields = _TELEMETRY.unpack_from(data, 2 * height * shape[1])
    revision, uptime, status, counter, fpa, housing, corrected, gain, linear, resolution = fields
    if not (revision and COLDEST_FPA < fpa < HOTTEST_FPA):  # the rows are not filled in
        return DecodedFrame(counts, rows, default_scale, ends=_ends(counts, default_scale))
    scale = RESOLUTION_K.get((linear, resolution), math.nan)
    state, (running, done) = status >> 4 & 3, OLD_FFC if revision == OLD_REVISION else FFC
    shutter = state == running or (state == done and 0 <= uptime - corrected < SETTLING_MS)
    fields = (
        counts, rows, scale, 0.0, "linear", _ends(counts, scale), Quality.GOOD, shutter, uptime, counter,
        fpa / 100, housing / 100, GAINS.get(gain, "unknown"),
    )  # fmt: skip
    # not by the named tuple's own constructor: it takes a tenth of the decoding, and the goal of
    # benchmarks/drivers_frames.py, twice the speed of flirpy, leaves less than that
    return tuple.__new__(DecodedFrame, fields)


def _ends(counts: CountArray, scale: float) -> tuple[int, int]:
    """The range of pixels; above 14 bits TLinear must be on, whatever the scale."""
    return WORD_ENDS if scale > 0 or counts.max() > COUNTS_ENDS[1] else COUNTS_ENDS


class PureThermal(CameraDriver):
    """Driver of PureThermal boards with a Lepton.

    Options: those of every camera, and `kelvin_per_count` (0.01 or 0.1) for boards that neither send
    telemetry nor reply, where the scale would be unknown.
    """

    name = "purethermal"
    title = "PureThermal with FLIR Lepton"
    options: tuple[str, ...] = (*camera.OPTIONS, "kelvin_per_count")
    video = WANTED

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        scale = kelvin_per_count(decoding_settings(self.name, options))
        return decode_frames(data, partial(decode, default_scale=scale), tuple(SHAPES))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the board, choose the frame with telemetry, declare what the first one reports."""
        default_scale = kelvin_per_count(settings)
        handle = open_source(settings, WANTED, clock)
        source = handle.source
        if math.isnan(default_scale):
            default_scale = ask_scale(source)
        read = partial(decode, default_scale=default_scale)
        first = camera.first_frame(source, read, settings.name, clock)
        facts = {"firmware": handle.usb.title, **_facts(source, first)}
        info = camera.describe(settings, handle, first, facts, vendor="GroupGets / FLIR", rate_hz=RATE_HZ)
        if "gain" in facts:  # with telemetry
            info = replace(info, device_time_unit="ms")
        return camera.ThermalCamera(info, source, read, clock, partial(run_shutter, source))


def _facts(source: FrameSource, first: DecodedFrame) -> dict[str, Any]:
    """A board's report of itself, by its first frame and its extension units."""
    facts: dict[str, Any] = {"model": text_of(_ask(source, PART_NUMBER, 32)) or "Lepton"}
    facts["serial_number"] = str(int.from_bytes(_ask(source, SERIAL, 8), "little") or "")
    if math.isnan(first.fpa_temperature_k):
        return facts | {"scale_from": "extension unit or configuration"}
    facts |= {"scale_from": "telemetry", "gain": first.gain}
    if set_to := int(first.metadata_rows.ravel()[EMISSIVITY_WORD]):
        facts["emissivity"] = round(set_to / EMISSIVITY_1, 4)  # the camera has applied it
    return facts


@runtime_checkable
class ExtensionUnits(Protocol):
    """A source that reaches the extension units of a UVC camera; raises `DeviceError` where there is none."""

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Read a control."""

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Write a control."""


def _units(source: FrameSource) -> ExtensionUnits:
    if not isinstance(source, ExtensionUnits):
        raise cannot_command(source)
    return source


def run_shutter(source: FrameSource) -> None:
    """Run a flat-field correction; raises `DeviceError` where the source has no controls."""
    _units(source).set_control(*RUN_FFC, b"\x01")


def ask_scale(source: FrameSource) -> float:
    """K per count by the extension unit, NaN if TLinear is off or there is no reply."""
    replies = [_ask(source, control, 4) for control in (TLINEAR, TLINEAR_RESOLUTION)]
    if not all(replies):
        return math.nan
    linear, resolution = (int.from_bytes(reply, "little") for reply in replies)
    return RESOLUTION_K.get((linear, resolution), math.nan)


def _ask(source: FrameSource, control: tuple[int, int], length: int) -> bytes:
    """The value of a control, empty without a reply."""
    try:
        return _units(source).get_control(*control, length)
    except DeviceError:
        return b""
