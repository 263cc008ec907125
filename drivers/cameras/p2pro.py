"""InfiRay P2 Pro, Topdon TC001 and TS001, UNI-T UTi261M and relatives, 256x192.

Raw format YUYV 256x384 at 25 Hz: rows 0-191 a grey image, rows 192-383 little-endian words of kelvin x 64.
Five public viewers and a decoded public frame agree. The ids 0bda:5830 and :5840 belong to a chip maker and
are shared by webcams, so the frame size is the real signature. The camera has no clock, counter or shutter
flag: a running correction shows as frames that stand still. In its first nine seconds frames are 0x8000
everywhere, then uncorrected; both are flagged.

Commands go beside the stream, as vendor requests to an interface: these need no claim, so the stream goes on;
nothing here detaches, resets or configures. Writing needs the right to the raw USB node, apart from the video
node's. Codes, windows and byte orders are as the best known public program sends them. Units are disputed:
emissivity 1/128 by the maker's header, 1/127 by that program, distance 1/128 m or 1/163.835 m; the maker's
are used here, so an emissivity is known to 0.8 %, a distance to a quarter. Flash access and reset to ROM
exist and are omitted on purpose.

Short commands: code and parameter little-endian, length big-endian, written to 0x1d00, reply at 0x1d08. Long
ones: code little-endian, the rest big-endian, written to 0x9d00 and 0x1d08, reply (big-endian) at 0x1d10.
Before and after, the status byte at 0x0200 must be free of bits 0 (busy) and 1 (not ready).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import DecodedFrame, decode_frames, extremes, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, open_source
from fieldkit.drivers.decoding import Decoded, Rejected, text_of
from fieldkit.drivers.identity import UsbIdentity, permission_fix
from fieldkit.drivers.usb import await_ready, usb_errors, usb_instruments
from fieldkit.model.arrays import CountArray
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError
from fieldkit.model.samples import Quality

# --- commands, by pyusb beside the streaming kernel driver

WRITE, READ, VALUE = (0x41, 0x45), (0xC1, 0x44), 0x78
STATUS, COMMAND, COMMAND_WITH_DATA, DATA, LONG_DATA = 0x0200, 0x1D00, 0x9D00, 0x1D08, 0x1D10
INFORMATION, PROPERTIES, AUTO_SHUTTER, CALIBRATE = 0x8405, 0x8514, 0x8214, 0xC10D
SET = 0x4000
DISTANCE, EMISSIVITY, GAIN = 0, 3, 5
GAINS = ("low", "high")
PER_UNIT = 128
"""Counts of emissivity 1, and of one metre, by the maker's header."""

FEWEST_OF_1 = 127
"""Counts from which an emissivity is 1 by one of the two readings."""

LONGEST_M = 200.0
ITEMS = {"firmware": (1, 8), "model": (6, 48), "serial_number": (7, 16)}
READ_BACK = {
    "camera_distance_counts": DISTANCE,
    "camera_reflected_k": 1,
    "camera_air_k": 2,
    "camera_emissivity_counts": EMISSIVITY,
}


@dataclass(frozen=True, slots=True)
class CameraSetting:
    """A setting to write and read back: `table` and `item` locate it, `slack` how many counts may differ."""

    name: str
    value: object
    table: int
    item: int
    counts: int
    slack: int = 0


def requested_settings(settings: DeviceSettings) -> list[CameraSetting]:
    """Settings that the options `gain`, `emissivity`, `distance_m` and `auto_shutter` request.

    Raises `ConfigError` for values that no camera of the family has.
    """
    requested: list[CameraSetting] = []
    if gain := options.text(settings, "gain", "", ("", *GAINS)):
        requested.append(CameraSetting("gain", gain, PROPERTIES, GAIN, GAINS.index(gain)))
    of_emissivity, of_distance = (EMISSIVITY, (1 / PER_UNIT, 1.0), 1), (DISTANCE, (0.0, LONGEST_M), 0)
    for key, (item, within, slack) in {"emissivity": of_emissivity, "distance_m": of_distance}.items():
        if not math.isnan(value := options.number(settings, key, math.nan, within)):
            counts = round(value * PER_UNIT)
            requested.append(CameraSetting(key, value, PROPERTIES, item, counts, slack))
    if "auto_shutter" in settings.options:
        on = options.flag(settings, "auto_shutter", True)
        requested.append(CameraSetting("auto_shutter", on, AUTO_SHUTTER, 0, int(on)))
    return requested


