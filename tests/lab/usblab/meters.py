"""Meters on the guest's serial adapters: fieldkit's simulated instruments, their bytes on a socket.

Connecting the socket plugs the adapter in, closing it pulls the plug.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from fieldkit.drivers.simulated.meters import center_309_record, garbled, lutron_record
from usblab.field import Field


class Meter(ABC):
    """An instrument that may speak by itself every `every_s` and may answer what it hears."""

    every_s = 1.0

    def __init__(self, field: Field) -> None:
        self.field = field

    def speak(self) -> bytes:
        """What it says unasked."""
        return b""

    @abstractmethod
    def hear(self, letters: bytes) -> bytes:
        """What it says to this."""


class LightMeter(Meter):
    """A Lutron, lying flat, that sends a record twice a second, asked or not."""

    every_s = 0.5

    def speak(self) -> bytes:
        """The lux of now."""
        return lutron_record(self.field.lux(), "15")

    def hear(self, letters: bytes) -> bytes:
        """Nothing: it has no commands."""
        return b""


class Thermometer(Meter):
    """A Center 309 with its four probes in the first four beds; it answers `A` and `K`."""

    def hear(self, letters: bytes) -> bytes:
        """A record for each `A`, the model for each `K`."""
        answers = {
            ord("A"): lambda: center_309_record(self.field.probes_k()[:4] - 273.15),
            ord("K"): lambda: b"309\r",
        }
        return b"".join(answers[letter]() for letter in letters if letter in answers)


class SerialPort:
    """One meter on one adapter; a context manager: plugged inside, unplugged after.

    While `garbled`, bytes are lost and changed as by a bad contact; while `mute` it says nothing.
    `records` counts what was sent.
    """

    def __init__(self, meter: Meter, path: Path) -> None:
        self.meter = meter
        self.garbled = self.mute = False
        self.records = 0
        self._path = path
        self._random = np.random.default_rng(1)
        self._thread: threading.Thread | None = None

    def __enter__(self) -> SerialPort:
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Plug the adapter in."""
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(self._path))
        self._ending, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name=self._path.name, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Pull the plug; a second call does nothing."""
        if self._thread is not None:
            self._end.close()
            self._thread.join()
            self._thread = None
            self._ending.close()

    def _run(self) -> None:
        due_s = time.monotonic()
        with self._socket:
            while True:
                ready, _, _ = select.select(
                    [self._socket, self._ending], [], [], max(0.0, due_s - time.monotonic())
                )
                if self._ending in ready:
                    return
                if self._socket in ready:
                    heard = self._socket.recv(4096)
                    if not heard:
                        return
                    self._say(self.meter.hear(heard))
                if time.monotonic() >= due_s:
                    due_s += self.meter.every_s
                    self._say(self.meter.speak())

    def _say(self, record: bytes) -> None:
        if record and not self.mute:
            self.records += 1
            self._socket.sendall(garbled(record, self._random) if self.garbled else record)
