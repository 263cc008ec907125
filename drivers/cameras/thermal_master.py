"""Thermal Master P2 (UVC), P1, P3 and Vantrue TS2 (bulk): kelvin x 64 below a grey image and two rows.

A frame is h rows of image, 2 of metadata (not understood, kept) and h of temperatures. The P2 comes as YUYV
256x386; two sources agree on the layout. The others rest on one; their counters reveal every lost frame.

P1, P3 and TS2 have no kernel driver: bulk transfers from endpoint 0x81 of interface 1 (alternate 1). Each
frame stands between two markers of 12 bytes: length 0C, sync (8C or 8D begins, 8E or 8F ends), u32 counter
equal at both ends, u32 second counter, u16 third counter that rises 40 a frame, modulo 2048: frames lost in
gaps below two seconds are counted. A command has 18 bytes: type (as written), u16 parameter, u16 register, 6
zeros, u16 reply length, 2 zeros, CRC-16 CCITT (start 0). Its status: 1 busy, 2 accepted and the reply ready,
3 done, else refused. Source: one public program and its forks, of which one measured the status on a TS2.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera, p2pro
from fieldkit.drivers.cameras.camera import DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, OpenedSource, cameras, open_source
from fieldkit.drivers.cameras.streaming import StreamSource
from fieldkit.drivers.decoding import Decoded, Rejected, text_of
from fieldkit.drivers.identity import candidates
from fieldkit.drivers.usb import await_ready, pick_usb, read_until, usb_errors, usb_nodes
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import Buffer, DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import NO_COUNTER

# --- P1, P3 and TS2: a camera without a kernel driver, by pyusb

KINDS = {(0x3474, 0x45C2): (160, 120), (0x3474, 0x45A2): (256, 192), (0x3474, 0x45F2): (256, 192)}
MARKER = struct.Struct("<BBIIH")
BEGIN, FINISH = (0x8C, 0x8D), (0x8E, 0x8F)
STEP, WRAP = 40, 2048
ENDPOINT, CHUNK = 0x81, 16_384
SEND, RECEIVE, STATUS = (0x41, 0x20), (0xC1, 0x21), (0xC1, 0x22)
READ, GAIN, SHUTTER = b"\x01\x01", b"\x01\x2f", b"\x01\x36"
READ_SUBJECT, SHUTTER_SUBJECT = 0x81, 0x43
SERIAL_NUMBER, PART_NUMBER = 7, 6
GAINS = {b"\0": "low", b"\1": "high"}
BUSY, REPLYING, DONE = 1, 2, 3


class Marker(NamedTuple):
    """One marker, parsed."""

    length: int
    sync: int
    counter: int
    second: int
    third: int


def command(kind: bytes, subject: int, register: int = 0, reply: int = 0) -> bytes:
    """A command, ready to send."""
    body = kind + struct.pack("<HH6xH2x", subject, register, reply)
    return body + binascii.crc_hqx(body, 0).to_bytes(2, "little")


def marker(data: bytes, sync: tuple[int, int]) -> Marker | None:
    """The marker at the start of `data`, None if there is none of that kind."""
    if len(data) < MARKER.size:
        return None
    candidate = Marker(*MARKER.unpack_from(data))
    return candidate if candidate.length == MARKER.size and candidate.sync in sync else None


class Assembler:
    """Frames of `length` bytes out of transfers; `sequence` counts those the camera made, lost ones too."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._data = b""
        self._third = -1
        self.sequence: int = -1
        self.rejected: int = 0

    def feed(self, chunk: bytes) -> bytes | None:
        """A frame with its markers, once it is complete."""
        self._data += chunk
        self._to_begin()
        whole = self._length + 2 * MARKER.size
        if len(self._data) < whole:
            return None
        frame, self._data = self._data[:whole], self._data[whole:]
        begin, end = marker(frame, BEGIN), marker(frame[-MARKER.size :], FINISH)
        if begin is None or end is None or begin.counter != end.counter:
            self.rejected += 1
            self._data = frame[1:] + self._data
            return None
        self._count(begin.third)
        return frame

    def _to_begin(self) -> None:
        """Drop what stands before the next begin marker."""
        start = 0
        while (start := self._data.find(bytes([MARKER.size]), start)) >= 0:
            if marker(self._data[start:], BEGIN) or len(self._data) - start < MARKER.size:
                break
            start += 1
        self._data = self._data[start:] if start >= 0 else b""

    def _count(self, third: int) -> None:
        passed = (third - self._third) % WRAP / STEP if self._third >= 0 else 1
        self._third = third
        self.sequence += max(round(passed), 1)


