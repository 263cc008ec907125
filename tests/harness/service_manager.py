"""A real Unix socket in the place of systemd's, as sd_notify(3) describes it."""

from __future__ import annotations

import socket
import time
from pathlib import Path


class ServiceManager:
    """The receiving end; `states` are all that were received, one by one."""

    def __init__(self, address: Path) -> None:
        self.address = str(address)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(self.address)
        self.states: list[str] = []

    def waits_for(self, state: str, within_s: float = 60.0) -> bool:
        """Receive until a state arrives; whether it did in time."""
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            self.socket.settimeout(max(0.01, deadline - time.monotonic()))
            try:
                new = self.socket.recv(4096).decode().split("\n")
            except TimeoutError:
                return False
            self.states += new
            if state in new:
                return True
        return False

    def drain(self) -> None:
        """Receive what is waiting."""
        self.waits_for("", 0.2)
