"""What the rules make of instruments as the kernel announces them: rights, names, and quiet.

The rules are carried out here as udev does (man udev), on the attributes that each instrument has.
"""

import re
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from fieldkit.drivers.cameras import boson, ht301, p2pro, purethermal, tc002c, thermal_master
from fieldkit.drivers.discovery import RAW_ONLY, VENDOR_COMMANDS
from fieldkit.drivers.meters import konica_minolta, pce_174, ut325

RULES = (Path(__file__).parents[3] / "udev/70-fieldkit.rules").read_text()
_WORD = re.compile(r'([A-Z_]+)(?:\{([\w./]+)\})?(==|!=|\+=|=)"((?:[^"]*))"')
VIDEO = {
    kind
    for module in (boson, ht301, p2pro, purethermal, tc002c, thermal_master)
    for kind in module.WANTED.kinds
}
USB = VIDEO | {
    *VENDOR_COMMANDS, *RAW_ONLY, *thermal_master.KINDS,
    *ut325.KINDS, *konica_minolta.KINDS, *pce_174.KINDS,
}  # fmt: skip
ADAPTERS = {
    "FT232": (0x0403, 0x6001), "FT2232": (0x0403, 0x6010), "FT4232": (0x0403, 0x6011),
    "FT232H": (0x0403, 0x6014), "FT-X": (0x0403, 0x6015), "CP2102": (0x10C4, 0xEA60),
    "CH340": (0x1A86, 0x7523), "CH341": (0x4348, 0x5523),
    "PL2303": (0x067B, 0x2303), "ATEN": (0x0557, 0x2008),
}  # fmt: skip
"""As Linux knows them: tables of drivers/usb/serial/ftdi_sio.c, cp210x.c, ch341.c and pl2303.c."""


@dataclass
class Announced:
    """A device of the kernel and what the rules have done with it."""

    words: dict[str, str]
    attributes: dict[str, str] = field(default_factory=dict)
    env: dict[str, str] = field(default_factory=dict)
    set_to: dict[str, str] = field(default_factory=dict)
    links: list[str] = field(default_factory=list)
    text: dict[str, str] = field(default_factory=dict)

    def holds(self, key: str, name: str, op: str, wanted: str) -> bool:
        if key == "TEST":
            return (wanted in self.attributes) == (op == "==")
        known = {"ATTR": self.attributes, "ATTRS": self.attributes, "ENV": self.env}
        found = known.get(key, self.words).get(name or key, "")
        return any(fnmatchcase(found, one) for one in wanted.split("|")) == (op == "==")

    def assign(self, key: str, name: str, value: str) -> None:
        value = re.sub(r"\$env\{(\w+)\}", lambda found: self.env[found[1]], value)
        if key == "SYMLINK":
            self.links.append(value)
        elif key in ("ENV", "ATTR"):
            (self.env if key == "ENV" else self.text)[name] = value
        else:
            self.set_to[key] = value


def announced(**given: object) -> Announced:
    """What the rules make of an added device."""
    device = Announced({"ACTION": "add", **given.pop("words")}, **given)  # type: ignore[arg-type,dict-item]
    wanted = ""
    for line in RULES.splitlines():
        words = _WORD.findall(line.partition("#")[0])
        if any(key == "LABEL" for key, *_ in words):
            wanted = "" if wanted == words[0][3] else wanted
        if wanted or not words:
            continue
        if all(device.holds(key, name, op, value) for key, name, op, value in words if op in ("==", "!=")):
            for key, name, op, value in words:
                if key == "GOTO":
                    wanted = value
                elif op in ("=", "+=") and key != "LABEL":
                    device.assign(key, name, value)
    return device


def ids(kind: tuple[int, int]) -> dict[str, str]:
    return {"idVendor": f"{kind[0]:04x}", "idProduct": f"{kind[1]:04x}"}


def usb_device(kind: tuple[int, int]) -> Announced:
    attributes = {**ids(kind), "power/control": "auto"}
    return announced(words={"SUBSYSTEM": "usb"}, attributes=attributes, env={"DEVTYPE": "usb_device"})


def frame_node(kind: tuple[int, int], index: int) -> Announced:
    words = {"SUBSYSTEM": "video4linux", "SUBSYSTEMS": "usb"}
    return announced(words=words, attributes={**ids(kind), "index": str(index)})


def tty(kind: tuple[int, int], **env: str) -> Announced:
    return announced(words={"SUBSYSTEM": "tty", "SUBSYSTEMS": "usb"}, attributes=ids(kind), env=env)


@pytest.mark.parametrize("kind", sorted(USB | set(ADAPTERS.values())), ids=str)
def test_every_instrument_may_be_used_is_left_alone_and_stays_awake(kind):
    device = usb_device(kind)
    assert device.set_to == {"TAG": "uaccess", "GROUP": "plugdev", "MODE": "0660"}
    assert device.env["ID_MM_DEVICE_IGNORE"] == "1"
    assert device.text == {"power/control": "on"}


@pytest.mark.parametrize("kind", sorted(VIDEO), ids=str)
def test_frames_of_every_camera_may_be_read_under_a_stable_name(kind):
    frame, metadata = frame_node(kind, 0), frame_node(kind, 1)
    for node in (frame, metadata):
        assert node.set_to == {"TAG": "uaccess", "GROUP": "video", "MODE": "0660"}
    assert (frame.links, metadata.links) == (["fieldkit/camera"], [])


@pytest.mark.parametrize("kind", ADAPTERS.values(), ids=ADAPTERS)
def test_ports_of_every_adapter_are_named_after_it_and_modem_manager_keeps_off(kind):
    port = tty(kind, ID_SERIAL_SHORT="LUX0001", ID_PATH="pci-1")
    assert port.set_to == {"TAG": "uaccess", "GROUP": "dialout", "MODE": "0660"}
    assert port.env["ID_MM_PORT_IGNORE"] == "1"
    assert port.links == ["fieldkit/serial-LUX0001"]
    assert tty(kind, ID_PATH="pci-1").links == ["fieldkit/serial-pci-1"]


def test_a_bosons_commands_have_a_name_of_their_own():
    assert tty((0x09CB, 0x4007), ID_SERIAL_SHORT="7").links == ["fieldkit/serial-7", "fieldkit/boson"]


def test_ftdi_adapters_hand_over_bytes_within_a_millisecond():
    port = announced(
        words={"SUBSYSTEM": "usb-serial", "DRIVER": "ftdi_sio"}, attributes={"latency_timer": "16"}
    )
    assert port.text == {"latency_timer": "1"}


@pytest.mark.parametrize("made", [usb_device, tty, lambda kind: frame_node(kind, 0)])
def test_webcams_keyboards_and_devices_that_leave_are_left_as_they_are(made):
    for kind in ((0x046D, 0x0825), (0x0403, 0x6002), (0x1D6B, 0x0002)):
        device = made(kind)
        assert (device.set_to, device.links, device.text) == ({}, [], {})
    gone = announced(words={"ACTION": "remove", "SUBSYSTEM": "usb"}, attributes=ids((0x1E4E, 0x0100)))
    assert gone.set_to == {}


def test_every_jump_has_its_label():
    assert set(re.findall(r'GOTO="(\w+)"', RULES)) == set(re.findall(r'LABEL="(\w+)"', RULES))
