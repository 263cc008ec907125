"""One reading over a pseudo-terminal at 10 Hz: CPU time and delay, beside the loop people write.

Lutron: against pyserial's `read_until` and the same slicing and float. Center 309: against a PyMeasure
instrument, as PyMeasure's guide says to write one for a meter it does not have, and against the bare
`SerialAdapter` below it (`A`, 45 bytes), where PyMeasure is installed.
CPU time is the reading thread's, the median of the readings; the delay runs from the far end's write to the
reading in hand. The two take turns, so that both meet the same machine.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import pty
import struct
import time
import tty
from collections.abc import Callable
from typing import Any

import numpy as np
import serial

from benchmarks.result import Result, Row
from benchmarks.sides import share
from fieldkit.drivers.meters.center import Center309
from fieldkit.drivers.meters.lutron import Lutron
from fieldkit.model.arrays import FloatArray
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
RECORD = bytes.fromhex("02 80 80 00 00 00 00 00 FD FF CC 03 ED 7F FF" + "00" * 24 + "08 00 00 00 00 03")
READINGS, ROUNDS, EVERY_S = 10, 9, 0.1
ONE = "ours stamped, checked, bytes kept; CPU of the reading thread"
LUTRON = Row("lutron", "Lutron, CPU of a reading over a `read_until` loop", "<= 0.5", included=ONE)
CENTER = Row("center", "Center 309, CPU of a reading over a PyMeasure instrument", "<= 0.8", included=ONE)
CENTER_BARE = Row("center-bare", "Center 309, the same over PyMeasure's bare adapter", "<= 0.8", included=ONE)
FORK = multiprocessing.get_context("fork")
Read = Callable[[], Any]


class FarEnd:
    """The far end, a process of its own: sends `record` ten times a second, or replies to `A` and `K`."""

    def __init__(self, record: bytes, *, talks: bool) -> None:
        self._far, self._near = pty.openpty()
        tty.setraw(self._near)
        self.path = os.ttyname(self._near)
        self._said_ns = FORK.Value("q", 0, lock=False)
        self._process = FORK.Process(
            target=self._talk if talks else self._answer, args=(record,), daemon=True
        )
        self._process.start()

    @property
    def said_ns(self) -> int:
        """When it sent its last record."""
        return int(self._said_ns.value)

    def close(self) -> None:
        """Hang up."""
        self._process.terminate()
        self._process.join()
        os.close(self._near)
        os.close(self._far)

    def _talk(self, record: bytes) -> None:
        while True:
            self._send(record)
            time.sleep(EVERY_S)

    def _answer(self, record: bytes) -> None:
        while received := os.read(self._far, 64):
            self._send(b"309\r" if received == b"K" else record)

    def _send(self, record: bytes) -> None:
        self._said_ns.value = time.monotonic_ns()
        os.write(self._far, record)


def _measure(far: FarEnd, read: Read, *, pace: bool) -> FloatArray:
    """(CPU time, delay) of each reading in microseconds, shape (READINGS, 2)."""
    read()
    rows = []
    for _ in range(READINGS):
        if pace:
            time.sleep(EVERY_S)
        started = time.thread_time_ns()
        while read() is None:
            pass
        used_ns, delay_ns = time.thread_time_ns() - started, time.monotonic_ns() - far.said_ns
        rows.append((used_ns / 1e3, delay_ns / 1e3))
    return np.array(rows)


def _with(far: FarEnd, open_reader: Callable[[str], tuple[Read, Callable[[], None]]], *, pace: bool) -> Any:
    read, close = open_reader(far.path)
    try:
        return _measure(far, read, pace=pace)
    finally:
        close()
        far.close()


def _our_lutron(path: str) -> tuple[Read, Callable[[], None]]:
    device = Lutron().open(DeviceSettings("lux", "lutron", port=path), HostClock())
    return lambda: device.read(1.0), device.close


def _their_lutron(path: str) -> tuple[Read, Callable[[], None]]:
    port = serial.Serial(path, 9600, timeout=1.0)

    def read() -> tuple[float, float] | None:
        line = port.read_until(b"\r")
        if len(line) != 16:
            return None
        value = float(line[7:15]) / 10 ** int(line[6:7])
        return time.time(), -value if line[5:6] == b"1" else value

    return read, port.close


def _our_center(path: str) -> tuple[Read, Callable[[], None]]:
    device = Center309().open(DeviceSettings("t", "center-309", port=path, every_s=1e-4), HostClock())
    return lambda: device.read(1.0), device.close


def _channels(frame: bytes) -> tuple[float, ...] | None:
    if len(frame) != 45 or frame[0] != 2 or frame[44] != 3:
        return None
    return tuple(count / 10 for count in struct.unpack(">4h", frame[7:15]))


def _instrument_center(path: str) -> tuple[Read, Callable[[], None]]:
    from pymeasure.adapters import SerialAdapter
    from pymeasure.instruments import Instrument

    class Thermometer(Instrument):  # type: ignore[misc]
        @property
        def temperatures(self) -> tuple[float, ...] | None:
            self.write_bytes(b"A")
            return _channels(self.read_bytes(45))

    adapter = SerialAdapter(path, baudrate=9600, timeout=1.0)
    thermometer = Thermometer(adapter, "Center 309", includeSCPI=False)
    return lambda: thermometer.temperatures, adapter.close


def _adapter_center(path: str) -> tuple[Read, Callable[[], None]]:
    from pymeasure.adapters import SerialAdapter

    adapter = SerialAdapter(path, baudrate=9600, timeout=1.0)

    def read() -> tuple[float, ...] | None:
        adapter.write_bytes(b"A")
        return _channels(adapter.read_bytes(45))

    return read, adapter.close


def run() -> list[Result]:
    results = [_compare(LUTRON, LUX, (_our_lutron, _their_lutron))]
    if importlib.util.find_spec("pymeasure"):
        results += [
            _compare(CENTER, RECORD, (_our_center, _instrument_center)),
            _compare(CENTER_BARE, RECORD, (_our_center, _adapter_center)),
        ]
    return results


def _compare(row: Row, record: bytes, readers: tuple[Any, Any]) -> Result:
    talks = record == LUX
    rounds = [
        [_with(FarEnd(record, talks=talks), reader, pace=not talks) for reader in readers]
        for _ in range(ROUNDS)
    ]
    ours, theirs = np.array(rounds).swapaxes(0, 1)
    delays = "{:.0f} µs, 99 % within {:.0f}"
    mine, other = (delays.format(*np.percentile(side[..., 1], (50, 99))) for side in (ours, theirs))
    note = f"a reading is in hand after {mine}, theirs {other}"
    cpu_s = [1e-6 * np.median(side[..., 0], axis=1) for side in (ours, theirs)]
    return share(row, list(zip(*cpu_s, strict=True)), note=note)
