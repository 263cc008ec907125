"""The reader against a kernel played by the test; against the real one it runs in the USB lab."""

import ctypes
import errno
import os
import shutil
import subprocess

import pytest

from fieldkit.drivers.cameras import v4l2
from fieldkit.drivers.cameras.ht301 import Ht301
from fieldkit.drivers.cameras.p2pro import P2Pro
from fieldkit.drivers.cameras.tc002c import Tc002c
from fieldkit.drivers.cameras.v4l2 import V4l2Source
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.next_step import Action
from tests.harness.connected import plugged_in
from tests.harness.next_steps import at, steps
from tests.harness.rights import ordinary_rights

SLOT = 65536
WIDTH, HEIGHT = 160, 122


class Kernel:
    """Answers the requests of one streaming camera; frames lie in a file mapped instead of a node."""

    def __init__(self, path):
        self.path = path
        path.write_bytes(bytes(SLOT * v4l2.BUFFERS))
        self.free, self.ready, self.extension = [], [], {}
        self.streaming = self.gone = False
        self.refuse = {}
        self.caps = v4l2.CAP_CAPTURE | v4l2.CAP_STREAMING
        self.sizes = [(160, 120), (160, 122)]
        self.zoom = None

    def deliver(self, data, sequence, flags=v4l2.STAMP_MONOTONIC, at=(12, 345)):
        index = self.free.pop(0)
        with self.path.open("r+b") as memory:
            memory.seek(index * SLOT)
            memory.write(data)
        self.ready.append((index, len(data), sequence, flags, at))

    def ioctl(self, fd, request, argument):
        if self.gone:
            raise OSError(errno.ENODEV, "gone")
        if request in self.refuse:
            raise OSError(self.refuse[request], "refused")
        names = {getattr(v4l2, name): name for name in REQUESTS}
        return getattr(self, names[request].lower())(argument)

    def querycap(self, caps):
        caps.device_caps = self.caps

    def enum_framesizes(self, entry):
        if entry.index >= len(self.sizes):
            raise OSError(errno.EINVAL, "no more")
        entry.width, entry.height = self.sizes[entry.index]

    def s_fmt(self, wanted):
        wanted.fmt.pix.sizeimage = 2 * WIDTH * HEIGHT

    def reqbufs(self, setting):
        setting.count = v4l2.BUFFERS

    def querybuf(self, slot):
        slot.length, slot.m.offset = SLOT, slot.index * SLOT

    def qbuf(self, slot):
        self.free.append(slot.index)

    def dqbuf(self, slot):
        if not self.ready:
            raise BlockingIOError(errno.EAGAIN, "nothing yet")
        slot.index, slot.bytesused, slot.sequence, slot.flags, at = self.ready.pop(0)
        slot.seconds, slot.microseconds = at

    def streamon(self, kind):
        self.streaming = True

    def streamoff(self, kind):
        self.streaming = False

    def s_ctrl(self, control):
        self.zoom = (control.id, control.value)

    def uvc_query(self, query):
        content = self.extension.get((query.unit, query.selector))
        if content is None:
            raise OSError(errno.ENOENT, "no such unit")
        if query.query == v4l2.GET_LEN:
            ctypes.memmove(query.data, len(content).to_bytes(2, "little"), 2)
        elif query.size != len(content):
            raise OSError(errno.ENOBUFS, "wrong size")
        elif query.query == v4l2.GET_CUR:
            ctypes.memmove(query.data, content, len(content))
        else:
            self.extension[query.unit, query.selector] = ctypes.string_at(query.data, query.size)


REQUESTS = (
    *("QUERYCAP", "S_FMT", "REQBUFS", "QUERYBUF", "QBUF", "DQBUF", "STREAMON", "STREAMOFF"),
    *("S_CTRL", "ENUM_FRAMESIZES", "UVC_QUERY"),
)


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    kernel = Kernel(tmp_path / "video0")
    # a virtual camera needs a module of the kernel: in tests/lab a guest has one
    monkeypatch.setattr(v4l2.fcntl, "ioctl", kernel.ioctl)
    return kernel


def opened(kernel, sizes=((WIDTH, HEIGHT), (160, 120))):
    return V4l2Source(str(kernel.path), "Y16 ", sizes, HostClock())


@pytest.fixture
def source(kernel):
    source = opened(kernel)
    yield source
    source.close()


