"""Vendor commands of the InfiRay 256x192 family, by pyusb beside the streaming kernel driver.

Vendor requests to an interface need no claim, so the stream goes on; nothing here detaches, resets or
configures. Writing needs the right to the raw USB node, apart from the video node's. Codes, windows and byte
orders as the best known public program puts them on the wire. Units are disputed: emissivity 1/128 by the
maker's header, 1/127 by that program, distance 1/128 m or 1/163.835 m; the maker's are used here, so an
emissivity is known to 0.8 %, a distance to a quarter. Flash access and reset to ROM exist and are left out on
purpose.

Short commands: code and parameter little-endian, length big-endian, written to 0x1d00, answer at 0x1d08.
Long ones: code little-endian, the rest big-endian, written to 0x9d00 and 0x1d08, answer (big-endian) at
0x1d10. Before and after, the status byte at 0x0200 must be free of bits 0 (busy) and 1 (not ready).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.permission import permission_fix
from fieldkit.drivers.usb import explained, usb_instruments
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceTimeoutError

WRITE, READ, VALUE = (0x41, 0x45), (0xC1, 0x44), 0x78
STATUS, COMMAND, COMMAND_WITH_DATA, DATA, LONG_DATA = 0x0200, 0x1D00, 0x9D00, 0x1D08, 0x1D10
INFORMATION, PROPERTIES, AUTO_SHUTTER, CALIBRATE = 0x8405, 0x8514, 0x8214, 0xC10D
SET = 0x4000
DISTANCE, EMISSIVITY, GAIN = 0, 3, 5
GAINS = ("low", "high")
PER_UNIT = 128
"""Counts of emissivity 1, and of one metre, by the maker's header."""

LONGEST_M = 200.0
ITEMS = {"firmware": (1, 8), "model": (6, 48), "serial_number": (7, 16)}
READ_BACK = {
    "camera_distance_counts": DISTANCE,
    "camera_reflected_k": 1,
    "camera_air_k": 2,
    "camera_emissivity_counts": EMISSIVITY,
}
PATIENCE_S = 2.0


@dataclass(frozen=True, slots=True)
class Wish:
    """A setting to write and read back: `table` and `item` say where, `slack` how many counts may differ."""

    name: str
    value: object
    table: int
    item: int
    counts: int
    slack: int = 0


def wishes(settings: DeviceSettings) -> list[Wish]:
    """What the options `gain`, `emissivity`, `distance_m` and `auto_shutter` ask of the camera.

    Raises `ConfigError` for values that no camera of the family has.
    """
    found: list[Wish] = []
    if gain := options.text(settings, "gain", "", ("", *GAINS)):
        found.append(Wish("gain", gain, PROPERTIES, GAIN, GAINS.index(gain)))
    emissivity = options.number(settings, "emissivity", math.nan, (1 / PER_UNIT, 1.0))
    if not math.isnan(emissivity):
        counts = round(emissivity * PER_UNIT)
        found.append(Wish("emissivity", emissivity, PROPERTIES, EMISSIVITY, counts, slack=1))
    distance_m = options.number(settings, "distance_m", math.nan, (0.0, LONGEST_M))
    if not math.isnan(distance_m):
        found.append(Wish("distance_m", distance_m, PROPERTIES, DISTANCE, round(distance_m * PER_UNIT)))
    if "auto_shutter" in settings.options:
        on = options.flag(settings, "auto_shutter", True)
        found.append(Wish("auto_shutter", on, AUTO_SHUTTER, 0, int(on)))
    return found


class Commands:
    """The command channel of one camera; `unit` is a pyusb device."""

    def __init__(self, unit: Any, where: str, clock: Clock) -> None:
        self._unit = unit
        self._where = where
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
        """Write one property and read it back: some firmware refuses without a word."""
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
        with explained(self._where):
            self._unit.ctrl_transfer(*WRITE, VALUE, window, data)

    def _read(self, window: int, length: int) -> bytes:
        with explained(self._where):
            return bytes(self._unit.ctrl_transfer(*READ, VALUE, window, length))

    def _wait(self) -> None:
        """Until the camera is neither busy nor unready; its error code becomes a `DeviceError`."""
        deadline_ns = self._clock.mono_ns() + int(PATIENCE_S * 1e9)
        while (status := self._read(STATUS, 1)[0]) & 3:
            if status & 0xFC:
                raise DeviceError(f"the camera {self._where} refuses the command: status {status:#04x}")
            if self._clock.mono_ns() > deadline_ns:
                raise DeviceTimeoutError(
                    f"the camera {self._where} stays busy", fix="unplug it and plug it in again"
                )
            self._clock.sleep(0.001)


def connect(
    usb: UsbIdentity, clock: Clock, wanted: Sequence[Wish] = ()
) -> tuple[Commands | None, dict[str, Any]]:
    """The command channel of a camera and what it tells; (None, reason) where it cannot be reached.

    Pictures work without commands, so trouble here is a fact to record, not an error, unless a setting
    was asked for.
    """
    units = [unit for unit, found in usb_instruments(((usb.vendor, usb.product),)) if found.path == usb.path]
    if not units:
        if wanted:
            raise DeviceAccessError(
                f"the camera's commands cannot be reached, so its {wanted[0].name} cannot be set",
                fix=permission_fix("plugdev"),
            )
        return None, {"commands": "not reachable"}
    commands = Commands(units[0], f"at USB {usb.path}", clock)
    try:
        for wish in wanted:
            _grant(commands, wish)
        return commands, _facts(commands)
    except DeviceError as error:
        if wanted:
            raise
        return None, {"commands": error.message}


def _grant(commands: Commands, wish: Wish) -> None:
    """Write a setting; an automatic shutter that is off would leave the first pictures uncorrected."""
    taken = commands.set(wish.table, wish.item, wish.counts)
    if abs(taken - wish.counts) > wish.slack:
        raise DeviceError(
            f"the camera did not take {wish.name} = {wish.value}: it was sent {wish.counts} and says {taken}",
            fix=f"leave {wish.name} out of the configuration",
        )
    if wish.table == AUTO_SHUTTER and not wish.counts:
        commands.calibrate()


def _facts(commands: Commands) -> dict[str, Any]:
    texts = {key: commands.information(*item) for key, item in ITEMS.items()}
    facts: dict[str, Any] = {
        key: raw.split(b"\0")[0].decode("ascii", "replace").strip() for key, raw in texts.items()
    }
    gain = commands.get(PROPERTIES, GAIN)
    facts["gain"] = GAINS[gain] if gain < len(GAINS) else f"unknown ({gain})"
    facts.update({key: commands.get(PROPERTIES, item) for key, item in READ_BACK.items()})
    facts["auto_shutter"] = commands.get(AUTO_SHUTTER, 0)
    return facts
