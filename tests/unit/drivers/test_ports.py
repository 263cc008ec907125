import errno
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from fieldkit.drivers import identity, ports
from fieldkit.drivers.framing import Line
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.meters.lutron import LAYOUT
from fieldkit.drivers.ports import SerialPort, open_failure, open_port
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.next_step import Action
from tests.harness.connected import plugged_in
from tests.harness.next_steps import at, steps

RECORD = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
BYTE_NS = 1_041_666  # ten bits at 9600 baud


@pytest.fixture
def port(wire):
    port = SerialPort(wire.path, Line(9600), HostClock())
    yield port
    port.close()


def test_wire_time_of_lines_is_that_of_their_bits():
    assert 16 * Line(9600).byte_ns / 1e6 == pytest.approx(16.7, abs=0.05)  # Lutron
    assert 32 * Line(9600, 7, "E").byte_ns / 1e6 == pytest.approx(33.3, abs=0.05)  # T-10A
    assert 21 * Line(19200, 8, "E").byte_ns / 1e6 == pytest.approx(12.0, abs=0.05)  # SMP
    assert 19 * Line(2400).byte_ns / 1e6 == pytest.approx(79.2, abs=0.05)  # UT325


def test_stamp_is_the_arrival_less_the_wire_time_of_what_came_with_the_first_byte(wire, port):
    before = time.monotonic_ns()
    wire.say(RECORD)
    found = port.read(LAYOUT, 2.0)
    after = time.monotonic_ns()
    assert found.raw == RECORD
    assert before - 16 * BYTE_NS <= found.mono_ns <= after - 16 * BYTE_NS


def test_stamp_belongs_to_the_chunk_of_the_first_byte(wire, port):
    wire.say(RECORD[:1])
    assert port.read(LAYOUT, 0.05) is None
    first_ns = time.monotonic_ns()
    wire.say(RECORD[1:])
    assert port.read(LAYOUT, 2.0).mono_ns <= first_ns - BYTE_NS


def test_second_of_two_records_in_one_chunk_is_one_record_later(wire, port):
    wire.say(RECORD + RECORD)
    first, second = port.read(LAYOUT, 2.0), port.read(LAYOUT, 2.0)
    assert second.mono_ns - first.mono_ns == 16 * BYTE_NS


def test_more_than_one_read_takes_comes_out_whole(wire, port, monkeypatch):
    monkeypatch.setattr(ports, "CHUNK_BYTES", 448)  # a pseudo-terminal holds no more than one whole chunk
    wire.say(RECORD[5:] + 45 * RECORD)
    assert all(port.read(LAYOUT, 2.0).raw == RECORD for _ in range(45))
    assert (port.framer.rejected, port.framer.left) == (1, b"")


def test_noise_after_a_question_is_a_run_of_its_own(wire, port):
    wire.say(b"\xff\xff")
    assert port.read(LAYOUT, 0.05) is None
    assert port.read(LAYOUT, 0.01, b"A") is None
    wire.say(b"\xff")
    assert port.read(LAYOUT, 0.05) is None
    assert port.framer.rejected == 2
    assert port.framer.unread == b"\xff"


def test_noise_between_records_is_skipped_and_counted_once_a_run(wire, port):
    wire.say(b"\x34\x02\x02" + RECORD + b"\x00\xff\x02\x34" + RECORD)
    assert port.read(LAYOUT, 2.0).raw == RECORD
    assert port.framer.rejected == 1
    assert port.read(LAYOUT, 2.0).raw == RECORD
    assert port.framer.rejected == 2


class Endless(HostClock):
    """Whenever something waits, more noise arrives from `say`."""

    def __init__(self, say):
        super().__init__()
        self.say, self.waits = say, 0

    def wait_readable(self, fd, timeout_s):
        self.waits += 1
        assert self.waits < 20_000, "it reads on and on"
        self.say(b"x" * 64)
        return super().wait_readable(fd, timeout_s)


def test_a_line_that_never_falls_silent_does_not_hold_the_reader_up(wire):
    port = SerialPort(wire.path, Line(9600), Endless(wire.say))
    assert port.read(LAYOUT, 0.05) is None
    assert port.framer.rejected
    port.close()


def test_old_bytes_are_discarded(wire, port):
    wire.say(RECORD)
    assert port.read(LAYOUT, 0.01, b"A") is None


def test_unplugged_port_is_lost_on_read_and_on_write(wire, port):
    wire.cut()
    with pytest.raises(DeviceLostError, match=wire.path):
        port.read(LAYOUT, 1.0)
    with pytest.raises(DeviceLostError):
        port.write(b"A")
    port.close()
    port.close()


