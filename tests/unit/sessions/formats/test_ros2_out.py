"""A session as ROS 2 messages, read back by rosbags with ROS's own definitions."""

import re

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags import typesys

from fieldkit.model.samples import Frame
from fieldkit.model.site import Site
from fieldkit.physics.camera_laws import frame_k
from fieldkit.sessions.formats.imported import write_imported
from fieldkit.sessions.formats.ros2 import export_ros2
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from tests.harness.logs import read
from tests.harness.recording import header, recorded

STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "field.h5"
    recorded(path, header((24, 32)), 6)
    with open_session(path) as opened:
        yield opened


def messages(path):
    found = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            stored = typesys.get_types_from_msg(schema.data.decode(), schema.name)
            assert all(fields[1] == STORE.fielddefs[name][1] for name, fields in stored.items())
            decoded = STORE.deserialize_cdr(message.data, schema.name)
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def test_frames_and_readings_come_back_as_ros_has_them(session, tmp_path):
    (path,) = export_ros2(session, tmp_path)
    found = messages(path)
    (name,) = (name for name, info in session.streams.items() if info.is_camera)
    frames = [one for one in session.samples(name) if isinstance(one, Frame)]
    assert len(found[f"/{name}/image_raw"]) == len(frames) == 6
    for (time_ns, image), frame in zip(found[f"/{name}/image_raw"], frames, strict=True):
        assert time_ns == frame.time_ns == image.header.stamp.sec * 10**9 + image.header.stamp.nanosec
        assert (image.height, image.width, image.encoding, image.step) == (24, 32, "32FC1", 128)
        kelvin = image.data.view("<f4").reshape(24, 32)
        assert kelvin == pytest.approx(frame_k(session.streams[name], frame.counts, frame.metadata_rows))
    for other, info in session.streams.items():
        topics = [topic for topic in found if topic.startswith(f"/{other}/")]
        assert len(topics) == (1 if info.is_camera else info.shape[0])
    assert all(np.isin(log.level, (20, 30, 40)) for _, log in found.get("/rosout", []))


def test_streams_and_channels_of_any_name_have_topics_of_their_own(tmp_path):
    """By https://design.ros2.org/articles/topic_and_service_names.html, where Japanese is not allowed."""
    text = "time,気温 [C],地温 [C],T-1 [C],T 1 [C]\n2026-05-12T12:00:00Z,20,21,22,23\n"
    recording = read(tmp_path, text, "logger-temperature")
    head = SessionHeader("t", Site(47.1, 8.5), recording.streams)
    write_imported(tmp_path / "a.h5", head, recording, "log.csv")
    with open_session(tmp_path / "a.h5") as opened:
        found = messages(export_ros2(opened, tmp_path)[0])
    topics = [topic for topic in found if topic != "/rosout"]
    assert all(re.fullmatch("(/[A-Za-z_][A-Za-z0-9_]*)+", topic) and "__" not in topic for topic in topics)
    celsius = [message.temperature for topic in topics for _, message in found[topic]]
    assert celsius == pytest.approx([20.0, 21.0, 22.0, 23.0])


def test_only_every_other_frame_of_one_stream(session, tmp_path):
    (name,) = (name for name, info in session.streams.items() if info.is_camera)
    (path,) = export_ros2(session, tmp_path, stream=name, every=2)
    assert path.name == f"field-{name}-ros2.mcap"
    found = messages(path)
    assert set(found) <= {f"/{name}/image_raw", "/rosout"}
    assert len(found[f"/{name}/image_raw"]) == 3
