"""The rules know every instrument that the drivers know."""

import re
from pathlib import Path

import pytest

from fieldkit.drivers.access import RAW_ONLY, VENDOR_COMMANDS
from fieldkit.drivers.cameras import boson, ht301, p2pro, purethermal, thermal_master, thermal_master_bulk
from fieldkit.drivers.meters import konica_minolta, pce_174, ut325

RULES = (Path(__file__).parents[3] / "udev/70-fieldkit.rules").read_text()
VIDEO = [module.WANTED.kinds for module in (boson, ht301, p2pro, purethermal, thermal_master)]
RAW = [
    *VIDEO,
    VENDOR_COMMANDS,
    RAW_ONLY,
    ut325.KINDS,
    tuple(thermal_master_bulk.KINDS),
    konica_minolta.KINDS,
    pce_174.KINDS,
]


def section(label):
    return RULES.split(f'LABEL="fieldkit_{label}"')[1].split("LABEL=")[0]


def named(text, attribute):
    """(vendor, product) pairs that a section matches."""
    pattern = rf'{attribute}\{{idVendor\}}=="(\w+)", {attribute}\{{idProduct\}}=="([\w|]+)"'
    return {
        (int(vendor, 16), int(product, 16))
        for vendor, products in re.findall(pattern, text)
        for product in products.split("|")
    }


@pytest.mark.parametrize(("label", "attribute", "kinds"), [("usb", "ATTR", RAW), ("video", "ATTRS", VIDEO)])
def test_every_kind_of_the_drivers_is_in_the_rules(label, attribute, kinds):
    assert {kind for group in kinds for kind in group} <= named(section(label), attribute)


def test_rules_do_what_the_readme_promises():
    assert section("usb").count('TAG+="uaccess", GROUP="plugdev", MODE="0660"') == 1
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in section("usb")
    assert 'ATTR{power/control}="on"' in section("usb")
    assert 'ATTR{index}=="0", SYMLINK+="fieldkit/camera"' in section("video")
    assert 'ENV{ID_MM_PORT_IGNORE}="1"' in section("tty")
    assert 'DRIVER=="ftdi_sio", ATTR{latency_timer}="1"' in RULES


def test_every_jump_has_its_label():
    assert set(re.findall(r'GOTO="(\w+)"', RULES)) == set(re.findall(r'LABEL="(\w+)"', RULES))