def test_frame_comes_with_kernel_stamp_sequence_and_flag(kernel, source):
    data = os.urandom(2 * WIDTH * HEIGHT)
    kernel.deliver(data, 41)
    kernel.deliver(data[:100], 43, v4l2.STAMP_MONOTONIC | v4l2.FLAG_ERROR)
    first, second = source.read(1.0), source.read(1.0)
    assert (first.data, first.mono_ns, first.sequence, first.error) == (data, 12_000_345_000, 41, False)
    assert (second.data, second.sequence, second.error) == (data[:100], 43, True)
    assert source.read(0.01) is None
    assert len(kernel.free) == v4l2.BUFFERS


def deliver_now(kernel, *numbers):
    """Frames taken just now, 0.1 ms after one another, in the order the kernel has done with them."""
    begun_us = HostClock().mono_ns() // 1000
    for number in numbers:
        kernel.deliver(b"frame", number, at=divmod(begun_us + 100 * number, 1_000_000))


def test_frames_that_the_kernel_finishes_out_of_order_come_in_the_order_they_were_taken(kernel, source):
    deliver_now(kernel, 0, 1, 3, 4, 5, 6, 7, 2, 8)
    frames = [source.read(1.0) for _ in range(9)]
    assert [frame.sequence for frame in frames] == list(range(9))
    stamps = [frame.mono_ns for frame in frames]
    assert stamps == sorted(stamps)
    assert not any(frame.error for frame in frames)


def test_a_frame_that_is_lost_holds_the_next_ones_up_for_a_moment_only(kernel, source, monkeypatch):
    monkeypatch.setattr(v4l2, "OVERTAKEN_NS", 50_000_000)  # a shorter wait
    deliver_now(kernel, 0, 2, 3)
    assert [source.read(1.0).sequence for _ in range(3)] == [0, 2, 3]


@pytest.mark.parametrize(
    ("arrivals", "errors"),
    [
        (((0, 5), (2, 3), (1, 4), (3, 2)), [False, False, True, False]),  # one comes far too late
        (((70, 5), (71, 4), (0, 3), (1, 2)), [False] * 4),  # numbers begin anew
    ],
)
def test_a_late_frame_is_an_error_and_numbers_may_begin_anew(kernel, source, arrivals, errors):
    monotonic_s = HostClock().mono_ns() // 1_000_000_000
    for number, ago_s in arrivals:
        kernel.deliver(b"frame", number, at=(monotonic_s - ago_s, 0))
    frames = [source.read(1.0) for _ in arrivals]
    assert [frame.sequence for frame in frames] == [number for number, _ in arrivals]
    assert [frame.error for frame in frames] == errors


def test_what_arrived_before_the_camera_was_unplugged_is_not_lost_with_it(kernel, source):
    deliver_now(kernel, 0, 2)
    assert source.read(1.0).sequence == 0
    assert source.read(0.01) is None
    kernel.gone = True
    assert source.read(1.0).sequence == 2
    with pytest.raises(DeviceLostError):
        source.read(1.0)


def test_stamp_of_another_clock_is_not_trusted(kernel, source):
    before = HostClock().mono_ns()
    kernel.deliver(b"frame", 1, flags=0)
    assert source.read(1.0).mono_ns >= before


def test_first_wanted_size_that_is_offered_is_taken(kernel):
    assert opened(kernel).size == (160, 122)
    kernel.sizes = [(160, 120)]
    assert opened(kernel).size == (160, 120)


def test_camera_without_the_wanted_frame_says_what_it_has(kernel):
    kernel.sizes = [(640, 480)]
    with pytest.raises(DeviceNotFoundError, match=r"160x122.* 640x480"):
        opened(kernel)


def test_metadata_node_is_refused(kernel):
    kernel.caps = 0x0080_0000
    with pytest.raises(DeviceNotFoundError, match="metadata node"):
        opened(kernel)


@pytest.mark.parametrize(
    ("code", "word"), [(errno.EBUSY, "fuser"), (errno.ENOSPC, "USB"), (errno.EIO, "unplug")]
)
def test_refused_start_is_explained(kernel, code, word):
    kernel.refuse[v4l2.STREAMON] = code
    with pytest.raises(DeviceAccessError, match=word, check=at(kernel.path)):
        opened(kernel)


def test_missing_node_and_missing_permission_are_told_apart(tmp_path):
    with pytest.raises(DeviceNotFoundError):
        V4l2Source("/dev/video-none", "Y16 ", ((1, 1),), HostClock())
    node = tmp_path / "video0"
    node.touch(mode=0)
    with ordinary_rights(), pytest.raises(DeviceAccessError, match="no permission") as caught:
        V4l2Source(str(node), "Y16 ", ((1, 1),), HostClock())
    assert "usermod -aG video" in str(caught.value.fix)


