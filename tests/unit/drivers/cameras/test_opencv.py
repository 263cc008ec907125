"""The fallback reader, on a capture that answers as OpenCV's own does where there is a camera."""

import sys

import cv2
import numpy as np
import pytest

from fieldkit.drivers.cameras.purethermal import run_shutter
from fieldkit.drivers.cameras.source import OpenCvSource
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.simulated_clock import SimulatedClock

SIZES = ((160, 122), (160, 120))


class Capture:
    """A camera of 160x120 raw pixels: frame n is full of n; OpenCV 4.11 hands it over as one row."""

    def __init__(self, clock: SimulatedClock, frames: int) -> None:
        self.clock, self.left = clock, frames
        self.asked: list[tuple[int, float]] = []
        self.number = 0
        self.stamp_ms = 0.0
        self.released = 0

    def open(self, where: object, backend: int) -> bool:
        self.opened = where, backend
        return self.left > 0

    def set(self, key: int, value: float) -> bool:
        self.asked.append((key, value))
        return not (key == cv2.CAP_PROP_ZOOM and value == 0x8000)

    def get(self, key: int) -> float:
        return self.stamp_ms if key == cv2.CAP_PROP_POS_MSEC else 0.0

    def grab(self) -> bool:
        self.clock.sleep(0.1)
        self.number += 1
        return self.number <= self.left

    def read(self) -> tuple[bool, np.ndarray | None]:
        good = self.grab()
        return good, np.full((1, 2 * 160 * 120), self.number, np.uint8) if good else None

    def release(self) -> None:
        self.released += 1


@pytest.fixture
def opened(monkeypatch):
    def begin(frames: int, sizes: tuple[tuple[int, int], ...] = SIZES) -> tuple[OpenCvSource, Capture]:
        clock = SimulatedClock(0)
        capture = Capture(clock, frames)
        monkeypatch.setattr(cv2, "VideoCapture", lambda: capture)  # OpenCV opens only a kernel's camera
        return OpenCvSource("/dev/video2", "Y16 ", sizes, clock), capture

    return begin


def test_the_size_that_the_camera_sends_is_found_by_its_bytes(opened):
    source, capture = opened(10)
    assert (source.backend, source.port, source.size) == ("opencv", "/dev/video2", (160, 120))
    if sys.platform == "linux":
        assert capture.opened == ("/dev/video2", cv2.CAP_V4L2)
    wanted = [value for key, value in capture.asked if key == cv2.CAP_PROP_FOURCC]
    assert wanted == [cv2.VideoWriter.fourcc(*"Y16 ")] * 2
    assert capture.asked[-1] == (cv2.CAP_PROP_CONVERT_RGB, 0)  # changing the format turns it on again


def test_frames_come_raw_until_the_camera_is_gone(opened):
    source, capture = opened(4)
    found = [source.read(1.0) for _ in range(2)]  # two were spent on finding the size
    assert [set(one.data) for one in found if one] == [{3}, {4}]
    assert all(isinstance(one, Buffer) and len(one.data) == 2 * 160 * 120 for one in found)
    assert found[0] is not None
    assert found[0].sequence == -1
    with pytest.raises(DeviceLostError, match="/dev/video2"):
        source.read(1.0)
    source.close()
    assert capture.released == 1


def test_a_stamp_of_the_kernel_is_taken_and_one_that_cannot_be_is_not(opened):
    source, capture = opened(20)
    now_ns = capture.clock.mono_ns()
    capture.stamp_ms = (now_ns + 0.06 * SECOND_NS) / 1e6  # before the frame arrives, 0.1 s later
    assert source.read(1.0).mono_ns == pytest.approx(now_ns + 0.06 * SECOND_NS, abs=1000)
    for impossible_ms in (0.0, 1e12):
        capture.stamp_ms = impossible_ms if impossible_ms else capture.clock.mono_ns() / 1e6 - 60_000.0
        assert source.read(1.0).mono_ns == capture.clock.mono_ns()


def test_frames_are_let_by_until_a_time(opened):
    source, capture = opened(20)
    source.skip_until(capture.clock.mono_ns() + SECOND_NS)
    assert set(source.read(1.0).data) == {13}
    with pytest.raises(DeviceLostError):
        source.skip_until(capture.clock.mono_ns() + 10 * SECOND_NS)


def test_commands_go_by_the_zoom_or_not_at_all(opened):
    source, capture = opened(10)
    source.set_zoom(0x8004)
    assert capture.asked[-1] == (cv2.CAP_PROP_ZOOM, float(0x8004))
    with pytest.raises(DeviceError, match="0x8000"):
        source.set_zoom(0x8000)
    with pytest.raises(DeviceError, match='backend = "v4l2"'):
        run_shutter(source)  # by an extension unit


@pytest.mark.parametrize(("frames", "sizes"), [(0, SIZES), (10, ((640, 512),))])
def test_a_camera_that_sends_something_else_is_let_go(opened, frames, sizes):
    with pytest.raises(DeviceNotFoundError, match="/dev/video2"):
        opened(frames, sizes)
