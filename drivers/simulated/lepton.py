"""The far end of the PureThermal camera: a Lepton 3.5 that images the scene.

A `fieldkit.model.device.FrameSource`: 160x122 words of Y16 a frame, telemetry rows included, with the
kernel's stamp and sequence number, and the controls of the board. Written from the same published layout as
the driver, in the other direction: word numbers count through both rows below a 160x120 image, controls are
(unit, selector). Times are monotonic nanoseconds.
"""

from __future__ import annotations

import base64
import enum
import json
import struct
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.drivers import options
from fieldkit.drivers.cameras.y16 import sizes_of
from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.device import Buffer, DeviceSettings
from fieldkit.model.errors import DeviceError, DeviceLostError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Correction, Scene
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.faults import SHUTTER_STEP_K
from fieldkit.simulation.simulated_clock import SimulatedClock

# --- the shutter

CORRECTION_NS = 800_000_000
AUTOMATIC_NS = 180_000_000_000
_ANNOUNCED_NS = 2_000_000_000


class ShutterState(enum.IntEnum):
    """As in the telemetry."""

    IMMINENT = 1
    RUNNING = 2
    DONE = 3


@dataclass(frozen=True, slots=True)
class ShutterStatus:
    """State at one time, when the latest correction began, number and end of the last finished one."""

    state: ShutterState
    began_ns: int
    number: int
    ended_ns: int


class Shutter:
    """Remembers every correction since the camera was switched on.

    `unasked_ns` are times at which it corrects itself off schedule.
    """

    def __init__(self, on_ns: int, unasked_ns: Sequence[int]) -> None:
        self._began = [on_ns]
        self._unasked = sorted(unasked_ns)

    def run(self, now_ns: int) -> None:
        """Correct now, unless a correction runs already."""
        if self.at(now_ns).state is not ShutterState.RUNNING:
            self._began.append(now_ns)

    def at(self, mono_ns: int) -> ShutterStatus:
        """The shutter at a time; what the camera does by itself until then is done."""
        while (due_ns := self._next_unasked()) <= mono_ns:
            self._began.append(due_ns)
        latest = bisect_right(self._began, mono_ns) - 1
        began_ns = self._began[latest]
        running = latest > 0 and mono_ns < began_ns + CORRECTION_NS
        last = latest - running
        state = ShutterState.RUNNING if running else ShutterState.DONE
        if mono_ns >= began_ns + AUTOMATIC_NS - _ANNOUNCED_NS:
            state = ShutterState.IMMINENT
        return ShutterStatus(state, began_ns, last, self._began[last] + CORRECTION_NS)

    def _next_unasked(self) -> int:
        """The next correction that the camera makes by itself."""
        latest_ns = self._began[-1]
        unasked_ns = (time_ns for time_ns in self._unasked if time_ns > latest_ns)
        return min(latest_ns + AUTOMATIC_NS, next(unasked_ns, latest_ns + AUTOMATIC_NS))


SERIAL = struct.pack("<Q", 0x00A1_0F1E_1D00_0001)
RUN_FFC = (6, 17)
CONTROLS = {
    (4, 8): b"500-0771-01".ljust(32, b"\0"),
    (6, 3): SERIAL,
    (0x15, 18): struct.pack("<I", 1),
    (0x15, 19): struct.pack("<I", 1),
}
"""Those that the driver reads: part number, serial number, TLinear, and its resolution of 0.01 K."""
_FLUX = (8192, 29515, 8192, 29515, 8192, 29515, 0, 29515)
_REVISION = 14
_COUNTS_PER_KELVIN = np.float32(100)


def _low_first(value: int) -> tuple[int, int]:
    return value & 0xFFFF, value >> 16 & 0xFFFF


PERIOD_NS = round(SECOND_NS / 8.7)
LATENCY_S = 0.045
"""From the exposure to the first byte on the cable."""
_LATENCY_NS = round(LATENCY_S * SECOND_NS)
_TRANSFER_NS = 60_000_000  # 39 kB over full-speed USB
_QUEUED = 4  # buffers the kernel keeps for a slow reader
_WARM_NS = 600 * SECOND_NS  # the camera was switched on before
_CLOCK_TOO_FAST = 20e-6
_COUNTS_PER_FRAME = 3  # the sensor counts at 27 Hz and every third frame is sent
_FPA_ABOVE_AIR_K, _HOUSING_ABOVE_AIR_K = 18.0, 14.0


_ARRAY_NOISE_K = 0.1
"""Noise of a pixel of the MLX90640 at one frame a second, by its datasheet."""


