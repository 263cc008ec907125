"""The fallback reader: OpenCV, where there is no Video4Linux or the configuration asks for it.

Neither sequence numbers nor error flags come this way, so losses show only as gaps in time.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceError, DeviceLostError, DeviceNotFoundError


class OpenCvSource:
    """A camera by OpenCV, raw; see `fieldkit.model.device.FrameSource`.

    `port` is a video node's path, or elsewhere than on Linux the camera's number. A picture is
    taken by its byte count, never by the shape OpenCV reports: 4.11 returns raw pictures as one row.
    OpenCV waits up to ten seconds by itself, whatever the timeout.
    """

    backend = "opencv"

    def __init__(self, port: str, fourcc: str, sizes: Sequence[tuple[int, int]], clock: Clock) -> None:
        import cv2

        self.port = port
        self._clock = clock
        self._position = cv2.CAP_PROP_POS_MSEC
        self._zoom = cv2.CAP_PROP_ZOOM
        self._capture = cv2.VideoCapture()
        for size in sizes:
            if self._start(cv2, fourcc, size):
                self.size = size
                return
        self.close()
        raise DeviceNotFoundError(
            f"OpenCV gets no raw {fourcc.strip()} picture from {port}",
            fix="close other programs that use the camera; fieldkit devices shows what is plugged in",
        )

    def read(self, timeout_s: float) -> Buffer | None:
        """The next picture; raises `DeviceLostError` when OpenCV gets none any more."""
        good, image = self._capture.read()
        if not good:
            raise self._lost()
        return Buffer(image.tobytes(), self._stamp_ns())

    def skip_until(self, mono_ns: int) -> None:
        """Grab pictures without fetching them until a monotonic time."""
        while self._clock.mono_ns() < mono_ns:
            if not self._capture.grab():
                raise self._lost()

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(
            f"the camera at {self.port} sends no more pictures",
            fix="plug it back in; it is opened again by identity",
        )

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Not possible this way."""
        raise DeviceError("OpenCV cannot reach the camera's extension units", fix='backend = "v4l2"')

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Not possible this way."""
        raise DeviceError("OpenCV cannot reach the camera's extension units", fix='backend = "v4l2"')

    def set_zoom(self, value: int) -> None:
        """Write the absolute zoom, which some cameras take as a command."""
        if not self._capture.set(self._zoom, float(value)):
            raise DeviceError(f"the camera at {self.port} refused zoom command {value:#06x}")

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        self._capture.release()

    def _start(self, cv2: object, fourcc: str, size: tuple[int, int]) -> bool:
        """Open and set in the order that works; changing the format restarts the stream."""
        import cv2 as cv

        capture, code = self._capture, cv.VideoWriter.fourcc(*fourcc.ljust(4))
        linux = sys.platform == "linux"
        where = self.port if linux or not self.port.isdigit() else int(self.port)
        if not capture.open(where, cv.CAP_V4L2 if linux else cv.CAP_ANY):
            return False
        for key, value in (
            (cv.CAP_PROP_CONVERT_RGB, 0),
            (cv.CAP_PROP_FOURCC, code),
            (cv.CAP_PROP_FRAME_WIDTH, size[0]),
            (cv.CAP_PROP_FRAME_HEIGHT, size[1]),
            (cv.CAP_PROP_CONVERT_RGB, 0),
        ):
            capture.set(key, value)
        good, image = capture.read()
        return bool(good) and image.nbytes == 2 * size[0] * size[1]

    def _stamp_ns(self) -> int:
        """The kernel's stamp where the backend passes it on, else now."""
        now_ns = self._clock.mono_ns()
        stamp_ns = int(self._capture.get(self._position) * 1e6)
        return stamp_ns if 0 <= now_ns - stamp_ns < 10_000_000_000 else now_ns
