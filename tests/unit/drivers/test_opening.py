"""Every driver leaves nothing open where opening fails: at its options, at silence, at an interrupt."""

import os
import socket

import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.cameras.htpa import UdpSource
from fieldkit.drivers.connections import SocketPort
from fieldkit.drivers.meters.ut325 import HidBridge
from fieldkit.drivers.ports import SerialPort
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceTimeoutError
from tests.harness.next_steps import at
from tests.unit.drivers.meters.test_ut325 import Ch9325

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
VIDEO = ("purethermal", "p2pro", "boson", "ht301", "thermal-master", "tc002c", "y16")
METERS = ("konica-minolta", "lutron", "center-309", "center-303", "modbus", "pce-174", "nmea", "text")
SERIAL = ("mlx90640", *METERS)
NETWORK = ("tcam", "htpa", "gpsd")
ELSEWHERE = {"genicam": "tests/lab: aravis"}


def test_every_driver_is_among_these():
    assert {*VIDEO, *SERIAL, *NETWORK, "ut325", *ELSEWHERE} == set(registry.BUILT_IN)


class Interrupted:
    """A `FrameSource` at whose first frame the user presses Ctrl-C."""

    backend = port = "interrupted"
    closed = 0

    def read(self, timeout_s):
        raise KeyboardInterrupt

    def set_zoom(self, value):
        """Obey."""

    def close(self):
        self.closed += 1


@pytest.fixture
def interrupted(monkeypatch):
    """Ctrl-C while a driver waits for the first bytes of any port."""

    def interrupt(*given):
        raise KeyboardInterrupt

    for port in (SerialPort, SocketPort, HidBridge):
        monkeypatch.setattr(port, "read", interrupt)
    monkeypatch.setattr(UdpSource, "_datagram", interrupt)


def left_open(name, raises=KeyboardInterrupt, **given):
    """Descriptors that a failed opening left; the error, kept, holds on to whatever the driver held."""
    before = set(os.listdir("/proc/self/fd"))
    with pytest.raises(raises) as kept:
        registry.open_device(DeviceSettings("mine", name, **given), HostClock())
    assert kept.traceback
    return set(os.listdir("/proc/self/fd")) - before


@pytest.mark.parametrize("name", [*VIDEO, "tcam"])
def test_interrupted_camera_lets_go_of_its_source(name):
    source = Interrupted()
    assert not left_open(name, source=source)
    assert source.closed


@pytest.mark.usefixtures("interrupted")
@pytest.mark.parametrize("name", SERIAL)
def test_interrupted_instrument_lets_go_of_its_port(name, wire):
    assert not left_open(name, port=wire.path, options={"map": "kipp-smp"} if name == "modbus" else {})


@pytest.mark.usefixtures("interrupted")
@pytest.mark.parametrize("name", NETWORK)
def test_interrupted_instrument_in_the_network_is_hung_up(name):
    with socket.create_server(("127.0.0.1", 0)) as far_end:
        assert not left_open(name, port=f"127.0.0.1:{far_end.getsockname()[1]}")


@pytest.mark.usefixtures("interrupted")
def test_interrupted_bridge_is_released(usb_bus, monkeypatch):
    released = []
    monkeypatch.setattr("usb.util.dispose_resources", released.append)
    usb_bus(Ch9325())
    left_open("ut325")
    assert released


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("name", "advice"),
    [("lutron", "DTR"), ("center-309", ""), ("konica-minolta", "7E1"), ("text", "every_s"), ("pce-174", "")],
)
def test_a_silent_meter_is_a_timeout_with_what_to_do(name, advice, wire):
    with pytest.raises(DeviceTimeoutError, check=at("mine")) as caught:
        registry.open_device(DeviceSettings("mine", name, port=wire.path, every_s=0.05), HostClock())
    assert advice in str(caught.value.fix)


def test_wrong_option_lets_go_of_a_port_that_works(wire):
    wire.talk(LUX)
    assert not left_open("lutron", ConfigError, port=wire.path, options={"labels": "lux"})
    wire.talk(b"lux=98760 lx\r\n")
    assert not left_open("text", ConfigError, port=wire.path, options={"latency_s": "little"})
    registry.open_device(DeviceSettings("mine", "text", port=wire.path), HostClock()).close()
