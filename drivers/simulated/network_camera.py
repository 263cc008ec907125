"""The far end of a tCam: the simulated Lepton, whose frames are sent as packets of JSON.

Written from the maker's description, in the other direction than the driver.
"""

from __future__ import annotations

import base64
import json
from dataclasses import replace

from fieldkit.drivers.simulated.lepton import SimulatedLepton
from fieldkit.model.device import Buffer

_PIXELS, _TELEMETRY = 38_400, 480  # bytes: 160x120 words, and three rows of 80


class SimulatedTCam(SimulatedLepton):
    """A tCam-Mini with a Lepton 3.5; satisfies `fieldkit.model.device.FrameSource`."""

    def read(self, timeout_s: float) -> Buffer | None:
        """The next packet when its last byte is here, or None; see `FrameSource`."""
        found = super().read(timeout_s)
        return replace(found, data=image_packet(found.data)) if found else None


def image_packet(frame: bytes) -> bytes:
    """The packet of a Lepton's frame with telemetry, pixels first."""
    parts = {"radiometric": frame[:_PIXELS], "telemetry": frame[_PIXELS : _PIXELS + _TELEMETRY]}
    metadata = {"metadata": {"Camera": "tCam-Mini-0000", "Model": 2, "Version": "3.1"}}
    image = metadata | {name: base64.b64encode(part).decode() for name, part in parts.items()}
    return b"\x02" + json.dumps(image).encode() + b"\x03"
