"""What `fieldkit doctor` sees of USB instruments, in a folder laid out as Linux lays out /sys."""

import re

import pytest

from fieldkit.drivers import discovery, registry
from fieldkit.drivers.identity import usb_parent
from fieldkit.drivers.meters.lutron import Lutron
from fieldkit.model.next_step import Action
from tests.harness.connected import plugged_in
from tests.harness.next_steps import steps


@pytest.fixture
def sysfs(tmp_path, monkeypatch):
    """Plugs (socket, vendor, product) in; nothing of this computer is seen."""
    plugged_in(monkeypatch)
    monkeypatch.setattr(discovery.os.path, "exists", lambda path: True)  # nodes that only a kernel makes

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


def test_other_usb_devices_are_none_of_its_business(sysfs):
    assert not [
        fact for fact in discovery.check_instruments(sysfs("1-2", "046d", "c52b")) if "/dev/bus" in fact.what
    ]


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
