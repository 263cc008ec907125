"""The packets are those of the maker's description: danjulio/lepton, ESP32/tCam-Mini/readme.md."""

import base64
import json
import select
import socket
import threading
from contextlib import suppress

import numpy as np
import pytest
import zeroconf

import fieldkit
from fieldkit.drivers.cameras.tcam import LAYOUT, PORT, SERVICE, TCam, decode, parse
from fieldkit.drivers.decoding import Record, Rejected
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.samples import Quality
from fieldkit.recording.adding import add_devices
from tests.harness.conformance import conforms
from tests.harness.next_steps import at

STATUS = '{"status": {"Camera": "tCam-Mini-EFB5", "Model": 262402, "Version": "2.0"}}'
CONFIG = '{"config":{"agc_enabled":0,"emissivity":98,"gain_mode":0}}'
START_OF_THE_MAKERS_IMAGE = "I3Ypdg12B3YPdgt2BXYRdgF2A3YFdgF2AXYNdv91+3UL"
START_OF_THE_MAKERS_TELEMETRY = "DgCDMSkAMAgAABBhCIKyzJpk"


def wrapped(text):
    return b"\x02" + text.encode() + b"\x03"


def image(counts=30243, uptime=60_000, resolution=1, **changes):
    telemetry = np.zeros(240, "<u2")
    telemetry[[0, 1, 20, 24, 26, 99]] = 14, uptime, uptime // 111, 30_000, 29_900, 8192
    telemetry[208:210] = 1, resolution
    pixels = np.full(19_200, counts, "<u2")
    content = {
        "metadata": {"Camera": "tCam-Mini-EFB5", "Model": 2},
        "radiometric": base64.b64encode(pixels.tobytes()).decode(),
        "telemetry": base64.b64encode(telemetry.tobytes()).decode(),
        **changes,
    }
    return wrapped(json.dumps(content, indent=1))


def test_the_makers_own_image_begins_with_a_room_in_kelvin_times_100():
    pixels = np.frombuffer(base64.b64decode(START_OF_THE_MAKERS_IMAGE)[:32], "<u2")
    whole = base64.b64encode(np.resize(pixels, 19_200).tobytes()).decode()
    decoded = decode(image(radiometric=whole))
    assert decoded.counts[0, :3].tolist() == [0x7623, 0x7629, 0x760D]
    assert decoded.counts[0, 0] * decoded.scale == pytest.approx(302.43)
    assert base64.b64decode(START_OF_THE_MAKERS_TELEMETRY)[:2] == b"\x0e\x00"  # revision 14, as in `image`


def test_resolution_of_the_telemetry_scales_the_low_gain():
    decoded = decode(image(counts=4500, resolution=0))
    assert decoded.counts[0, 0] * decoded.scale == pytest.approx(450.0)
    assert (decoded.device_time, decoded.fpa_temperature_k) == (60_000, 300.0)


@pytest.mark.parametrize(
    ("part", "content"),
    [*(("radiometric", content) for content in ("AAAA", "§", None)), ("telemetry", "A"), ("telemetry", 5)],
)
def test_a_damaged_image_is_rejected_with_its_reason(part, content):
    changes = {part: content}
    parsed = parse(image(**changes))
    assert isinstance(parsed, Rejected)
    assert parsed.length == len(image(**changes))
    assert "base64" in parsed.reason or "bytes" in parsed.reason


def test_agc_leaves_no_temperatures():
    assert decode(image(counts=128)).quality & Quality.NO_VALUE


def test_packets_are_found_among_replies_and_noise():
    decoded = TCam().decode(b"xx" + wrapped(STATUS) + image() + wrapped(CONFIG) + image()[:100], {})
    assert decoded.notes == ("status", "frame of 160x120", "config")
    assert [(part.offset, part.length) for part in decoded.rejected] == [(0, 2)]
    assert decoded.rest == 100
    assert decoded.values[1].value == pytest.approx(302.43)


def test_half_a_packet_does_not_take_the_next_one_with_it():
    decoded = TCam().decode(image()[:20_000] + image(), {})
    assert decoded.notes == ("frame of 160x120",)
    assert [rejected.length for rejected in decoded.rejected] == [20_000]


def test_bytes_without_an_end_are_dropped_at_once():
    parsed = parse(b"\x02" + bytes([65]) * (LAYOUT.longest - 1))
    assert isinstance(parsed, Rejected)
    assert parsed.length == LAYOUT.longest
    assert isinstance(parse(wrapped(STATUS)), Record)


