"""A source of frames for cameras that are not plugged in: the bytes are the test's."""

import pytest

from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceError


class Reel:
    """A `FrameSource` that plays buffers and answers controls; `written` keeps what it was told."""

    backend = "reel"
    port = "reel"

    def __init__(self, buffers, controls=None, refuses=False):
        self.buffers = list(buffers)
        self.controls = controls or {}
        self.refuses = refuses
        self.written = []
        self.closed = 0

    def read(self, timeout_s):
        return self.buffers.pop(0) if self.buffers else None

    def skip_until(self, mono_ns):
        while self.buffers and self.buffers[0].mono_ns < mono_ns:
            self.buffers.pop(0)

    def get_control(self, unit, selector, length):
        if (unit, selector) not in self.controls:
            raise DeviceError(f"no control {selector} of unit {unit}")
        return self.controls[unit, selector]

    def set_control(self, unit, selector, data):
        self._write(unit, selector, data)

    def set_zoom(self, value):
        self._write("zoom", value)

    def _write(self, *command):
        if self.refuses:
            raise DeviceError("refused")
        self.written.append(command)

    def close(self):
        self.closed += 1


@pytest.fixture
def reel():
    def play(*frames, interval_ns=111_111_111, **more):
        """Frames as bytes, 9 a second, or as ready buffers."""
        buffers = [
            Buffer(frame, 10**9 + index * interval_ns, index) if isinstance(frame, bytes) else frame
            for index, frame in enumerate(frames)
        ]
        return Reel(buffers, **more)

    return play
