"""A USB port of the guest: plugs one camera model into one socket of the emulator.

Connecting the socket plugs the camera in, closing it pulls the plug. `Faults` may be
changed while pictures flow.
"""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

from usblab.connection import Connection
from usblab.pipe import Count, Faults
from usblab.uvc.camera import UvcCamera


class UsbPort:
    """One camera on one socket; a context manager: plugged inside, unplugged after."""

    def __init__(self, camera: UvcCamera, path: Path) -> None:
        self.camera = camera
        self.faults = Faults()
        self.count = Count()
        self._path = path
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def __enter__(self) -> UsbPort:
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Plug the camera in."""
        self.count = Count()
        self.camera.power_on(time.monotonic())
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(self._path))
        self._ending, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name=self.camera.shape.title, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Pull the plug; raises what went wrong in the port's thread, if anything did."""
        if self._thread is None:
            return
        self._end.close()
        self._thread.join()
        self._thread = None
        self._ending.close()
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            Connection(self.camera, self.faults, self.count, self._socket).serve(self._ending)
        except (ConnectionError, BrokenPipeError):
            pass  # the guest was switched off
        except BaseException as failure:
            self._failure = failure
        finally:
            self._socket.close()
