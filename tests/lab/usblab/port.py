"""A USB port of the guest: plugs one camera model into one socket of the emulator.

`Faults` may be changed while pictures flow.
"""

from __future__ import annotations

import socket
import time
from pathlib import Path

from usblab.connection import Connection
from usblab.pipe import Count, Faults
from usblab.plug import Plug
from usblab.uvc.camera import UvcCamera


class UsbPort(Plug):
    """One camera on one socket."""

    def __init__(self, camera: UvcCamera, path: Path) -> None:
        super().__init__(path)
        self.camera = camera
        self.faults = Faults()
        self.count = Count()

    def plug(self) -> None:
        """Plug the camera in."""
        self.count = Count()
        self.camera.power_on(time.monotonic())
        super().plug()

    def serve(self, wire: socket.socket, ending: socket.socket) -> None:
        """Answer and stream; see `Connection.serve`."""
        Connection(self.camera, self.faults, self.count, wire).serve(ending)
