"""What udev makes of the instruments: names, modes and groups, however and whenever they are plugged in."""

from typing import Any

import pytest
from fieldlab.campaign import CAMERA_BY_ID, LUX_BY_ID, THERMOMETER_BY_ID
from fieldlab.meters import LightMeter, Thermometer
from usblab.lab import OBSERVER, STRANGER
from usblab.models.purethermal import PureThermal


def check_camera(nodes: Any) -> None:
    """Stable names lead to the picture node, and the observer's groups may use it and the raw USB node."""
    picture = nodes[CAMERA_BY_ID]["to"]
    assert nodes["/dev/fieldkit/camera"]["to"] == picture
    assert nodes[picture] == {"mode": "0660", "group": "video"}
    raw = [about for path, about in nodes.items() if path.startswith("/dev/bus/usb")]
    assert {"mode": "0660", "group": "plugdev"} in raw


def test_a_camera_found_at_power_on_has_its_stable_name_and_group(cold_plugged):
    check_camera(cold_plugged)


def test_a_camera_plugged_in_later_has_them_again_and_again(lab, field):
    port = lab.camera(PureThermal(field.lepton))
    for _ in range(2):
        with port:
            lab.wait_for(CAMERA_BY_ID)
            check_camera(lab.nodes())
        lab.wait_for(CAMERA_BY_ID, present=False)


def test_serial_adapters_are_told_apart_by_serial_number(lab, field):
    light, probes = lab.meter(LightMeter(field), 0), lab.meter(Thermometer(field), 1)
    with probes, light:
        names = {}
        lab.wait_for(LUX_BY_ID, THERMOMETER_BY_ID)
        for serial, path in (("LUX0001", LUX_BY_ID), ("TMP0001", THERMOMETER_BY_ID)):
            names[serial] = lab.nodes()[path]["to"]
            assert lab.nodes()[f"/dev/fieldkit/serial-{serial}"]["to"] == names[serial]
        assert len(set(names.values())) == 2
        assert all(lab.nodes()[tty] == {"mode": "0660", "group": "dialout"} for tty in names.values())


def test_the_latency_timer_of_an_adapter_is_set_to_a_millisecond_and_read_back(lab, field):
    with lab.meter(LightMeter(field), 0):
        lab.wait_for(LUX_BY_ID)
        told = lab.guest.call("inside_guest.adapters:latency", path=LUX_BY_ID)
    assert told == {"by_rule_ms": 1, "stated_ms": 1, "chip_ms": 1}


@pytest.mark.parametrize(("user", "may"), [(OBSERVER, True), (STRANGER, False)])
def test_the_group_decides_who_may_open_the_camera(lab, field, user, may):
    with lab.camera(PureThermal(field.lepton)):
        lab.wait_for(CAMERA_BY_ID)
        ended = lab.run("dd", f"if={CAMERA_BY_ID}", "of=/dev/null", "count=0", user=user)
    assert (ended.code == 0) is may, ended
