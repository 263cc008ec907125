"""The far ends of the serial meters: what they measure, and the bytes they send.

Written from the same protocol sheets as the drivers (see `fieldkit.drivers.meters`), in
the other direction, and sharing nothing with them but the line's speed.
"""

from __future__ import annotations

import math
import struct
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.drivers.ports import Line
from fieldkit.drivers.simulated.pseudo_terminal import PseudoTerminal
from fieldkit.model.air import is_air_temperature
from fieldkit.model.device import DeviceSettings
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.physics.facet import FloatArray
from fieldkit.simulation import Scene
from fieldkit.simulation.simulated_clock import SimulatedClock

_LINE = Line(9600)
_SPOILT_SHARE = 0.7  # of the records during a garbled minute
_OPEN_PROBE = 0x7FFF


class SimulatedMeter(ABC):
    """An instrument on a pseudo-terminal, looking at the scene through the clock.

    `latency_s` is how old the value is that the first byte of a record announces, and
    `response_s` the time constant of the sensor: the truth, which `declared` puts into the
    options unless others are given.
    """

    latency_s: float = 0.0
    response_s: float = 0.0

    def __init__(self, scene: Scene, clock: SimulatedClock, settings: DeviceSettings) -> None:
        self._scene, self._clock = scene, clock
        self._every_ns = max(1, round(settings.every_s * SECOND_NS))
        self._terminal = PseudoTerminal(clock)
        self._closed = False
        self.path: str = self._terminal.path
        self._start()

    def declared(self) -> dict[str, float]:
        """Options by which the driver's stream declares latency and response."""
        return {"latency_s": self.latency_s, "response_s": self.response_s}

    def close(self) -> None:
        """Pull the plug."""
        self._closed = True
        self._terminal.close()

    @abstractmethod
    def _start(self) -> None:
        """Begin to send or to receive."""

    def _measured_ns(self, first_byte_ns: int) -> int:
        """UTC of the value that a record beginning at this monotonic time announces."""
        return self._clock.to_utc_ns(first_byte_ns - round(self.latency_s * SECOND_NS))

    def _send_from(self, first_byte_ns: int, record: bytes) -> int:
        """Put a record on the wire from that time on; returns when its last byte is out."""
        out_ns = first_byte_ns + len(record) * _LINE.byte_ns
        self._clock.call_at(out_ns, lambda: self._deliver(record))
        return out_ns

    def _deliver(self, record: bytes) -> None:
        if self._closed:
            return
        now_ns = self._clock.to_utc_ns(self._clock.mono_ns())
        if self._scene.is_on(FaultKind.GARBLED, now_ns):
            record = garbled(record, np.random.default_rng([self._scene.seed, now_ns]))
        self._terminal.send(record)


class SimulatedLutron(SimulatedMeter):
    """A light meter that lies flat and sends a record every `every_s`, unrequested."""

    latency_s: float = 0.2

    def _start(self) -> None:
        self._clock.call_at(self._clock.mono_ns() + self._every_ns, self._measure)

    def _measure(self) -> None:
        if self._closed:
            return
        now_ns = self._clock.mono_ns()
        lux = self._scene.lux_reading(self._measured_ns(now_ns))
        overload = self._scene.is_on(FaultKind.OVERRANGE, self._clock.to_utc_ns(now_ns))
        self._send_from(now_ns, lutron_overload("15") if overload else lutron_record(lux, "15"))
        self._clock.call_at(now_ns + self._every_ns, self._measure)


class SimulatedCenter309(SimulatedMeter):
    """A thermometer that replies to `A` and `K`.

    Of its four probes, those that the option `labels` names as air hang in the air, the others lie in the
    first regions.
    """

    latency_s: float = 0.1
    _THINKS_NS = 20_000_000

    def __init__(self, scene: Scene, clock: SimulatedClock, settings: DeviceSettings) -> None:
        self.response_s: float = scene.response_s
        labels = [str(label) for label in settings.options.get("labels", ())]
        self._in_air = [is_air_temperature(label) for label in (*labels, "", "", "", "")[:4]]
        super().__init__(scene, clock, settings)

    def _start(self) -> None:
        self._terminal.listen(self._receive)

    def _receive(self, letters: bytes) -> None:
        """Reply to each letter in turn; the others are key presses without a reply."""
        free_ns = self._clock.mono_ns()
        for letter in letters:
            first_byte_ns = free_ns + self._THINKS_NS
            if letter == ord("K"):
                free_ns = self._send_from(first_byte_ns, b"309\r")
            elif letter == ord("A"):
                kelvin = self._probes_k(self._measured_ns(first_byte_ns))
                free_ns = self._send_from(first_byte_ns, center_309_record(kelvin - CELSIUS_ZERO_K))

    def _probes_k(self, time_ns: int) -> FloatArray:
        in_beds = iter(self._scene.probe_readings(time_ns).tolist())
        air_k = self._scene.air_reading(time_ns) if any(self._in_air) else np.nan
        return np.array([air_k if in_air else next(in_beds, np.nan) for in_air in self._in_air])


def lutron_record(value: float, unit: str, display: str = "1") -> bytes:
    """16 bytes of the Lutron stream: as many decimals as fit a display of five digits."""
    decimals = 0 if abs(value) >= 10_000 else 1 if abs(value) >= 1_000 else 2
    digits = round(abs(value) * 10**decimals)
    sign = "1" if value < 0 else "0"
    return b"\x02" + f"4{display}{unit}{sign}{decimals}{digits:08}".encode() + b"\r"


def lutron_overload(unit: str, display: str = "1") -> bytes:
    """16 bytes of the Lutron stream for a value beyond the range: 18 in place of its digits."""
    return b"\x02" + f"4{display}{unit}00".encode() + b"\x18" * 8 + b"\r"


def center_309_record(celsius: ArrayLike) -> bytes:
    """45 bytes of the Center 309 for up to four probes, tenths of °C; NaN and absent probes are open."""
    probes = (*np.atleast_1d(celsius)[:4].tolist(), *[math.nan] * 4)[:4]
    record = bytearray(45)
    # automatic power off (bit 7 of the second status byte) is disabled, as for any long recording
    record[0], record[1], record[2], record[44] = 0x02, 0x80, 0x00, 0x03
    tenths = [_OPEN_PROBE if math.isnan(probe) else round(10.0 * probe) for probe in probes]
    struct.pack_into(">4h", record, 7, *tenths)
    record[39] = sum(1 << place for place, probe in enumerate(probes) if math.isnan(probe))
    return bytes(record)


def garbled(record: bytes, random: np.random.Generator) -> bytes:
    """A record after a bad contact: mostly with bytes lost and others changed."""
    if random.random() > _SPOILT_SHARE:
        return record
    kept = bytearray(record)
    for _ in range(int(random.integers(1, 4))):
        del kept[int(random.integers(len(kept)))]
        kept[int(random.integers(len(kept)))] ^= int(random.integers(1, 256))
    return bytes(kept)