class FarEnd:
    """A tCam on loopback: answers commands, and sends `stream`, piece by piece, once told to."""

    def __init__(self, stream, address=("127.0.0.1", 0)):
        self.server = socket.create_server(address)
        self.port = f"127.0.0.1:{self.server.getsockname()[1]}"
        self.stream, self.commands = stream, []
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        with suppress(OSError):
            while True:
                connection, _ = self.server.accept()
                with connection, suppress(OSError):
                    self.talk(connection)

    def talk(self, connection):
        heard, pieces = b"", iter(())
        while True:
            if select.select([connection], [], [], 0.01)[0]:
                received = connection.recv(4096)
                if not received:
                    return
                *packets, heard = (heard + received).split(b"\x03")
                for one in packets:
                    pieces = self.answer(connection, json.loads(one.strip(b"\x02")), pieces)
            connection.sendall(next(pieces, b""))

    def answer(self, connection, command, pieces):
        self.commands.append(command)
        replies = {"get_status": STATUS, "get_config": CONFIG, "set_config": '{"cam_info":{"info_value":1}}'}
        if command["cmd"] in replies:
            connection.sendall(wrapped(replies[command["cmd"]]))
        elif command["cmd"] == "run_ffc":
            connection.shutdown(socket.SHUT_RDWR)
        return iter(self.stream) if command["cmd"] == "stream_on" else pieces


@pytest.fixture
def far_end():
    ends = []

    def start(stream, **more):
        ends.append(FarEnd(stream, **more))
        return ends[-1]

    yield start
    for one in ends:
        one.server.shutdown(socket.SHUT_RDWR)
        one.server.close()
        one.thread.join(5)


IMAGES = [image(30_000 + number, 60_000 + 111 * number) for number in range(30)]


def test_a_camera_conforms_in_the_network(far_end):
    conforms(TCam(), DeviceSettings("t", "tcam", port=far_end(IMAGES).port))


def test_a_camera_in_the_network_is_opened_read_and_left(far_end):
    far_end = far_end([*IMAGES[:2], b"garbage", IMAGES[2]])
    device = TCam().open(DeviceSettings("ir", "tcam", port=far_end.port), HostClock())
    info = device.info
    assert (info.unit, info.shape, info.scale, info.firmware) == ("K", (120, 160), 0.01, "2.0")
    assert info.serial_number == "tCam-Mini-EFB5"
    assert (info.settings["emissivity"], info.settings["gain"]) == (0.98, "high")
    frames = [device.read(1.0) for _ in range(3)]
    # without the garbage before the third
    numbers = [frame and (int(frame.counts[0, 0]), frame.device_time) for frame in frames]
    assert numbers == [(30_001, 60_111), None, (30_002, 60_222)]
    assert device.rejected == 1
    assert device.run_shutter()
    with pytest.raises(DeviceLostError, match=r"127\.0\.0\.1"):
        device.read(1.0)
    device.close()
    device.close()
    names = [command["cmd"] for command in far_end.commands]
    assert names == ["get_status", "set_config", "get_config", "stream_on", "run_ffc"]
    assert far_end.commands[1]["args"] == {"agc_enabled": 0}


def test_an_address_is_needed_and_named_when_nothing_answers():
    with pytest.raises(ConfigError, check=at("ir")):
        TCam().open(DeviceSettings("ir", "tcam"), HostClock())
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = f"127.0.0.1:{unused.getsockname()[1]}"
    with pytest.raises(DeviceNotFoundError, check=at(port)) as caught:
        TCam().open(DeviceSettings("ir", "tcam", port=port), HostClock())
    assert "tCam-Mini" in caught.value.fix


def test_a_camera_that_announces_itself_is_found():
    """Service and name as in the maker's description, "mDNS Discovery"."""
    name = f"tCam-Mini-87E9.{SERVICE}"
    address = {"port": 5001, "addresses": [socket.inet_aton("127.0.0.1")], "server": "tcam.local."}
    with zeroconf.Zeroconf() as network:
        network.register_service(zeroconf.ServiceInfo(SERVICE, name, **address))
        (camera,) = TCam().find()
    assert (camera.driver, camera.port) == ("tcam", "127.0.0.1")
    assert "tCam-Mini-87E9" in camera.title


def test_a_camera_is_added_by_its_host_and_a_host_without_one_is_refused(far_end, tmp_path):
    far_end(IMAGES, address=("127.0.0.9", PORT))
    file = fieldkit.init_campaign(tmp_path / "hill", (37.7, -105.92, 2317.0)).config.path
    additions = add_devices(file, addresses=["127.0.0.9", "127.0.0.10"])
    assert [(added.name, added.driver, added.port) for added in additions.added] == [
        ("camera", "tcam", "127.0.0.9:5001")
    ]
    assert add_devices(file, addresses=["127.0.0.9"]).configured == {"127.0.0.9": "camera"}
    assert [failure.place for failure in additions.failures] == ["127.0.0.10"]