def test_unplugged_camera_is_lost_and_closes_quietly(kernel, source):
    kernel.gone = True
    with pytest.raises(DeviceLostError, match="is gone"):
        source.read(1.0)
    source.close()
    source.close()


def test_skipped_frames_go_back_to_the_kernel(kernel, source):
    for number in range(5):
        kernel.deliver(b"frame", number)
    source.skip_until(HostClock().mono_ns() + 20_000_000)
    assert source.read(0.0) is None
    assert len(kernel.free) == v4l2.BUFFERS


def test_extension_unit_is_read_and_written_at_its_own_length(kernel, source):
    kernel.extension[6, 19] = bytes(4)
    source.set_control(6, 19, (1).to_bytes(4, "little"))
    assert source.get_control(6, 19, 4) == b"\x01\0\0\0"
    with pytest.raises(DeviceError, match=r"control 9\b"):
        source.get_control(6, 9, 4)
    with pytest.raises(DeviceError):
        source.set_control(6, 19, b"\x01")


def test_zoom_is_the_absolute_one(kernel, source):
    source.set_zoom(0x8004)
    assert kernel.zoom == (0x009A090D, 0x8004)


C_PROGRAM = r"""
#include <stdio.h>
#include <stddef.h>
#include <linux/videodev2.h>
#include <linux/uvcvideo.h>
int main(void) {
    printf("%lu %lu %lu %lu %lu %lu ", VIDIOC_QUERYCAP, VIDIOC_S_FMT, VIDIOC_REQBUFS, VIDIOC_QUERYBUF,
           VIDIOC_QBUF, VIDIOC_DQBUF);
    printf("%lu %lu %lu %lu %lu ", VIDIOC_STREAMON, VIDIOC_STREAMOFF, VIDIOC_S_CTRL, VIDIOC_ENUM_FRAMESIZES,
           (unsigned long)UVCIOC_CTRL_QUERY);
#define AT(name, member) (long)offsetof(struct v4l2_##name, member)
    printf("%ld %ld ", AT(buffer, timestamp), AT(buffer, sequence));
    printf("%ld %ld ", AT(buffer, m), AT(buffer, length));
    printf("%ld %ld ", AT(format, fmt), AT(capability, device_caps));
    printf("%d %d\n", V4L2_CID_ZOOM_ABSOLUTE, V4L2_BUF_FLAG_ERROR);
}
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler")
def test_structures_are_those_of_this_kernels_headers(tmp_path):
    source, program = tmp_path / "ask.c", tmp_path / "ask"
    source.write_text(C_PROGRAM)
    if subprocess.run(["gcc", source, "-o", program], capture_output=True).returncode:
        pytest.skip("no kernel headers")
    told = [int(word) for word in subprocess.run([program], capture_output=True, text=True).stdout.split()]
    buffer, layout = v4l2.VideoBuffer, v4l2.Format
    assert told == [
        *(getattr(v4l2, name) for name in REQUESTS),
        *(buffer.seconds.offset, buffer.sequence.offset, buffer.m.offset, buffer.length.offset),
        *(layout.fmt.offset, v4l2.Capability.device_caps.offset),
        *(v4l2.ZOOM_ABSOLUTE, v4l2.FLAG_ERROR),
    ]


@pytest.mark.parametrize(
    ("driver", "kind", "sizes", "named"),
    [
        # sizes of a HIKMICRO JS-MINI256-9 as its owner lists them; of a Topdon TC001 Plus:
        # leswright1977/PyThermalCamera, issue 24
        (Tc002c, (0x2BDF, 0x0102), [(256, 192), (256, 392), (256, 196)], "it has 256x192.*HIKMICRO module"),
        (P2Pro, (0x0BDA, 0x5830), [(640, 480)], "it has 640x480: a webcam "),
        (Ht301, (0x04B4, 0x0100), [(256, 196)], "T2S\\+ of the second version"),
    ],
)
def test_a_camera_that_shares_an_identity_and_gives_no_temperatures_is_refused_by_name(
    kernel, monkeypatch, driver, kind, sizes, named
):
    kernel.sizes = sizes
    usb = UsbIdentity(*kind, path="1-2", title="USB Camera")
    plugged_in(monkeypatch, cameras=[(str(kernel.path), usb)])
    settings = DeviceSettings("ir", driver.name, identity=usb.as_text())
    with pytest.raises(DeviceNotFoundError, match=named) as caught:
        driver().open(settings, HostClock())
    assert steps(caught.value) == [Action.IMPORT()]
    assert not kernel.streaming
