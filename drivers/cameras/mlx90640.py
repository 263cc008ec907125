"""MLX90640, MLX90641 and MLX90642 on boards with a serial port: 32x24 or 16x12 thermopiles.

The module GY-MCU90640 sends frames of 1544 bytes at 115200 8N1: 5A 5A, length 1538 (02 06), 768 words of
degrees Celsius x 100, signed, row by row, the sensor's own temperature likewise, and the sum of the 771 words
before, modulo 65536; all little-endian. Commands are four bytes, the last the sum of the others: A5 25 rate,
A5 35 02 continuous output, A5 45 emissivity x 100, A5 55 01 to ask for that; the answer is 5A 5A, emissivity
x 100, sum. Source: the maker's "GY-MCU90640 Module User Manual V1.0" (vvkuryshev/GY-MCU90640-RPI-Python).

Other boards print degrees Celsius in text, separated by commas: 768 (MLX90641: 192) in a line, or in rows
that end at a word, as the examples of SparkFun (``Read time: 250`` behind the last) and Adafruit do. In both
the board has applied an emissivity; the example of SparkFun uses 0.95. There is no shutter.
"""

from __future__ import annotations

import re
import struct

import numpy as np

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import DecodedFrame, summary
from fieldkit.drivers.cameras.source import OpenedSource
from fieldkit.drivers.cameras.streaming import PortSource
from fieldkit.drivers.decoding import Layout, Parsed, Record, Rejected, skip_to
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.ports import Probe, SerialDriver, baud, open_port
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import DeviceSettings
from fieldkit.model.units import CELSIUS_ZERO_K

SHAPES = {768: (24, 32), 192: (12, 16)}
SCALE = 0.01
ZERO = round(CELSIUS_ZERO_K / SCALE)  # 0 °C in counts: kelvin x 100
HEADER, START = b"\x5a\x5a\x02\x06", b"\x5a"
LENGTH = 1544
LONGEST = 10_000  # bytes: 768 numbers with signs, commas, spaces and line ends
LONGEST_ROW = 32
LINE = Line(115_200)
CONTINUOUS, ASK_EMISSIVITY = b"\xa5\x35\x02", b"\xa5\x55\x01"
RATES_HZ = (0.5, 1.0, 2.0, 4.0, 8.0)
REPLY_S = 2.0
_WORDS = struct.Struct("<770h")  # behind the header: pixels, own temperature, sum
_OTHER = re.compile(rb"[A-Za-z=#]")
_NUMBERS = re.compile(rb"[-+\d.,\s]*")


def command(start: bytes, *more: int) -> bytes:
    """A command of the module, with its sum."""
    body = start + bytes(more)
    return body + bytes([sum(body) & 0xFF])


def decode(data: bytes) -> DecodedFrame | Rejected:
    """A frame of the module, or numbers as text."""
    if not data.startswith(HEADER):
        return _image(_numbers(data), len(data))
    if len(data) != LENGTH:
        return Rejected(len(data), f"{len(data)} bytes; a frame of the module has {LENGTH}")
    if sum(np.frombuffer(data, "<u2")[:-1].tolist()) & 0xFFFF != int.from_bytes(data[-2:], "little"):
        return Rejected(len(data), "the sum does not match")
    *pixels, own, _ = _WORDS.unpack_from(data, len(HEADER))
    frame = _image([pixel * SCALE for pixel in pixels], len(data))
    if isinstance(frame, Rejected):
        return frame
    return frame._replace(fpa_temperature_k=own * SCALE + CELSIUS_ZERO_K)


def _image(celsius: list[float] | None, length: int) -> DecodedFrame | Rejected:
    """Temperatures as kelvin x 100; what no sensor shows becomes the end of the range."""
    shape = SHAPES.get(len(celsius or ()))
    if celsius is None or shape is None:
        sizes = " or ".join(map(str, SHAPES))
        return Rejected(length, f"{len(celsius or ())} numbers; an image has {sizes}")
    kelvin_100 = np.rint(np.array(celsius) / SCALE) + ZERO
    counts = np.clip(kelvin_100, 0, 0xFFFF).astype(np.uint16).reshape(shape)
    return DecodedFrame(counts, scale=SCALE, shutter=False)


def _numbers(text: bytes) -> list[float] | None:
    """Numbers between commas and line ends, None if something else is among them."""
    if not _NUMBERS.fullmatch(text):
        return None
    try:
        return [float(cell) for cell in re.split(rb"[,\n]", text) if cell.strip()]
    except ValueError:  # 21.5.3, or two numbers without a comma
        return None


