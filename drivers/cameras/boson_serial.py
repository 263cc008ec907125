"""The serial side of a FLIR Boson: framed questions and answers at 921600 baud.

A frame is 8E, channel 00, u32 sequence, u32 function, u32 status (FFFFFFFF when asking), payload, u16 CRC,
AE, all big-endian. CRC-16 CCITT with start 1D0F over channel to payload, before escaping: inside a frame 8E
becomes 9E 81, 9E becomes 9E 91, AE becomes 9E A1. An answer counts only with the sequence number of its
question: late ones do occur. Two independent public programs agree on the frame; function numbers stand
mostly on one of them.
"""

from __future__ import annotations

import binascii
import struct
from typing import NamedTuple

from fieldkit.drivers.ports import Line, SerialPort
from fieldkit.drivers.records import Layout, Record, Rejected, Taken
from fieldkit.model.clock import Clock
from fieldkit.model.errors import DeviceError, DeviceTimeoutError

LINE = Line(921_600)
START, ESCAPE, END = 0x8E, 0x9E, 0xAE
LONGEST = 1544
ANSWER_S = 0.5
SERIAL_NUMBER, PART_NUMBER, RUN_FFC, FFC_STATE = 0x0005_0002, 0x0005_0004, 0x0005_0007, 0x0005_000C
FFC_MODE, GAIN, FPA_TEMPERATURE = 0x0005_0013, 0x0005_0015, 0x0005_0030
TLINEAR, USB_MODE = 0x003E_0001, 0x000E_000D
USB_MODE_TLINEAR = 2
ERRORS = {0x0161: "unknown command", 0x0162: "bad payload", 0x0203: "out of range"}
GAINS = ("high", "low", "automatic", "dual", "manual")
FFC_MODES = ("manual", "automatic", "external")
FFC_RUNNING = 2
_HEADER = struct.Struct(">BIII")


class Message(NamedTuple):
    """One frame taken apart."""

    sequence: int
    function: int
    status: int
    payload: bytes


def pack(sequence: int, function: int, payload: bytes = b"", status: int = 0xFFFF_FFFF) -> bytes:
    """A frame, ready to send."""
    body = _HEADER.pack(0, sequence, function, status) + payload
    body += binascii.crc_hqx(body, 0x1D0F).to_bytes(2, "big")
    escaped = b"".join(
        bytes([ESCAPE, byte - 0xD]) if byte in (START, ESCAPE, END) else bytes([byte]) for byte in body
    )
    return bytes([START]) + escaped + bytes([END])


def unpack(frame: bytes) -> Message | str:
    """What a frame from 8E to AE says, or why it is none."""
    body = bytearray()
    inside = iter(frame[1:-1])
    for byte in inside:
        body.append((next(inside, 0) + 0xD) & 0xFF if byte == ESCAPE else byte)
    if len(body) < _HEADER.size + 2:
        return "too short"
    if binascii.crc_hqx(bytes(body[:-2]), 0x1D0F) != int.from_bytes(body[-2:], "big"):
        return "the CRC does not fit"
    _, sequence, function, status = _HEADER.unpack_from(body)
    return Message(sequence, function, status, bytes(body[_HEADER.size : -2]))


def take(buffer: bytes) -> Taken:
    """The frame at the start of `buffer`."""
    if buffer[0] != START:
        found = buffer.find(bytes([START]))
        return Rejected(found if found > 0 else len(buffer), "does not begin with 8E")
    end = buffer.find(bytes([END]))
    if end < 0:
        return None
    message = unpack(buffer[: end + 1])
    if isinstance(message, str):
        return Rejected(end + 1, message)
    return Record(
        end + 1,
        note=f"function {message.function:#010x}, status {message.status:#x}, {message.payload.hex(' ')}",
    )


LAYOUT = Layout(take, LONGEST)


class BosonSerial:
    """Commands to one Boson; raises `DeviceError` when it refuses, `DeviceTimeoutError` when it is silent."""

    def __init__(self, path: str, clock: Clock) -> None:
        self._port = SerialPort(path, LINE, clock)
        self._sequence = 0

    def ask(self, function: int, payload: bytes = b"") -> bytes:
        """Send a command, return its answer's payload."""
        self._sequence += 1
        self._port.write(pack(self._sequence, function, payload))
        while found := self._port.read(LAYOUT, ANSWER_S):
            message = unpack(found.raw)
            if isinstance(message, str) or message.sequence != self._sequence:
                continue
            if message.status:
                reason = ERRORS.get(message.status, f"error {message.status:#x}")
                raise DeviceError(f"the Boson at {self._port.path} refuses {function:#010x}: {reason}")
            return message.payload
        raise DeviceTimeoutError(
            f"the Boson at {self._port.path} does not answer", fix="keep ModemManager off it: fieldkit doctor"
        )

    def number(self, function: int) -> int:
        """An answer as an unsigned whole number."""
        return int.from_bytes(self.ask(function), "big")

    def fpa_temperature_k(self) -> float:
        """Temperature of the sensor."""
        return int.from_bytes(self.ask(FPA_TEMPERATURE)[:2], "big", signed=True) / 10 + 273.15

    def is_shutter_running(self) -> bool:
        """Whether a correction runs now."""
        return self.number(FFC_STATE) == FFC_RUNNING

    def make_radiometric(self) -> None:
        """Pixels in hundredths of a kelvin; only radiometric models take it."""
        self.ask(TLINEAR, (1).to_bytes(4, "big"))
        self.ask(USB_MODE, USB_MODE_TLINEAR.to_bytes(4, "big"))

    def facts(self) -> dict[str, str]:
        """Serial number, part number, gain and FFC mode as read back."""
        gain, mode = self.number(GAIN), self.number(FFC_MODE)
        part = self.ask(PART_NUMBER).split(b"\0")[0].decode("ascii", "replace").strip()
        return {
            "serial_number": str(self.number(SERIAL_NUMBER)),
            "model": part,
            "gain": GAINS[gain] if gain < len(GAINS) else "unknown",
            "ffc_mode": FFC_MODES[mode] if mode < len(FFC_MODES) else "unknown",
        }

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        self._port.close()
