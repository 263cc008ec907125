"""The far end of the PureThermal camera: a Lepton 3.5 that looks at the scene.

A `fieldkit.model.device.FrameSource`: 160x122 words of Y16 a picture, telemetry rows included,
with the kernel's stamp and sequence number, and the controls of the board.
"""

from __future__ import annotations

import numpy as np

from fieldkit.drivers.simulated.board import FFC_MODE, RUN_FFC, RUN_RADIOMETRIC_FFC, Board, Vitals
from fieldkit.drivers.simulated.shutter import Shutter, State
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceLostError
from fieldkit.simulation import Correction, FaultKind, Scene
from fieldkit.simulation.faults import SHUTTER_STEP_K
from fieldkit.simulation.simulated_clock import SECOND_NS, SimulatedClock

PERIOD_NS = round(SECOND_NS / 8.7)
LATENCY_S = 0.045
"""From the exposure to the first byte on the cable."""
_LATENCY_NS = round(LATENCY_S * SECOND_NS)
_TRANSFER_NS = 60_000_000  # 39 kB over full-speed USB
_QUEUED = 4  # buffers the kernel keeps for a slow reader
_WARM_NS = 600 * SECOND_NS  # the camera was switched on before
_CLOCK_TOO_FAST = 20e-6
_COUNTS_PER_PICTURE = 3  # the sensor counts at 27 Hz and every third picture is sent
_FPA_ABOVE_AIR_K, _HOUSING_ABOVE_AIR_K = 18.0, 14.0


class SimulatedLepton:
    """A PureThermal board with a Lepton 3.5; satisfies `fieldkit.model.device.FrameSource`.

    It may be closed and read again: closing only lets go of it.
    """

    backend = "simulated"
    port = "simulated"

    def __init__(self, scene: Scene, clock: SimulatedClock) -> None:
        self._scene, self._clock = scene, clock
        self._on_ns = clock.mono_ns() - _WARM_NS
        self._next: int | None = None  # None: not streaming
        self._board = Board()
        unasked = [time_ns for span in scene.fault_spans(FaultKind.SHUTTER) for time_ns in span]
        self._shutter = Shutter(self._on_ns, [clock.to_mono_ns(time_ns) for time_ns in unasked])
        self._drawn: tuple[int, bytes] = (-1, b"")

    # --- pictures

    def read(self, timeout_s: float) -> Buffer | None:
        """The next picture when its last byte is here, or None; see `FrameSource`."""
        self._refuse_if_unplugged()
        number = self._next = self._upcoming()
        here_ns = self._stamp(number) + _TRANSFER_NS
        deadline_ns = self._clock.mono_ns() + round(timeout_s * SECOND_NS)
        self._clock.sleep_until(min(here_ns, deadline_ns))
        self._refuse_if_unplugged()
        if here_ns > deadline_ns:
            return None
        self._next = number + 1
        return Buffer(self._bytes(number), self._stamp(number), number)

    def skip_until(self, mono_ns: int) -> None:
        """Let pictures go by undrawn; the next one begins at or after that time."""
        self._refuse_if_unplugged()
        self._clock.sleep_until(mono_ns)
        self._refuse_if_unplugged()
        self._next = max(self._upcoming(), self._index(mono_ns - 1) + 1)

    def close(self) -> None:
        """End the stream; a later `read` begins a new one."""
        self._next = None

    def _upcoming(self) -> int:
        """The picture to deliver next: the first of a stream, or the oldest that is still queued."""
        now_ns = self._clock.mono_ns()
        if self._next is None:
            return self._index(now_ns) + 1
        return max(self._next, self._index(now_ns - _TRANSFER_NS) - _QUEUED + 1)

    def _refuse_if_unplugged(self) -> None:
        if self._scene.is_on(FaultKind.CABLE, self._clock.to_utc_ns(self._clock.mono_ns())):
            raise DeviceLostError("the simulated camera is unplugged", fix="plug the cable back in")

    def _stamp(self, number: int) -> int:
        return self._on_ns + number * PERIOD_NS

    def _index(self, mono_ns: int) -> int:
        """The last picture that began at or before a time."""
        return (mono_ns - self._on_ns) // PERIOD_NS

    def _seen_ns(self, number: int) -> int:
        return self._stamp(number) - _LATENCY_NS

    def _bytes(self, number: int) -> bytes:
        number = self._frozen(number)
        if self._drawn[0] != number:
            self._drawn = number, self._draw(number)
        return self._drawn[1]

    def _frozen(self, number: int) -> int:
        """The picture that is sent in the place of `number`: itself, unless the camera hangs."""
        seen_ns = self._clock.to_utc_ns(self._seen_ns(number))
        for begin_ns, end_ns in self._scene.fault_spans(FaultKind.FROZEN):
            if begin_ns <= seen_ns < end_ns:
                return self._index(self._clock.to_mono_ns(begin_ns) + _LATENCY_NS)
        return number

    def _draw(self, number: int) -> bytes:
        """Bytes of a picture; while the shutter is closed they show what was seen before."""
        shutter = self._shutter.at(self._seen_ns(number))
        shown = self._index(shutter.began_ns) if shutter.state is State.RUNNING else number
        seen_ns = self._seen_ns(shown)
        kelvin = self._scene.picture(self._clock.to_utc_ns(seen_ns), shown, self._correction(seen_ns))
        counts = np.rint(kelvin * np.float32(self._board.counts_per_kelvin)).astype("<u2")
        return bytes(counts.tobytes()) + self._board.telemetry(self._vitals(self._seen_ns(number), number))

    def _correction(self, mono_ns: int) -> Correction:
        last = self._shutter.at(mono_ns)
        ended_ns = self._clock.to_utc_ns(last.ended_ns)
        wrong_k = SHUTTER_STEP_K if self._scene.is_on(FaultKind.SHUTTER, ended_ns) else 0.0
        return Correction(last.number, ended_ns, wrong_k)

    # --- the board

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Read a control; raises `DeviceError` where the board has none of that number and length."""
        self._refuse_if_unplugged()
        now_ns = self._clock.mono_ns()
        return self._board.get((unit, selector), length, self._vitals(now_ns, self._index(now_ns)))

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Change a control, or run a correction; raises `DeviceError` where that is impossible."""
        self._refuse_if_unplugged()
        if (unit, selector) in (RUN_FFC, RUN_RADIOMETRIC_FFC):
            self._shutter.run(self._clock.mono_ns())
            return
        self._board.set((unit, selector), data)
        if (unit, selector) == FFC_MODE:
            self._shutter.is_automatic = self._board.is_automatic

    def _vitals(self, mono_ns: int, number: int) -> Vitals:
        shutter = self._shutter.at(mono_ns)
        air_k = self._scene.at(self._clock.to_utc_ns(mono_ns)).air_temperature_k
        return Vitals(
            uptime_ms=self._uptime_ms(mono_ns),
            frame_counter=_COUNTS_PER_PICTURE * number,
            state=shutter.state,
            corrected_ms=self._uptime_ms(shutter.ended_ns),
            fpa_k=air_k + _FPA_ABOVE_AIR_K,
            housing_k=air_k + _HOUSING_ABOVE_AIR_K,
        )

    def _uptime_ms(self, mono_ns: int) -> int:
        return int((mono_ns - self._on_ns) * (1.0 + _CLOCK_TOO_FAST)) // 1_000_000
