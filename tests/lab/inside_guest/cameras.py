"""Reading a camera in the guest through fieldkit's own sources, and driving one that streams."""

from __future__ import annotations

import time
import zlib
from typing import Any

from fieldkit.drivers import registry
from fieldkit.drivers.cameras.source import OpenCvSource
from fieldkit.drivers.cameras.v4l2 import V4l2Source
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Camera, DeviceSettings, FrameSource
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import Quality
from fieldkit.physics.camera_laws import frame_k

PATIENCE_S = 20.0
SOURCES = {"v4l2": V4l2Source, "opencv": OpenCvSource}


def stream(
    path: str, backend: str, fourcc: str, width: int, height: int, pictures: int, actions: list[list[Any]]
) -> dict[str, Any]:
    """Read that many pictures; their checksums, sequence numbers, stamps and ages.

    `actions` are [after this many pictures, method of the source, its arguments, bytes in hexadecimal];
    `said` holds their answers. Raises `TimeoutError` if pictures stop coming.
    """
    source: FrameSource = SOURCES[backend](path, fourcc, [(width, height)], HostClock())
    report: dict[str, Any] = {"sums": [], "sequences": [], "stamps_ns": [], "ages_ns": [], "said": []}
    todo = list(actions)
    try:
        while len(report["sums"]) < pictures:
            while todo and len(report["sums"]) >= todo[0][0]:
                report["said"].append(_act(source, *todo.pop(0)[1:]))
            buffer = source.read(PATIENCE_S)
            if buffer is None:
                raise TimeoutError(f"no picture within {PATIENCE_S} s after {len(report['sums'])}")
            report["sums"].append(zlib.crc32(buffer.data))
            report["sequences"].append(buffer.sequence)
            report["stamps_ns"].append(buffer.mono_ns)
            report["ages_ns"].append(time.monotonic_ns() - buffer.mono_ns)
    finally:
        source.close()
    return report


def drive(
    driver: str, identity: str, pictures: int, shutter_after: int, options: dict[str, Any]
) -> dict[str, Any]:
    """Open a camera by its driver, read pictures, run the shutter among them; all it reports."""
    settings = DeviceSettings("camera", driver, identity=identity, options=options)
    device = registry.open_device(settings, HostClock())
    assert isinstance(device, Camera)
    frames, ran = [], None
    try:
        while len(frames) < pictures:
            if len(frames) == shutter_after and ran is None:
                ran = device.run_shutter()
            frame = device.read(PATIENCE_S)
            assert frame is not None
            frames.append(frame)
    finally:
        device.close()
    return {
        "shape": device.info.shape,
        "settings": dict(device.info.settings),
        "model": device.info.model,
        "ran": ran,
        "means_k": [
            float(frame_k(device.info, frame.counts, frame.metadata_rows).mean()) for frame in frames
        ],
        "flags": [[flag.name for flag in Quality if flag and flag in frame.quality] for frame in frames],
        "rejected": device.rejected,
    }


def _act(source: FrameSource, method: str, *arguments: Any) -> str:
    given = [bytes.fromhex(a) if isinstance(a, str) else a for a in arguments]
    try:
        answer = getattr(source, method)(*given)
    except DeviceError as error:
        return f"{type(error).__name__}: {error}"
    return answer.hex() if isinstance(answer, bytes) else str(answer)