class BulkSource(StreamSource):
    """A camera without a kernel driver as a source of buffers; libusb waits by itself."""

    backend = "pyusb"

    def __init__(self, settings: DeviceSettings, clock: Clock) -> None:
        self._unit, self.usb = pick_usb(settings, tuple(KINDS))
        super().__init__(f"usb:{self.usb.path}", clock)
        self.size: tuple[int, int] = KINDS[self.usb.vendor, self.usb.product]
        width, height = self.size
        self._assembler = Assembler(2 * (2 * height + 2) * width)
        with usb_errors(self.port):
            self._unit.set_interface_altsetting(1, 1)
            self._unit.ctrl_transfer(0x40, 0xEE, 0, 1)

    def _receive(self, timeout_s: float) -> Buffer | None:
        """The next frame with its markers, stamped when it was complete."""
        for left_s in time_left(self._clock, timeout_s):
            with usb_errors(self.port):
                chunk = read_until(self._unit, ENDPOINT, CHUNK, max(int(left_s * 1000.0), 1))
            frame = self._assembler.feed(chunk) if chunk else None
            if frame is not None:
                return Buffer(frame, self._clock.mono_ns(), self._assembler.sequence)
        return None

    def text(self, register: int) -> str:
        """A register of 64 characters."""
        return text_of(self._request(READ, register, 64))

    def gain(self) -> str:
        """``high``, or ``low``, which is for scenes above 150 °C alone."""
        reply = self._request(GAIN, 0, 1)
        return GAINS.get(reply, f"unknown ({reply.hex()})")

    def run_shutter(self) -> None:
        """Close the shutter and calibrate."""
        with usb_errors(self.port):
            self._unit.ctrl_transfer(*SEND, 0, 0, command(SHUTTER, SHUTTER_SUBJECT))
            await_ready(self._is_ready, self._clock, self.port)

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        import usb.util

        usb.util.dispose_resources(self._unit)

    def _request(self, kind: bytes, register: int, length: int) -> bytes:
        with usb_errors(self.port):
            self._unit.ctrl_transfer(*SEND, 0, 0, command(kind, READ_SUBJECT, register, length))
            await_ready(self._is_ready, self._clock, self.port)
            return bytes(self._unit.ctrl_transfer(*RECEIVE, 0, 0, length))

    def _is_ready(self) -> bool:
        status = self._unit.ctrl_transfer(*STATUS, 0, 0, 1)[0]
        if status not in (BUSY, REPLYING, DONE):
            raise DeviceError(f"refuses the command: status {status}", place=self.port)
        return bool(status != BUSY)


WANTED = CameraFormat(((0x3474, 0x4281),), "YUYV", ((256, 386),))
SIZES = ((256, 192), (160, 120))
LENGTHS = {2 * (2 * height + 2) * width: (width, height) for width, height in SIZES}
MARKED = (0, MARKER.size, 2 * MARKER.size)
"""Bytes beside a frame: public programs keep it bare, with the marker before it, or with both."""

MODELS = ("auto", "p2", "bulk")


def decode(data: bytes) -> DecodedFrame | Rejected:
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
            return Rejected(len(data), f"markers disagree: frame {begin.counter} and {end.counter}")
        counter, data = begin.counter, data[MARKER.size : MARKER.size + bare]
    width, height = LENGTHS[bare]
    pixels = pixel_view(data, (2 * height + 2, width))
    rows, counts = pixels[height : height + 2], pixels[height + 2 :]
    return DecodedFrame(counts, rows, p2pro.SCALE, flags=p2pro.flags(counts), device_seq=counter)


class ThermalMaster(CameraDriver):
    """Driver of the Thermal Master family.

    Options: those of every camera, and `model` (``p2``, ``bulk`` for P1, P3 and TS2, or ``auto``).
    """

    name = "thermal-master"
    title = "Thermal Master P1, P2, P3"
    video = WANTED
    options: tuple[str, ...] = (*camera.OPTIONS, "model")

    def find(self) -> list[DiscoveredDevice]:
        """Connected cameras of the family, with and without a kernel driver."""
        nodes = cameras() + usb_nodes(tuple(KINDS))
        return candidates(self.name, self.title, nodes, {*WANTED.kinds, *KINDS})

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        return decode_frames(data, decode, tuple(length + more for length in LENGTHS for more in MARKED))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open whichever of the family is there."""
        model = options.text(settings, "model", "auto", MODELS)
        is_video = settings.source is not None or model == "p2" or (model == "auto" and _has_video(settings))
        bulk = None if is_video else BulkSource(settings, clock)
        if bulk is None:
            handle = open_source(settings, WANTED, clock)
        else:
            handle = OpenedSource(bulk, settings.identity or bulk.usb.as_text(), bulk.usb)
        first = camera.first_frame(handle.source, decode, settings.name, clock)
        facts = _facts(bulk)
        info = camera.describe(settings, handle, first, facts, vendor="Thermal Master", rate_hz=p2pro.RATE_HZ)
        return camera.ThermalCamera(info, handle.source, decode, clock, bulk.run_shutter if bulk else None)


def _has_video(settings: DeviceSettings) -> bool:
    """True if a member with a kernel driver is wanted."""
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
