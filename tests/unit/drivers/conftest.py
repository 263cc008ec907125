"""A pseudo-terminal with an instrument's end in the test's hand."""

import os
import pty
import threading
import time
import tty

import pytest

from fieldkit.model.clock import HostClock
from tests.harness.usb_bus import Bus


class Wire:
    """`path` is what a driver opens; on the far end an instrument may say, talk on, or answer questions.

    It may be unplugged and plugged in again, under the same path, as udev names an instrument.
    """

    def __init__(self, path):
        self.path = str(path)
        self.roles, self.threads, self.devices = [], [], []
        self.plug()

    def plug(self):
        self.far, self.near = pty.openpty()
        tty.setraw(self.near)
        os.symlink(os.ttyname(self.near), self.path)
        for role, line in self.roles:
            self._run(role, line)

    def unplug(self):
        os.unlink(self.path)
        self.cut()
        for thread in self.threads:
            thread.join(2)

    def open(self, driver, settings, clock=None):
        """The instrument as `driver` opens it, closed with the wire."""
        self.devices.append(driver.open(settings, clock or HostClock()))
        return self.devices[-1]

    def say(self, data):
        os.write(self.far, data)

    def talk(self, data):
        """Say the same again and again, unasked, until it is to say something else."""
        self.said = data
        self._start(self._talk, data)

    def _talk(self, data):
        try:
            while self.far >= 0 and self.said is data:
                os.write(self.far, data)
                time.sleep(0.01)  # an instrument's own rate
        except OSError:
            return

    def reply(self, replies):
        """Reply from `replies` (question: answer) until the wire is cut."""
        self._start(self._answer, replies)

    def _start(self, role, line):
        self.roles.append((role, line))
        self._run(role, line)

    def _run(self, role, line):
        thread = threading.Thread(target=role, args=(line,), daemon=True)
        thread.start()
        self.threads.append(thread)

    def _answer(self, replies):
        heard = b""
        try:
            while heard := heard + os.read(self.far, 256):
                for request, reply in replies.items():
                    if heard.endswith(request):
                        heard = b""
                        os.write(self.far, reply)
                        break
        except OSError:
            return

    def cut(self):
        for end in (self.near, self.far):
            if end >= 0:
                os.close(end)
        self.near = self.far = -1


@pytest.fixture
def wire(tmp_path):
    wire = Wire(tmp_path / "instrument")
    yield wire
    for device in wire.devices:
        device.close()
    wire.cut()
    for thread in wire.threads:
        thread.join(2)


@pytest.fixture
def impatient(monkeypatch):
    """Silence is an error after a tenth of a second, not after the seconds a real meter may need."""
    monkeypatch.setattr("fieldkit.drivers.meters.meter.REPLY_TIMEOUT_S", 0.1)
    monkeypatch.setattr("fieldkit.drivers.meters.meter.FIRST_RECORD_S", 0.1)


@pytest.fixture
def soon(monkeypatch):
    """What is no record is an error after a second."""
    monkeypatch.setattr("fieldkit.drivers.meters.meter.FIRST_RECORD_S", 1.0)


@pytest.fixture
def usb_bus(monkeypatch):
    """Plugs instruments of `tests.harness.usb_bus` into this computer."""

    def plug(*instruments):
        bus = Bus(*instruments)
        # below pyusb there is only the computer's own bus
        monkeypatch.setattr("usb.backend.libusb1.get_backend", lambda *given, **more: bus)
        return bus

    return plug
