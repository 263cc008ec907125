"""GenICam: aravis' own fake camera on loopback, a real GigE Vision camera to everything above it."""

import ctypes
import re
import shutil
import subprocess
import time
from collections.abc import Callable

import pytest

from fieldkit.drivers.cameras.genicam import Genicam
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceError
from fieldkit.recording.record import record
from tests.harness.conformance import conforms

PROGRAM = shutil.which("arv-fake-gv-camera-0.8")
ADDRESS = "127.0.0.1"
SMALL = {"width": 160, "height": 120}
RATE_HZ = 25.0

# FLIR's feature in a free register of the fake camera, by GenICam's standard features naming
IR_FORMAT = """
<Enumeration Name="IRFormat">
  <EnumEntry Name="Radiometric"><Value>0</Value></EnumEntry>
  <EnumEntry Name="TemperatureLinear100mK"><Value>1</Value></EnumEntry>
  <EnumEntry Name="TemperatureLinear10mK"><Value>2</Value></EnumEntry>
  <pValue>IRFormatRegister</pValue>
</Enumeration>
<IntReg Name="IRFormatRegister">
  <Address>0x3f0</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>
  <Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>
</IntReg>
"""


@pytest.fixture(autouse=True)
def _unplugged_after():
    """In place of the guest's: this camera is on this computer's loopback."""


@pytest.fixture(autouse=True)
def _aravis():
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        assert PROGRAM is not None, "arv-fake-gv-camera-0.8 is not installed"
    except (ImportError, ValueError, AssertionError) as reason:
        pytest.skip(f"needs aravis and PyGObject: {reason}")


@pytest.fixture
def camera(tmp_path):
    """Starts the fake camera, with changes to its description, instead of the one that runs."""
    running: list[subprocess.Popen[bytes]] = []

    def start(change: Callable[[str], str] = str, lost_per_thousand: int = 0) -> None:
        _stop(running)
        words = [str(PROGRAM), "-i", ADDRESS, "-s", "FK01", "-r", str(lost_per_thousand)]
        if change is not str:
            description = tmp_path / "camera.xml"
            description.write_text(change(_description(words)))
            words += ["-g", str(description)]
        running.append(subprocess.Popen(words, stdout=subprocess.DEVNULL))
        time.sleep(0.5)  # it says nothing when it listens, and to ask it is to be its only client

    yield start
    _stop(running)


def _stop(running: list[subprocess.Popen[bytes]]) -> None:
    while running:
        running[-1].kill()
        running.pop().wait(5)


def _description(words: list[str]) -> str:
    """What the camera itself says of its features; by its length, for the text has no end of its own."""
    aravis = ctypes.CDLL("libaravis-0.8.so.0")
    for function in (aravis.arv_camera_new, aravis.arv_camera_get_device, aravis.arv_device_get_genicam_xml):
        function.restype = ctypes.c_void_p
    size = ctypes.c_size_t()
    with subprocess.Popen(words, stdout=subprocess.DEVNULL) as plain:
        try:
            time.sleep(0.5)  # as in `camera`
            camera = ctypes.c_void_p(aravis.arv_camera_new(ADDRESS.encode(), None))
            device = ctypes.c_void_p(aravis.arv_camera_get_device(camera))
            text = aravis.arv_device_get_genicam_xml(device, ctypes.byref(size))
            return ctypes.string_at(text, size.value).decode()
        finally:
            plain.kill()


def with_ir_format(description: str) -> str:
    return description.replace("</RegisterDescription>", f"{IR_FORMAT}</RegisterDescription>")


def without_mono16(description: str) -> str:
    return re.sub(r'<EnumEntry Name="(?!Mono8)\w+".*?</EnumEntry>', "", description, flags=re.DOTALL)


def settings(**options: object) -> DeviceSettings:
    return DeviceSettings("ir", "genicam", port=ADDRESS, options={**SMALL, **options})


@pytest.mark.parametrize(("resolution", "kelvin"), [("10mK", 0.01), ("100mK", 0.1)])
def test_linear_temperatures_are_set_and_read_back(camera, resolution, kelvin):
    camera(with_ir_format)
    device = Genicam().open(settings(resolution=resolution), HostClock())
    info = device.info
    assert (info.unit, info.scale, info.shape) == ("K", kelvin, (120, 160))
    assert (info.vendor, info.model, info.serial_number) == ("Aravis", "Fake", "FK01")
    assert info.settings["ir_format"] == f"TemperatureLinear{resolution}"
    device.close()


def test_a_camera_without_a_known_scale_gives_counts(camera):
    camera()
    device = Genicam().open(settings(), HostClock())
    assert device.info.unit == "counts"
    device.close()


def test_a_camera_of_8_bits_is_refused_by_name(camera):
    camera(without_mono16)
    with pytest.raises(DeviceError, match="Mono8"):
        Genicam().open(settings(), HostClock())


def test_the_driver_conforms(camera):
    camera(with_ir_format)
    conforms(Genicam(), settings())


def test_a_minute_is_recorded_without_a_loss(camera, tmp_path):
    camera(with_ir_format)
    campaign = tmp_path / "campaign"
    campaign.mkdir()
    (campaign / "fieldkit.toml").write_text(
        f'[site]\nlatitude_deg = 35.6\nlongitude_deg = 139.7\nelevation_m = 40\ntimezone = "Asia/Tokyo"\n'
        f'[camera]\ndriver = "genicam"\nport = "{ADDRESS}"\nwidth_px = 160\nheight_px = 120\n'
        f'options = {{ width = 160, height = 120 }}\n[record]\nsampling = "all"\n'
    )
    with record(campaign, duration="60s") as session:
        numbers = [one.device_seq for one in session["camera"]]
        times_ns = session["camera"].times_ns()
    lasted_s = (times_ns[-1] - times_ns[0]) / 1e9
    assert lasted_s > 58
    assert (
        len(numbers) > 0.8 * RATE_HZ * lasted_s
    )  # the fake camera keeps its rate as well as the computer does
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_frames_whose_packets_are_lost_are_counted(camera):
    """Two packets in a hundred are lost: of some 27 to a frame, about half of the frames stay whole."""
    camera(with_ir_format, lost_per_thousand=20)
    device = Genicam().open(settings(), HostClock())
    frames = [device.read(1.0) for _ in range(50)]
    device.close()
    assert device.rejected > 0
    assert any(frames)