def parse(buffer: bytes) -> Parsed:
    """The frame, answer or line at the start of `buffer`."""
    return _of_module(buffer) if buffer.startswith(START) else _of_text(buffer)


def _of_module(buffer: bytes) -> Parsed:
    if len(buffer) < len(HEADER):
        return None
    if not buffer.startswith(HEADER):
        if buffer[1:2] == START and sum(buffer[:3]) & 0xFF == buffer[3]:
            return Record(4, note=f"emissivity {buffer[2] / 100:g}")
        return Rejected(skip_to(START, buffer), "5A begins neither a frame nor a reply")
    if len(buffer) < LENGTH:
        return None
    frame = decode(buffer[:LENGTH])
    if isinstance(frame, Rejected):
        return Rejected(skip_to(START, buffer), frame.reason)
    return Record.of(LENGTH, summary(frame), "frame of 32x24")


def _of_text(buffer: bytes) -> Parsed:
    end = buffer.find(b"\n") + 1
    binary = buffer.find(START)
    if binary >= 0 and (not end or binary < end):
        return Rejected(binary, "does not begin with 5A 5A")
    if not end:
        return None if len(buffer) < LONGEST else Rejected(len(buffer), "no line end found")
    row = _numbers(buffer[:end])
    if row is None or not row:
        return Record(end, note=buffer[:end].strip().decode("latin-1")[:60])
    if len(row) <= LONGEST_ROW:  # one of many: the image ends at the first word that is no number
        word = _OTHER.search(buffer)
        if word is None:
            return None if len(buffer) < LONGEST else Rejected(end, "rows without an end")
        end = word.start()
    frame = decode(buffer[:end])
    if isinstance(frame, Rejected):
        return Rejected(end, frame.reason)
    rows, columns = frame.counts.shape
    return Record.of(end, summary(frame), f"frame of {columns}x{rows}")


LAYOUT = Layout(parse, LONGEST)


class Mlx90640(SerialDriver):
    """Driver of MLX9064x on serial boards.

    Options: those of every camera, `baud` (115200), and for the GY-MCU90640 `rate_hz` (0.5, 1, 2, 4, 8)
    and `emissivity` (1.0 leaves the correction to fieldkit); without them the module's own stay.
    """

    name = "mlx90640"
    title = "MLX90640 on a serial board"
    quantity = "brightness_temperature"
    options: tuple[str, ...] = (*camera.OPTIONS, "baud", "rate_hz", "emissivity")
    layout = LAYOUT
    noise_k: float = 0.2  # datasheet: 0.1 K at one frame a second, and grows with the square root of the rate
    probes = (Probe(LINE),)

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the port, set what the options request, and wait for a frame."""
        commands = _commands_for(settings)
        port = open_port(settings, Line(baud(settings, LINE.baud)), clock)
        for command in commands:
            port.write(command)
        facts = {"model": "MLX9064x", **_emissivity(port, clock)}
        source = PortSource(port, LAYOUT, clock)
        first = camera.first_frame(source, decode, settings.name, clock)
        handle = OpenedSource(source, settings.identity or port.identity)
        rate_hz = options.number(settings, "rate_hz", 0.0)
        info = camera.describe(settings, handle, first, facts, vendor="Melexis", rate_hz=rate_hz)
        return camera.ThermalCamera(info, source, decode, clock)


def _commands_for(settings: DeviceSettings) -> list[bytes]:
    """Commands for the options; boards that print text ignore them. Raises `ConfigError`."""
    commands = [command(CONTINUOUS)]
    if "emissivity" in settings.options:
        percent = round(100 * options.number(settings, "emissivity", 1.0, (0.01, 1.0)))
        commands.insert(0, command(b"\xa5\x45", percent))
    if "rate_hz" in settings.options:
        rate_hz = options.number(settings, "rate_hz", 4.0, (RATES_HZ[0], RATES_HZ[-1]))
        nearest = min(RATES_HZ, key=lambda rate: abs(rate - rate_hz))
        commands.insert(0, command(b"\xa5\x25", RATES_HZ.index(nearest)))
    return commands


def _emissivity(port: Port, clock: Clock) -> dict[str, float]:
    """The emissivity that the module has applied; nothing for boards that print text."""
    port.write(command(ASK_EMISSIVITY))
    for left_s in time_left(clock, REPLY_S):
        reply = port.read(LAYOUT, left_s)
        if reply and reply.record.note.startswith("emissivity "):
            return {"emissivity": float(reply.record.note.split()[1])}
    return {}
