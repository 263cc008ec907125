"""The modem lines of a serial port as text; a pseudo-terminal has none, so that their bits are given here."""

import fcntl
import os
import pty
import struct
import termios

import pytest

from fieldkit.drivers import modem_lines
from fieldkit.drivers.instrument import open_device
from fieldkit.model.errors import DeviceNotFoundError


@pytest.fixture
def port():
    far, near = pty.openpty()
    yield os.ttyname(near)
    os.close(far)
    os.close(near)


def test_each_change_is_a_reading(port, monkeypatch):
    bits = [termios.TIOCM_CTS]
    real = fcntl.ioctl

    def ioctl(descriptor, request, *words):
        if request == termios.TIOCMGET:  # what a kernel's driver answers: linux/tty.h
            return struct.pack("I", bits[0])
        return real(descriptor, request, *words)

    monkeypatch.setattr(modem_lines.fcntl, "ioctl", ioctl)
    with open_device("text", port=f"lines://{port}") as gate:
        assert (gate.info.channels, gate.info.unit) == (("cts", "dsr"), "%")
        assert gate.read().values == {"cts": 100.0, "dsr": 0.0}
        bits[0] = termios.TIOCM_DSR | termios.TIOCM_CAR
        readings = [gate.read().values for _ in range(2)]
    assert {"cts": 0.0, "dsr": 100.0} in readings


@pytest.mark.parametrize("path", [None, "/nonexistent"])
def test_a_port_without_modem_lines_is_refused(port, path):
    with pytest.raises(DeviceNotFoundError) as refused:
        open_device("text", port=f"lines://{path or port}")
    assert refused.value.place == (path or port)
