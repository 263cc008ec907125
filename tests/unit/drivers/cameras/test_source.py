import pytest

from fieldkit.drivers.cameras import source
from fieldkit.drivers.cameras.purethermal import PureThermal
from fieldkit.drivers.cameras.source import CameraFormat, cameras, open_source
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceNotFoundError
from fieldkit.model.next_step import Action
from tests.harness.connected import plugged_in
from tests.harness.next_steps import at

WANTED = CameraFormat(((0x1E4E, 0x0100),), "Y16 ", ((160, 122),))


def plug(sysfs, number, socket, vendor, product, serial="", index=0):
    """Lay out what the kernel shows of a camera in a USB socket."""
    usb = sysfs / f"devices/pci0/usb1/{socket}"
    node = usb / f"{socket}:1.0/video4linux/video{number}"
    node.mkdir(parents=True)
    (node / "index").write_text(f"{index}\n")
    facts = {"idVendor": vendor, "idProduct": product, "serial": serial, "product": "Camera"}
    for name, text in facts.items():
        if text:
            (usb / name).write_text(f"{text}\n")
    shelf = sysfs / "class/video4linux"
    shelf.mkdir(parents=True, exist_ok=True)
    (shelf / f"video{number}").symlink_to(node)


def test_frame_nodes_are_found_with_their_identity(tmp_path):
    plug(tmp_path, 1, "1-2", "1e4e", "0100", "ABC", index=1)
    plug(tmp_path, 0, "1-2", "1e4e", "0100", "ABC")
    plug(tmp_path, 10, "1-1.4", "0bda", "5830")
    assert cameras(tmp_path) == [
        ("/dev/video0", UsbIdentity(0x1E4E, 0x0100, "ABC", "1-2", "Camera")),
        ("/dev/video10", UsbIdentity(0x0BDA, 0x5830, "", "1-1.4", "Camera")),
    ]


@pytest.mark.parametrize(
    ("present", "text"),
    [
        ([UsbIdentity(0x1E4E, 0x0100, "A", "1-1")], ["1e4e:0100:A"]),
        ([UsbIdentity(0x0BDA, 0x5830, "", "1-1")], ["0bda:5830"]),
        ([UsbIdentity(0x0BDA, 0x5830, "", socket) for socket in ("1-1", "1-2")], ["1-1", "1-2"]),
        ([UsbIdentity(0x10C4, 0xEA60, "0001", socket) for socket in ("1-1", "1-2")], ["1-1", "1-2"]),
    ],
)
def test_identity_is_as_long_as_it_must_be_and_finds_its_own(present, text):
    assert [usb.as_text(present) for usb in present] == text
    for usb, identity in zip(present, text, strict=True):
        assert [other for other in present if other.matches(identity)] == [usb]


@pytest.fixture
def present(monkeypatch):
    plugged = [
        ("/dev/video0", UsbIdentity(0x0408, 0x5362, "", "1-5", "Webcam")),
        ("/dev/video2", UsbIdentity(0x1E4E, 0x0100, "ABC", "1-2", "PureThermal (fw:v1.3.0)")),
    ]
    opened = []

    class NoSource:  # no such node is there
        def __init__(self, path, *_):
            opened.append(path)

        def close(self):
            """Nothing to close."""

    plugged_in(monkeypatch, cameras=plugged)
    monkeypatch.setattr(source, "V4l2Source", NoSource)
    return opened


@pytest.mark.parametrize("identity", ["1e4e:0100:ABC", "1e4e:0100", "1E4E:0100", "1-2", ""])
def test_camera_is_opened_by_identity_whatever_its_number(present, identity):
    found = open_source(DeviceSettings("ir", "purethermal", identity=identity), WANTED, HostClock())
    assert present == ["/dev/video2"]
    assert found.identity == "1e4e:0100:ABC"


@pytest.mark.parametrize("identity", ["1e4e:0100:XYZ", "0bda:5830", "1-9"])
def test_other_camera_is_an_error_never_a_fallback(present, identity):
    with pytest.raises(DeviceNotFoundError, match="0408:5362 at /dev/video0") as caught:
        open_source(DeviceSettings("ir", "purethermal", identity=identity), WANTED, HostClock())
    assert "identity =" in str(caught.value.fix)
    assert present == []


def test_with_nothing_plugged_in_the_advice_is_to_plug_it_in(monkeypatch):
    plugged_in(monkeypatch)
    with pytest.raises(DeviceNotFoundError, check=at("ir", Action.FIND_DEVICES())):
        open_source(DeviceSettings("ir", "purethermal"), WANTED, HostClock())


def test_found_cameras_are_those_of_the_family(present):
    assert [camera.identity for camera in PureThermal().find()] == ["1e4e:0100:ABC"]
