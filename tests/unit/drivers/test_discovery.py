"""What `fieldkit doctor` sees of USB instruments, in a folder laid out as Linux lays out /sys."""

import re

import pytest

from fieldkit.drivers import discovery, registry
from fieldkit.drivers.identity import usb_parent
from fieldkit.drivers.meters.lutron import Lutron
from fieldkit.model.device import DeviceSettings
from fieldkit.model.next_step import Action
from tests.harness.connected import plugged_in
from tests.harness.next_steps import steps


@pytest.fixture
def sysfs(tmp_path, monkeypatch):
    """Plugs (socket, vendor, product) in; nothing of this computer is seen."""
    plugged_in(monkeypatch)
    monkeypatch.setattr(discovery.os.path, "exists", lambda path: True)  # nodes that only a kernel makes

    monkeypatch.setattr(discovery, "PROC", tmp_path / "proc")
    monkeypatch.setattr(discovery, "BRLTTY_RULES", tmp_path / "rules.d")

    def plug(socket, vendor, product):
        folder = tmp_path / "bus/usb/devices" / socket
        folder.mkdir(parents=True)
        facts = {"idVendor": vendor, "idProduct": product, "busnum": "1", "devnum": "7"}
        for name, text in facts.items():
            (folder / name).write_text(text + "\n")
        (folder.parent / f"{socket}:1.0").mkdir()
        return tmp_path

    return plug


@pytest.mark.parametrize("kind", [("3474", "45a2"), ("1a86", "e008")])
@pytest.mark.parametrize(("allowed", "level"), [(True, "ok"), (False, "fail")])
def test_instruments_with_nothing_but_the_raw_node_are_looked_at(sysfs, monkeypatch, kind, allowed, level):
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: allowed)  # root may open every node
    (found,) = [
        fact
        for fact in discovery.check_instruments(sysfs("1-2", *kind))
        if "/dev/bus/usb/001/007" in fact.what
    ]
    assert found.level == level
    assert ":".join(kind) in (found.what + found.text)
    assert allowed or Action.UDEV_RULES() in steps(found)


@pytest.mark.parametrize(("kind", "missing"), [(("3474", "45a2"), False), (("1a86", "e008"), True)])
def test_a_camera_without_a_video_node_is_a_camera(sysfs, kind, missing):
    facts = list(discovery.check_instruments(sysfs("1-2", *kind)))
    assert any("no USB camera" in fact.text for fact in facts) is missing


def test_an_instrument_with_nothing_but_the_raw_node_is_plugged_in(sysfs):
    folder = sysfs("1-2", "1a86", "e008")
    assert discovery.is_connected("1a86:e008", folder)
    assert not discovery.is_connected("3474:45a2", folder)


ADAPTERS = {
    "CH340": ("1a86", "7523", "ch341"),
    "CP2102": ("10c4", "ea60", "cp210x"),
    "FT232R": ("0403", "6001", "ftdi_sio"),
    "PL2303": ("067b", "2303", "pl2303"),
    "CH9102": ("1a86", "55d4", "cdc_acm"),
}


@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize("taken_by", ["brltty runs", "brltty is installed", "usbfs", "nothing", "a port"])
def test_an_adapter_without_a_port_is_told_with_the_command_that_frees_it(
    sysfs, tmp_path, monkeypatch, adapter, taken_by
):
    """brltty takes CH340 and CP2102 for Braille displays; what another program has is usbfs's."""
    vendor, product, module = ADAPTERS[adapter]
    folder = sysfs("1-2", vendor, product)
    interface = folder / "bus/usb/devices/1-2:1.0"
    is_class = module == "cdc_acm"
    (interface / "modalias").write_text("usb:v1A86p55D4d0445dc02dsc00dp00ic02isc02ip01in00\n" * is_class)
    if taken_by == "usbfs":
        (tmp_path / "drivers/usbfs").mkdir(parents=True)
        (interface / "driver").symlink_to(tmp_path / "drivers/usbfs")
    if taken_by == "brltty runs":
        (tmp_path / "proc/77").mkdir(parents=True)
        (tmp_path / "proc/77/comm").write_text("brltty\n")
    if taken_by == "brltty is installed":
        (tmp_path / "rules.d").mkdir()
        (tmp_path / "rules.d/85-brltty.rules").touch()
    if taken_by == "a port":
        usb = usb_parent(folder / "bus/usb/devices/1-2")
        plugged_in(monkeypatch, serial_ports=[("/dev/ttyUSB0", usb)])
    findings = list(discovery.check_instruments(folder))
    faults = [fact for fact in findings if fact.level == "fail" and f"{vendor}:{product}" in fact.text]
    assert not any(fact.what == "serial port" for fact in findings)  # it is there
    if taken_by == "a port":
        assert not faults
        return
    (fault,) = faults
    is_braille = "brltty" in taken_by and not is_class
    command = "remove brltty" if is_braille else "001/007" if taken_by == "usbfs" else f"modprobe {module}"
    assert command in str(fault.fix)


@pytest.mark.parametrize("ids", [("1a86", "e008"), ("0403", "ffff"), ("046d", "c52b")])
def test_other_devices_are_no_adapters_without_a_port_and_no_instruments(sysfs, ids):
    facts = list(discovery.check_instruments(sysfs("1-2", *ids)))
    assert not [fact for fact in facts if "modprobe" in str(fact.fix)]
    assert any("/dev/bus" in fact.what for fact in facts) is (ids == ("1a86", "e008"))


@pytest.mark.parametrize(
    ("camera", "misses_camera", "misses_port"),
    [
        (None, True, True),
        ({"driver": "purethermal"}, True, False),
        ({"driver": "purethermal", "port": "simulated"}, False, False),
        ({"driver": "y16", "identity": "1e4e:0100"}, True, False),
        ({"driver": "htpa", "port": "192.168.4.1"}, False, False),
        ({"driver": "tcam"}, False, False),
        ({"driver": "mlx90640", "port": "/dev/ttyUSB0"}, False, True),
        ({"driver": "mlx90640", "identity": "1a86:7523"}, False, True),
        ({"driver": "mlx90640", "port": "socket://10.0.0.7:4001"}, False, False),
        ({"driver": "lutron"}, True, True),
    ],
)
def test_a_camera_in_the_network_or_at_a_serial_port_is_not_missed_as_one_of_usb(
    sysfs, tmp_path, camera, misses_camera, misses_port
):
    configured = [] if camera is None else [DeviceSettings("camera", **camera)]
    missed = {fact.what for fact in discovery.check_instruments(tmp_path, configured)}
    assert ("camera" in missed, "serial port" in missed) == (misses_camera, misses_port)


def test_an_instrument_that_is_unplugged_while_it_is_looked_at_is_none(sysfs):
    folder = sysfs("1-2", "1a86", "e008") / "bus/usb/devices/1-2"
    assert usb_parent(folder).product == 0xE008
    (folder / "idProduct").unlink()
    assert usb_parent(folder) is None


def test_a_driver_that_cannot_look_for_its_instruments_does_not_hide_those_of_others(monkeypatch):
    class Broken(Lutron):
        name = "broken"

        def find(self):
            raise OSError("no library")

    plugged_in(monkeypatch)
    monkeypatch.setattr(registry, "load_all", lambda: ([Broken(), Lutron()], []))
    devices, problems = discovery.discover()
    assert devices == []
    (problem,) = problems
    assert re.search("'broken'.*OSError", problem)