class Commands:
    """The command channel of one camera; `unit` is a pyusb device."""

    def __init__(self, unit: Any, place: str, clock: Clock) -> None:
        self._unit = unit
        self._place = place
        self._clock = clock

    def information(self, item: int, length: int) -> bytes:
        """Device information: 1 firmware date, 6 part number, 7 serial number."""
        self._write(COMMAND, struct.pack("<HI", INFORMATION, item) + struct.pack(">H", length))
        self._wait()
        return self._read(DATA, length)

    def get(self, table: int, item: int) -> int:
        """One temperature property or setting of the automatic shutter."""
        self._long(table, item, 0, 0, 2)
        return int.from_bytes(self._read(LONG_DATA, 2), "big")

    def set(self, table: int, item: int, value: int) -> int:
        """Write one property and read it back: some firmware refuses silently."""
        self._long(table | SET, item, value, 0, 0)
        return self.get(table, item)

    def calibrate(self) -> None:
        """Close the shutter and take a new offset."""
        self._write(COMMAND, struct.pack("<HI2x", CALIBRATE, 0))
        self._wait()

    def _long(self, *numbers: int) -> None:
        code, *parameters = numbers
        packed = struct.pack("<H", code) + struct.pack(">HIII", *parameters)
        self._write(COMMAND_WITH_DATA, packed[:8])
        self._write(DATA, packed[8:])
        self._wait()

    def _write(self, window: int, data: bytes) -> None:
        with usb_errors(self._place):
            self._unit.ctrl_transfer(*WRITE, VALUE, window, data)

    def _read(self, window: int, length: int) -> bytes:
        with usb_errors(self._place):
            return bytes(self._unit.ctrl_transfer(*READ, VALUE, window, length))

    def _wait(self) -> None:
        """Until the camera is neither busy nor unready; its error code becomes a `DeviceError`."""
        await_ready(self._is_ready, self._clock, self._place)

    def _is_ready(self) -> bool:
        status = self._read(STATUS, 1)[0]
        if status & 3 and status & 0xFC:
            raise DeviceError(f"refuses the command: status {status:#04x}", place=self._place)
        return not status & 3


def connect(
    usb: UsbIdentity, clock: Clock, requested: Sequence[CameraSetting] = ()
) -> tuple[Commands | None, dict[str, Any]]:
    """The command channel of a camera and the facts it reports; (None, reason) where it cannot be reached.

    Frames work without commands, so trouble here is a fact to record, not an error, unless a setting
    was requested.
    """
    units = [unit for unit, found in usb_instruments(((usb.vendor, usb.product),)) if found.path == usb.path]
    if not units:
        if requested:
            raise DeviceAccessError(
                "cannot be set: the camera's commands cannot be reached",
                place=requested[0].name,
                fix=permission_fix("plugdev"),
            )
        return None, {"commands": "not reachable"}
    commands = Commands(units[0], f"USB {usb.path}", clock)
    try:
        for setting in requested:
            _apply(commands, setting)
        return commands, _facts(commands)
    except DeviceError as error:
        if requested:
            raise
        return None, {"commands": error.message}


def _apply(commands: Commands, setting: CameraSetting) -> None:
    """Write a setting; an automatic shutter that is off would leave the first frames uncorrected."""
    read_back = commands.set(setting.table, setting.item, setting.counts)
    if abs(read_back - setting.counts) > setting.slack:
        raise DeviceError(
            f"the camera did not accept {setting.value}: sent {setting.counts}, read back {read_back}",
            place=setting.name,
            fix=f"omit {setting.name} from the configuration",
        )
    if setting.table == AUTO_SHUTTER and not setting.counts:
        commands.calibrate()