def frame_shape(settings: DeviceSettings) -> tuple[int, int]:
    """Rows and columns of a simulated camera's frames."""
    cols, rows = sizes_of(settings)[0] if settings.driver == "y16" else FRAME_SHAPE[::-1]
    return rows, cols


class SimulatedLepton:
    """A PureThermal board with a Lepton 3.5; satisfies `fieldkit.model.device.FrameSource`.

    It may be closed and read again: closing only lets go of it. It shows everything `offset_k` too warm.
    """

    backend = "simulated"
    port = "simulated"
    settings = DeviceSettings("camera", "purethermal", "simulated")

    def __init__(self, scene: Scene, clock: SimulatedClock, offset_k: float = 0.0) -> None:
        self._scene, self._clock, self._offset_k = scene, clock, np.float32(offset_k)
        self._on_ns = clock.mono_ns() - _WARM_NS
        self._next: int | None = None  # None: not streaming
        unasked = [time_ns for span in scene.fault_spans(FaultKind.SHUTTER) for time_ns in span]
        self._shutter = Shutter(self._on_ns, [clock.to_mono_ns(time_ns) for time_ns in unasked])
        self._drawn: tuple[int, bytes] = (-1, b"")

    # --- frames

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame when its last byte is here, or None; see `FrameSource`."""
        self._refuse_if_unplugged()
        number = self._next = self._upcoming()
        here_ns = self._stamp(number) + _TRANSFER_NS
        deadline_ns = self._clock.mono_ns() + round(timeout_s * SECOND_NS)
        self._clock.sleep_until(min(here_ns, deadline_ns))
        self._refuse_if_unplugged()
        if here_ns > deadline_ns or self._is_silent(deadline_ns):
            return None
        self._next = number + 1
        return Buffer(self._bytes(number), self._stamp(number), number)

    def skip_until(self, mono_ns: int) -> None:
        """Let frames go by undrawn; the next one begins at or after that time."""
        self._refuse_if_unplugged()
        self._clock.sleep_until(mono_ns)
        self._refuse_if_unplugged()
        self._next = max(self._upcoming(), self._index(mono_ns - 1) + 1)

    def close(self) -> None:
        """End the stream; a later `read` begins a new one."""
        self._next = None

    def _upcoming(self) -> int:
        """The frame to deliver next: the first of a stream, or the oldest that is still queued."""
        now_ns = self._clock.mono_ns()
        if self._next is None:
            return self._index(now_ns) + 1
        return max(self._next, self._index(now_ns - _TRANSFER_NS) - _QUEUED + 1)

    def _refuse_if_unplugged(self) -> None:
        if self._scene.is_on(FaultKind.CABLE, self._clock.to_utc_ns(self._clock.mono_ns())):
            raise DeviceLostError("the simulated camera is unplugged", fix="plug the cable back in")

    def _is_silent(self, until_ns: int) -> bool:
        """True if no frame is delivered now; if so waits until that time, as the kernel would."""
        if not self._scene.is_on(FaultKind.SILENT, self._clock.to_utc_ns(self._clock.mono_ns())):
            return False
        self._clock.sleep_until(until_ns)
        return True

    def _stamp(self, number: int) -> int:
        return self._on_ns + number * PERIOD_NS

    def _index(self, mono_ns: int) -> int:
        """The last frame that began at or before a time."""
        return (mono_ns - self._on_ns) // PERIOD_NS

    def _seen_ns(self, number: int) -> int:
        return self._stamp(number) - _LATENCY_NS

    def _bytes(self, number: int) -> bytes:
        number = self._frozen(number)
        if self._drawn[0] != number:
            self._drawn = number, self._draw(number)
        return self._drawn[1]

    def _frozen(self, number: int) -> int:
        """The frame that is sent in the place of `number`: itself, unless the camera hangs."""
        seen_ns = self._clock.to_utc_ns(self._seen_ns(number))
        for begin_ns, end_ns in self._scene.fault_spans(FaultKind.FROZEN):
            if begin_ns <= seen_ns < end_ns:
                return self._index(self._clock.to_mono_ns(begin_ns) + _LATENCY_NS)
        return number

    def _draw(self, number: int) -> bytes:
        """Bytes of a frame; while the shutter is closed they show what was seen before."""
        shutter = self._shutter.at(self._seen_ns(number))
        drawn_number = self._index(shutter.began_ns) if shutter.state is ShutterState.RUNNING else number
        seen_ns = self._seen_ns(drawn_number)
        kelvin = self._scene.frame(self._clock.to_utc_ns(seen_ns), drawn_number, self._correction(seen_ns))
        telemetry = self._telemetry(self._seen_ns(number), number)
        return self._encode(kelvin + self._offset_k, drawn_number, telemetry)

    def _encode(self, kelvin: SingleArray, number: int, telemetry: bytes) -> bytes:
        """The bytes of the frame drawn as `number`."""
        return _words(kelvin * _COUNTS_PER_KELVIN) + telemetry

    def _correction(self, mono_ns: int) -> Correction:
        last = self._shutter.at(mono_ns)
        ended_ns = self._clock.to_utc_ns(last.ended_ns)
        wrong_k = SHUTTER_STEP_K if self._scene.is_on(FaultKind.SHUTTER, ended_ns) else 0.0
        return Correction(last.number, ended_ns, wrong_k)

    # --- the board

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Read a control; raises `DeviceError` where there is none of that number and length."""
        self._refuse_if_unplugged()
        value = CONTROLS.get((unit, selector), b"")
        if len(value) != length:
            raise DeviceError(f"the simulated board has no control {unit}/{selector} of {length} bytes")
        return value

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Run a correction; raises `DeviceError` for any other control."""
        self._refuse_if_unplugged()
        if (unit, selector) != RUN_FFC:
            raise DeviceError(f"the simulated board keeps control {unit}/{selector} as it is")
        self._shutter.run(self._clock.mono_ns())

    def _telemetry(self, mono_ns: int, number: int) -> bytes:
        """Two rows of 160 words below a frame."""
        shutter = self._shutter.at(mono_ns)
        air_k = self._scene.at(self._clock.to_utc_ns(mono_ns)).air_temperature_k
        fpa, housing = (round(100 * (air_k + above)) for above in (_FPA_ABOVE_AIR_K, _HOUSING_ABOVE_AIR_K))
        words = np.zeros(320, dtype="<u2")
        words[0] = _REVISION
        words[1:3] = _low_first(self._uptime_ms(mono_ns))
        words[3:5] = _low_first(shutter.state << 4)
        words[5:9] = np.frombuffer(SERIAL, "<u2")
        words[20:22] = _low_first(_COUNTS_PER_FRAME * number)
        words[24], words[26], words[29], words[32] = fpa, housing, fpa, housing
        words[30:32] = _low_first(self._uptime_ms(shutter.ended_ns))
        words[74] = 3  # log2 of the frames a correction averages
        words[99:107] = _FLUX
        words[208:210] = 1  # TLinear is on, its resolution 0.01 K
        return bytes(words.tobytes())

    def _uptime_ms(self, mono_ns: int) -> int:
        return int((mono_ns - self._on_ns) * (1.0 + _CLOCK_TOO_FAST)) // 1_000_000


class SimulatedY16(SimulatedLepton):
    """A camera of the size and scale that the driver's options state, with the noise of a cheap one."""

    def _encode(self, kelvin: SingleArray, number: int, telemetry: bytes) -> bytes:
        import cv2

        shape, random = frame_shape(self.settings), np.random.default_rng([self._scene.seed, number, 8])
        sized = cv2.resize(kelvin, shape[::-1], interpolation=cv2.INTER_AREA)
        kelvin = sized + np.float32(_ARRAY_NOISE_K) * random.standard_normal(shape, np.float32)
        offset_k = options.number(self.settings, "kelvin_offset", 0.0)
        return _words((kelvin - offset_k) / options.number(self.settings, "kelvin_per_count", 0.01))


def _words(counts: FloatArray | SingleArray) -> bytes:
    return bytes(np.rint(counts).astype("<u2").tobytes())


_PIXELS, _TELEMETRY = 38_400, 480  # bytes: 160x120 words, and three rows of 80


class SimulatedTCam(SimulatedLepton):
    """A tCam-Mini with a Lepton 3.5, by the maker's description; sends frames as packets of JSON."""

    def read(self, timeout_s: float) -> Buffer | None:
        """The next packet when its last byte is here, or None; see `FrameSource`."""
        buffer = super().read(timeout_s)
        return replace(buffer, data=image_packet(buffer.data)) if buffer else None


def image_packet(frame: bytes) -> bytes:
    """The packet of a Lepton's frame with telemetry, pixels first."""
    parts = {"radiometric": frame[:_PIXELS], "telemetry": frame[_PIXELS : _PIXELS + _TELEMETRY]}
    metadata = {"metadata": {"Camera": "tCam-Mini-0000", "Model": 2, "Version": "3.1"}}
    image = metadata | {name: base64.b64encode(part).decode() for name, part in parts.items()}
    return b"\x02" + json.dumps(image).encode() + b"\x03"
