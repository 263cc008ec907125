"""tCam, tCam-Mini and tCam-POE: a FLIR Lepton 3.5 in the network.

A packet is 02, JSON, 03, by TCP on port 5001. An image has ``metadata``, ``radiometric`` (160x120 words,
base64) and ``telemetry`` (the Lepton's words 0-239, base64): a PureThermal's frame with telemetry. Without
AGC the pixels are kelvin x 100, in low gain x 10; the telemetry reports which. Other packets answer commands.

Source: the maker's description, danjulio/lepton, ESP32/tCam-Mini/readme.md. Opening switches AGC off, which
the camera keeps; gain and emissivity stay as they are and are recorded.
"""

from __future__ import annotations

import binascii
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from fieldkit.drivers.cameras import camera, purethermal
from fieldkit.drivers.cameras.camera import DecodedFrame, summary
from fieldkit.drivers.cameras.source import CameraDriver, OpenedSource
from fieldkit.drivers.cameras.streaming import PortSource
from fieldkit.drivers.connections import SocketPort, address_of, announced
from fieldkit.drivers.decoding import Layout, Parsed, Record, RecordDriver, Rejected, skip_to
from fieldkit.drivers.framing import Port
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import DeviceSettings, DiscoveredDevice, FrameSource

PORT = 5001
SERVICE = "_tcam-socket._tcp.local."
START, END = b"\x02", b"\x03"
LONGEST = 1 << 17  # an image is 51 980 bytes; white space may stand in it
PIXELS = 2 * 160 * 120
TELEMETRY, ROWS = 480, 640  # bytes: what the Lepton fills of two rows of an image
REPLY_S = 2.0
AGC_OFF = {"cmd": "set_config", "args": {"agc_enabled": 0}}
STREAM_ON = {"cmd": "stream_on", "args": {"delay_msec": 0, "num_frames": 0}}
STREAM_OFF, RUN_FFC = {"cmd": "stream_off"}, {"cmd": "run_ffc"}
GAINS = {0: "high", 1: "low", 2: "automatic"}
_ADVICE = "switch the camera on and join its network (tCam-Mini-...), or give port = host:port"


def packet(content: Mapping[str, Any]) -> bytes:
    """A command, ready to send."""
    return START + json.dumps(content).encode() + END


def content_of(data: bytes) -> dict[str, Any]:
    """The JSON object of a packet, empty if there is none."""
    try:
        content = json.loads(data.strip(START + END))
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def decode(data: bytes) -> DecodedFrame | Rejected:
    """The image of a packet."""
    content = content_of(data)
    if not content.keys() >= {"radiometric", "telemetry"}:
        return Rejected(len(data), "not an image: no radiometric data and telemetry")
    try:
        pixels, telemetry = (
            binascii.a2b_base64(content[key], strict_mode=True) for key in ("radiometric", "telemetry")
        )
    except (ValueError, TypeError) as error:
        return Rejected(len(data), f"not base64: {error}")
    if (len(pixels), len(telemetry)) != (PIXELS, TELEMETRY):
        sizes = f"{len(pixels)} and {len(telemetry)} bytes"
        return Rejected(len(data), f"{sizes}; an image has {PIXELS} and {TELEMETRY} of telemetry")
    return purethermal.decode(pixels + telemetry.ljust(ROWS, b"\0"))


def parse(buffer: bytes) -> Parsed:
    """The packet at the start of `buffer`."""
    if not buffer.startswith(START[: len(buffer)]):
        return Rejected(skip_to(START, buffer), "does not begin with 02")
    end = buffer.find(END) + 1
    again = buffer.find(START, 1, end or len(buffer))
    if again > 0:  # JSON has no such byte: the rest of this one was lost
        return Rejected(again, "a packet begins before this one ends")
    if not end:
        return None if len(buffer) < LONGEST else Rejected(skip_to(START, buffer), "no end of packet found")
    data = buffer[:end]
    frame = decode(data)
    if isinstance(frame, DecodedFrame):
        return Record.of(end, summary(frame), "frame of 160x120")
    names = content_of(data).keys()
    return (
        Rejected(end, frame.reason) if not names or "radiometric" in names else Record(end, note=min(names))
    )


LAYOUT = Layout(parse, LONGEST)


class TCam(CameraDriver, RecordDriver):
    """Driver of tCam cameras; `port` is the camera's address, options are those of every camera."""

    name = "tcam"
    title = "tCam with FLIR Lepton"
    host_port = PORT
    options: tuple[str, ...] = camera.OPTIONS
    layout = LAYOUT

    def find(self) -> list[DiscoveredDevice]:
        """Cameras that announce themselves in this network, from firmware 3.0 on."""
        return [
            DiscoveredDevice(
                self.name, "", host if port == PORT else f"{host}:{port}", f"{self.title}, {name}"
            )
            for name, host, port in announced(SERVICE)
        ]

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Connect, switch AGC off, and let the camera stream as fast as it can."""
        source, facts, run_shutter = _simulated_camera(settings.source) or _connect(settings, clock)
        handle = OpenedSource(source, settings.identity)
        first = camera.first_frame(source, decode, settings.name, clock)
        info = camera.describe(
            settings, handle, first, facts, vendor="danjulio / FLIR", rate_hz=purethermal.RATE_HZ
        )
        info = replace(info, device_time_unit="ms")
        return camera.ThermalCamera(info, source, decode, clock, run_shutter)


_Camera = tuple[FrameSource, dict[str, Any], Callable[[], None]]
"""Its frames, what it reports of itself, and how its shutter is run."""


def _connect(settings: DeviceSettings, clock: Clock) -> _Camera:
    port = SocketPort(address_of(settings, PORT), clock, "tCam", _ADVICE)
    facts = _facts(port, clock)
    port.write(packet(STREAM_ON))
    source = PortSource(port, LAYOUT, clock, packet(STREAM_OFF))
    return source, facts, lambda: port.write(packet(RUN_FFC))


def _simulated_camera(source: FrameSource | None) -> _Camera | None:
    return (source, {"model": "tCam"}, partial(purethermal.run_shutter, source)) if source else None


def _facts(port: Port, clock: Clock) -> dict[str, Any]:
    """The camera's report of itself, after AGC is off; without what it does not answer."""
    status = _ask(port, "status", clock)
    port.write(packet(AGC_OFF))
    config = _ask(port, "config", clock)
    facts = {
        "model": "tCam", "serial_number": status.get("Camera"), "firmware": status.get("Version"),
        "gain": GAINS.get(config.get("gain_mode", -1)),
        "emissivity": config["emissivity"] / 100 if "emissivity" in config else None,
    }  # fmt: skip
    return {key: value for key, value in facts.items() if value is not None}


def _ask(port: Port, what: str, clock: Clock) -> dict[str, Any]:
    """The reply to ``get_<what>``, empty if none comes; replies to other commands are passed over."""
    port.write(packet({"cmd": f"get_{what}"}))
    for left_s in time_left(clock, REPLY_S):
        packet_read = port.read(LAYOUT, left_s)
        reply = content_of(packet_read.raw).get(what) if packet_read else None
        if isinstance(reply, dict):
            return reply
    return {}