def _facts(commands: Commands) -> dict[str, Any]:
    texts = {key: commands.information(*item) for key, item in ITEMS.items()}
    facts: dict[str, Any] = {key: text_of(raw) for key, raw in texts.items()}
    gain = commands.get(PROPERTIES, GAIN)
    facts["gain"] = GAINS[gain] if gain < len(GAINS) else f"unknown ({gain})"
    facts.update({key: commands.get(PROPERTIES, item) for key, item in READ_BACK.items()})
    facts["auto_shutter"] = commands.get(AUTO_SHUTTER, 0)
    if counts := facts["camera_emissivity_counts"]:
        facts["emissivity"] = 1.0 if counts >= FEWEST_OF_1 else round(counts / PER_UNIT, 4)
    return facts


WIDTH, HEIGHT = 256, 192
LENGTH = 2 * WIDTH * 2 * HEIGHT
WANTED = CameraFormat(
    ((0x0BDA, 0x5830), (0x0BDA, 0x5840)),
    "YUYV",
    ((WIDTH, 2 * HEIGHT),),
    otherwise="a webcam with the same chip, or a thermal camera that sends its image alone",
)
SCALE = 1 / 64
RATE_HZ = 25.0
GREY = (0x8000, 0x80FF)  # the grey half in place of temperatures; a camera that starts sends 0x8000
UNCORRECTED_K = 100 * SCALE  # mean step of neighbours: about 6 counts when clean, 320 when uncorrected


def decode(data: bytes) -> DecodedFrame | Rejected:
    """The temperature half of a frame; its grey half is dropped."""
    if len(data) != LENGTH:
        return Rejected(len(data), f"{len(data)} bytes; a frame of {WIDTH}x{2 * HEIGHT} has {LENGTH}")
    counts = pixel_view(data, (HEIGHT, WIDTH), LENGTH // 2)
    return DecodedFrame(counts, scale=SCALE, flags=flags(counts))


def flags(counts: CountArray, scale: float = SCALE) -> Quality:
    """`NO_VALUE` for a frame that is not started, not corrected, or the grey half."""
    middle = len(counts) // 2
    row = counts[middle].astype(np.int32)
    step = np.abs(row[1:] - row[:-1]).mean()
    # halves that are exchanged or shifted leave one of these rows grey
    has_no_value = step * scale > UNCORRECTED_K or any(_is_grey(counts[place]) for place in (0, middle, -1))
    return Quality.NO_VALUE if has_no_value else Quality.GOOD


def _is_grey(row: CountArray) -> bool:
    coldest, hottest = extremes(row)
    return GREY[0] <= coldest <= hottest <= GREY[1]


class P2Pro(CameraDriver):
    """Driver of the InfiRay 256x192 family.

    Options: those of every camera, and what is set in the camera and read back when opening: `gain` (``high``
    or ``low``), `emissivity` (1.0 leaves the correction to fieldkit), `distance_m`, `auto_shutter`.
    """

    name = "p2pro"
    title = "InfiRay P2 Pro / Topdon TC001"
    options: tuple[str, ...] = (*camera.OPTIONS, "gain", "emissivity", "distance_m", "auto_shutter")
    video = WANTED
    caveat = "webcams share this id; only the frame size 256x384 decides"

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        return decode_frames(data, decode, (LENGTH,))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera, apply the requested settings, record what its commands report."""
        requested = requested_settings(settings)
        handle = open_source(settings, WANTED, clock)
        first = camera.first_frame(handle.source, decode, settings.name, clock)
        commands, facts = connect(handle.usb, clock, requested)
        info = camera.describe(settings, handle, first, facts, vendor="InfiRay", rate_hz=RATE_HZ)
        return camera.ThermalCamera(
            info, handle.source, decode, clock, commands.calibrate if commands else None
        )
