"""Serial adapters of the guest: a meter's bytes on a socket."""

from __future__ import annotations

import random
import select
import socket
import time
from pathlib import Path

from usblab.plug import Plug

SPOILT_SHARE = 0.9
"""Share of the records that a bad contact changes."""


class Meter:
    """An instrument that sends a record every `every_s` without being asked, or answers commands, or both."""

    every_s = 1.0

    def unasked(self) -> bytes:
        """What it sends every `every_s`; nothing by default."""
        return b""

    def answer(self, received: bytes) -> bytes:
        """What it sends in answer to these bytes; nothing by default."""
        return b""


class SerialPort(Plug):
    """One meter on one adapter.

    While `garbled`, bytes are lost and changed as by a bad contact; while `mute`, nothing is sent.
    `records` counts what was sent.
    """

    def __init__(self, meter: Meter, path: Path) -> None:
        super().__init__(path)
        self.meter = meter
        self.garbled = self.mute = False
        self.records = 0
        self._random = random.Random(1)

    def serve(self, wire: socket.socket, ending: socket.socket) -> None:
        """Answer what comes, and send unasked at the meter's interval."""
        due_s = time.monotonic()
        while True:
            ready, _, _ = select.select([wire, ending], [], [], max(0.0, due_s - time.monotonic()))
            if ending in ready:
                return
            if wire in ready:
                received = wire.recv(4096)
                if not received:
                    return
                self._send(wire, self.meter.answer(received))
            if time.monotonic() >= due_s:
                due_s += self.meter.every_s
                self._send(wire, self.meter.unasked())

    def _send(self, wire: socket.socket, record: bytes) -> None:
        if record and not self.mute:
            self.records += 1
            wire.sendall(_garbled(record, self._random) if self.garbled else record)


def _garbled(record: bytes, chance: random.Random) -> bytes:
    """A record as a bad contact leaves it: mostly with bytes lost and others changed."""
    if chance.random() > SPOILT_SHARE:
        return record
    kept = bytearray(record)
    for _ in range(min(chance.randrange(1, 4), len(kept) - 1)):
        del kept[chance.randrange(len(kept))]
        kept[chance.randrange(len(kept))] ^= chance.randrange(1, 256)
    return bytes(kept)
