"""Serial adapters of the guest: a meter's bytes on a socket.

Connecting the socket plugs the adapter in, closing it pulls the plug.
"""

from __future__ import annotations

import random
import select
import socket
import threading
import time
from pathlib import Path

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


class SerialPort:
    """One meter on one adapter; a context manager: plugged inside, unplugged after.

    While `garbled`, bytes are lost and changed as by a bad contact; while `mute`, nothing is sent.
    `records` counts what was sent.
    """

    def __init__(self, meter: Meter, path: Path) -> None:
        self.meter = meter
        self.garbled = self.mute = False
        self.records = 0
        self._path = path
        self._random = random.Random(1)
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
                    received = self._socket.recv(4096)
                    if not received:
                        return
                    self._send(self.meter.answer(received))
                if time.monotonic() >= due_s:
                    due_s += self.meter.every_s
                    self._send(self.meter.unasked())

    def _send(self, record: bytes) -> None:
        if record and not self.mute:
            self.records += 1
            self._socket.sendall(_garbled(record, self._random) if self.garbled else record)


def _garbled(record: bytes, chance: random.Random) -> bytes:
    """A record as a bad contact leaves it: mostly with bytes lost and others changed."""
    if chance.random() > SPOILT_SHARE:
        return record
    kept = bytearray(record)
    for _ in range(min(chance.randrange(1, 4), len(kept) - 1)):
        del kept[chance.randrange(len(kept))]
        kept[chance.randrange(len(kept))] ^= chance.randrange(1, 256)
    return bytes(kept)