def test_port_taken_by_another_program_says_how_to_find_it(wire):
    code = (
        "import serial, sys; port = serial.Serial(sys.argv[1], exclusive=True);"
        "print('open', flush=True); sys.stdin.read()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, wire.path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout.readline() == "open\n"
    with pytest.raises(DeviceAccessError, match="fuser -v") as caught:
        SerialPort(wire.path, Line(), HostClock())
    assert f"fuser -v {wire.path}" in str(caught.value.fix)
    other.communicate()


def test_missing_port_lists_what_is_there(monkeypatch):
    meter = UsbIdentity(0x0403, 0x6001, "A1", "1-1", "FTDI adapter")
    plugged_in(monkeypatch, serial_ports=[("/dev/ttyUSB7", meter)])
    with pytest.raises(DeviceNotFoundError, match="0403:6001:A1 at /dev/ttyUSB7"):
        SerialPort("/dev/ttyUSB-none", Line(), HostClock())


@pytest.mark.parametrize(("group", "joins"), [("dialout", True), ("root", False)])
def test_permission_says_what_to_type_and_never_to_join_root(tmp_path, monkeypatch, group, joins):
    # a group that owns the folder and is called so would have to be made by root
    monkeypatch.setattr(identity.grp, "getgrgid", lambda number: SimpleNamespace(gr_name=group))
    failure = open_failure(str(tmp_path), OSError(errno.EACCES, "denied"))
    assert isinstance(failure, DeviceAccessError)
    assert Action.UDEV_RULES() in steps(failure)
    assert (f"usermod -aG {group}" in str(failure.fix)) == joins


def settings(**given):
    return DeviceSettings("lux", "lutron", **given)


def test_identity_finds_the_port_whatever_its_number(monkeypatch, wire):
    present = [
        ("/dev/ttyUSB0", UsbIdentity(0x0403, 0x6001, "B2")),
        (wire.path, UsbIdentity(0x0403, 0x6001, "A1")),
    ]
    plugged_in(monkeypatch, serial_ports=present)
    port = open_port(settings(identity="0403:6001:A1"), Line(), HostClock())
    assert port.path == wire.path
    port.close()


def test_other_instrument_at_the_configured_port_is_refused(monkeypatch, wire):
    real = os.path.realpath(wire.path)
    plugged_in(monkeypatch, serial_ports=[(real, UsbIdentity(0x10C4, 0xEA60, "X"))])
    with pytest.raises(DeviceNotFoundError, match="is 10c4:ea60:X, not 0403:6001"):
        open_port(settings(port=wire.path, identity="0403:6001"), Line(), HostClock())


@pytest.mark.parametrize("count", [0, 2])
def test_without_port_and_identity_only_a_single_port_is_taken(monkeypatch, count):
    present = [(f"/dev/ttyUSB{n}", UsbIdentity(0x0403, 0x6001, f"S{n}")) for n in range(count)]
    plugged_in(monkeypatch, serial_ports=present)
    with pytest.raises(DeviceNotFoundError, match="no USB" if count == 0 else "2 USB", check=at("lux")):
        open_port(settings(), Line(), HostClock())


class SysFs:
    """A folder laid out as Linux lays out /sys for serial ports; `plug` returns the path of the new node."""

    def __init__(self, root):
        self.root = root

    def plug(self, node, socket, kind, interface, serial="", port_number=""):
        adapter = self.root / "devices/usb1" / socket
        place = adapter / f"{socket}:1.{int(interface, 16)}"
        place = place if node.startswith("ttyACM") else place / node
        place.mkdir(parents=True)
        facts = {"idVendor": kind[:4], "idProduct": kind[5:], "serial": serial, "product": "adapter"}
        for name, text in facts.items():
            (adapter / name).write_text(text + "\n")
        (adapter / f"{socket}:1.{int(interface, 16)}" / "bInterfaceNumber").write_text(interface + "\n")
        if port_number:
            (place / "port_number").write_text(port_number + "\n")
        tty = self.root / "class/tty" / node
        tty.mkdir(parents=True)
        (tty / "device").symlink_to(place)

    def renumber(self, *nodes):
        """Give the nodes each other's names, as after a boot that found the ports in another order."""
        links = [(self.root / "class/tty" / node / "device") for node in nodes]
        places = [link.readlink() for link in links]
        for link, place in zip(links, places[1:] + places[:1], strict=True):
            link.unlink()
            link.symlink_to(place)


@pytest.fixture
def sysfs(tmp_path, monkeypatch):
    monkeypatch.setattr(identity, "SYSFS", tmp_path / "sys")  # only the kernel writes its own
    return SysFs(tmp_path / "sys")


def identities():
    present = [usb for _, usb in ports.serial_ports()]
    return {path.removeprefix("/dev/"): usb.as_text(present) for path, usb in ports.serial_ports()}


@pytest.mark.parametrize(
    ("kind", "serial", "interfaces", "expected"),
    [
        ("0403:6010", "FT1", ["00", "01"], ["0403:6010:FT1-if00", "0403:6010:FT1-if01"]),
        ("0403:6011", "", ["00", "01", "02", "03"], [f"0403:6011-if0{n}" for n in range(4)]),
        ("10c4:ea70", "", ["00", "01"], ["10c4:ea70-if00", "10c4:ea70-if01"]),
        ("04e2:1414", "X", ["01", "0a"], ["04e2:1414:X-if01", "04e2:1414:X-if0a"]),
        ("0403:6001", "A1", ["00"], ["0403:6001:A1"]),
        ("10c4:ea60", "", ["00"], ["10c4:ea60"]),
    ],
)
def test_each_port_of_an_adapter_has_an_identity_of_its_own(sysfs, kind, serial, interfaces, expected):
    for number, interface in enumerate(interfaces):
        sysfs.plug(f"ttyUSB{number}", "1-1.2", kind, interface, serial)
    assert list(identities().values()) == expected


def test_ports_of_one_interface_are_told_apart_by_their_place(sysfs):
    for number in range(2):
        sysfs.plug(f"ttyUSB{number}", "1-1", "9710:7840", "00", port_number=str(number))
    assert list(identities().values()) == ["9710:7840-if00", "9710:7840-if00-port1"]


def test_two_adapters_alike_are_named_by_socket_and_interface(sysfs):
    for number, (socket, interface) in enumerate(
        [("1-1", "00"), ("1-1", "01"), ("1-2", "00"), ("1-2", "01")]
    ):
        sysfs.plug(f"ttyACM{number}", socket, "0403:6010", interface, "same")
    assert list(identities().values()) == ["1-1-if00", "1-1-if01", "1-2-if00", "1-2-if01"]


@pytest.fixture
def two_ports(sysfs):
    sysfs.plug("ttyUSB0", "1-1.2", "0403:6010", "00", "FT1")
    sysfs.plug("ttyUSB1", "1-1.2", "0403:6010", "01", "FT1")
    return sysfs


def test_the_identity_of_a_port_finds_it_when_the_numbers_were_swapped(two_ports):
    wanted = settings(identity="0403:6010:FT1-if01")
    assert ports.port_path(wanted) == "/dev/ttyUSB1"
    two_ports.renumber("ttyUSB0", "ttyUSB1")
    assert ports.port_path(wanted) == "/dev/ttyUSB0"
    with pytest.raises(DeviceNotFoundError, match="is 0403:6010:FT1-if00, not 0403:6010:FT1-if01"):
        ports.port_path(settings(identity="0403:6010:FT1-if01", port="/dev/ttyUSB1"))


@pytest.mark.parametrize("identity", ["0403:6010", "0403:6010:FT1", "1-1.2"])
@pytest.mark.parametrize("port", ["", "/dev/ttyUSB1"])
def test_an_identity_that_two_ports_of_an_adapter_share_is_refused_with_the_choices(
    two_ports, identity, port
):
    with pytest.raises(DeviceNotFoundError) as caught:
        ports.port_path(settings(identity=identity, port=port))
    for choice in ("0403:6010:FT1-if00 at /dev/ttyUSB0", "0403:6010:FT1-if01 at /dev/ttyUSB1"):
        assert choice in caught.value.message


@pytest.mark.parametrize("identity", ["0403:6001", "0403:6001:A1", "1-1", "0403:6001:A1-if00"])
def test_identities_of_adapters_with_one_port_keep_working(sysfs, identity):
    sysfs.plug("ttyUSB0", "1-1", "0403:6001", "00", "A1")
    assert ports.port_path(settings(identity=identity)) == "/dev/ttyUSB0"
    assert ports.port_path(settings(identity=identity, port="/dev/ttyUSB0")) == "/dev/ttyUSB0"


def test_look_alikes_with_one_port_each_may_still_be_named_by_port(sysfs):
    for number in range(2):
        sysfs.plug(f"ttyUSB{number}", f"1-{number + 1}", "10c4:ea60", "00")
    assert ports.port_path(settings(identity="10c4:ea60", port="/dev/ttyUSB1")) == "/dev/ttyUSB1"
