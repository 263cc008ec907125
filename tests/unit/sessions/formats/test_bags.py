"""Recordings of ROS, written by rosbags as ROS writes them: the numbers that went in."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.physics.camera_laws import frame_k
from fieldkit.results.importing import ImportOptions, read_source
from tests.harness.next_steps import at

START_NS = 1_780_000_000_000_000_000
KELVIN = np.float32(295.0 + np.arange(12).reshape(3, 4))
KELVIN[0, 0] = np.nan
IN_KELVIN = ImportOptions(unit="K")


def bag(path: Path, version: int = 2, plugin=StoragePlugin.SQLITE3, big_endian: bool = False) -> Path:
    """Ten messages of each topic, a second apart; the recorder stamped them a second late."""
    store = get_typestore(Stores.ROS2_HUMBLE if version == 2 else Stores.ROS1_NOETIC)
    types = store.types
    seq = {} if version == 2 else {"seq": 0}

    def header(number: int):
        stamp = types["builtin_interfaces/msg/Time"](sec=START_NS // 10**9 + number, nanosec=0)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **seq)

    def image(number: int, encoding: str, pixels: np.ndarray):
        rows, cols = pixels.shape
        data = np.frombuffer(pixels.tobytes(), np.uint8)
        more = {"is_bigendian": int(big_endian), "step": cols * pixels.itemsize, "data": data}
        size = {"header": header(number), "height": rows, "width": cols}
        return types["sensor_msgs/msg/Image"](encoding=encoding, **size, **more)

    order = ">" if big_endian else "<"
    messages = {
        "/air": (
            "sensor_msgs/msg/Temperature",
            lambda n: {"header": header(n), "temperature": 20.0 + n, "variance": 0.0},
        ),
        "/roof/ghi": ("std_msgs/msg/Float64", lambda n: {"data": 500.0 + n}),
        "/imu/field": ("geometry_msgs/msg/Vector3", lambda n: {"x": 1.0, "y": 2.0, "z": float(n)}),
        "/text": ("std_msgs/msg/String", lambda n: {"data": "hello"}),
        "/thermal": (None, lambda n: image(n, "32FC1", (KELVIN + n).astype(f"{order}f4"))),
        "/raw": (None, lambda n: image(n, "16UC1", np.full((3, 4), 29_000 + n, f"{order}u2"))),
        "/colour": (None, lambda n: image(n, "mono8", np.zeros((3, 4), np.uint8))),
    }
    writer = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
    with writer:
        links = {
            topic: writer.add_connection(topic, kind or "sensor_msgs/msg/Image", typestore=store)
            for topic, (kind, _) in messages.items()
        }
        for number in range(10):
            for topic, (kind, make) in messages.items():
                message = types[kind](**make(number)) if kind else make(number)
                data = serialize(message, message.__msgtype__)
                writer.write(links[topic], START_NS + (number + 1) * 10**9, data)
    return path


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"plugin": StoragePlugin.MCAP},
        {"version": 1},
        {"big_endian": True},
    ],
)
def test_topics_become_streams_in_their_units(tmp_path, layout):
    path = bag(tmp_path / ("a.bag" if layout.get("version") == 1 else "a"), **layout)
    if "plugin" in layout:
        path = next(path.glob("*.mcap"))
    topics = ("/air", "/imu/field", "/thermal", "/colour", "/text")
    imported = read_source(path, ImportOptions(unit="K", columns=topics))
    streams = {info.name: info for info in imported.streams}
    assert set(streams) == {"air", "imu-field", "thermal"}
    samples = {name: [s for s in imported.samples if s.stream == name] for name in streams}
    assert [s.values[0] for s in samples["air"]] == pytest.approx([293.15 + n for n in range(10)])
    assert [s.time_ns for s in samples["air"]] == [START_NS + n * 10**9 for n in range(10)]
    assert samples["imu-field"][9].values == (1.0, 2.0, 9.0)
    assert samples["imu-field"][0].time_ns == START_NS + 10**9  # of its recording
    frame = samples["thermal"][2]
    assert frame_k(streams["thermal"], frame.counts, frame.metadata_rows) == pytest.approx(
        KELVIN + 2, nan_ok=True
    )
    assert [text for _, text in imported.notes if "/colour, /text" in text]


def test_counts_units_and_components_are_as_given_or_asked_for(tmp_path):
    path = bag(tmp_path / "a")
    for topic, step in (("/thermal", Argument("unit", "K")), ("/raw", Argument("kelvin_per_count", 0.01))):
        with pytest.raises(ConfigError, check=at(f"{path}, {topic}", step)):
            read_source(path, ImportOptions(columns=(topic,)))
    (info,) = read_source(path, ImportOptions(columns=("/raw",), kelvin_per_count=0.01, name="roof")).streams
    assert (info.name, info.shape, info.scale, info.rate_hz) == ("roof-raw", (3, 4), 0.01, 1.0)
    (ghi,) = read_source(path, ImportOptions(columns=("/roof/ghi",), unit="W/m2")).streams
    assert (ghi.unit, ghi.measures) == ("W m-2", ("ghi",))
    with pytest.raises(ConfigError, match="/text", check=at(path)):
        read_source(path, ImportOptions(columns=("/text",)))


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_what_is_no_recording_of_ros_is_refused(tmp_path, name):
    for data in (b"", b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n" + bytes(300)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ConfigError, check=at(tmp_path / name)):
            read_source(tmp_path / name, IN_KELVIN)


def test_the_unit_of_images_is_not_that_of_bare_numbers(tmp_path):
    path = bag(tmp_path / "a")
    imported = read_source(path, ImportOptions(unit="K", columns=("/thermal", "/roof/ghi")))
    assert {info.name: info.unit for info in imported.streams} == {"thermal": "K", "roof-ghi": ""}
