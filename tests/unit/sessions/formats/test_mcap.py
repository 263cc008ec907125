"""A session as MCAP, read back by the format's own reader and by rosbags with ROS's own definitions."""

import json
import math
import re

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags import typesys

from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, EventKind, Frame
from fieldkit.model.site import Site
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate, SlopeState
from fieldkit.physics.camera_laws import frame_k
from fieldkit.sessions.formats.bags import read_bag
from fieldkit.sessions.formats.imported import write_imported
from fieldkit.sessions.formats.ros2 import export_mcap
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import MinuteRecord
from tests.harness.logs import read
from tests.harness.recording import START_NS, header, recorded, session_of

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
            own = {name: fields for name, fields in stored.items() if name.startswith("fieldkit_msgs/")}
            STORE.register({name: fields for name, fields in own.items() if name not in STORE.fielddefs})
            assert all(fields[1] == STORE.fielddefs[name][1] for name, fields in stored.items())
            decoded = STORE.deserialize_cdr(message.data, schema.name)
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def test_frames_and_readings_come_back_as_ros_has_them(session, tmp_path):
    (path,) = export_mcap(session, tmp_path)
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
        assert len(topics) == 1 + (1 if info.is_camera else info.shape[0])
    assert all(np.isin(log.level, (20, 30, 40)) for _, log in found.get("/rosout", []))


def test_streams_and_channels_of_any_name_have_topics_of_their_own(tmp_path):
    """By https://design.ros2.org/articles/topic_and_service_names.html, where Japanese is not allowed."""
    text = "time,気温 [C],地温 [C],T-1 [C],T 1 [C]\n2026-05-12T12:00:00Z,20,21,22,23\n"
    recording = read(tmp_path, text, "logger-temperature")
    head = SessionHeader("t", Site(47.1, 8.5), recording.streams)
    write_imported(tmp_path / "a.h5", head, recording, "log.csv")
    with open_session(tmp_path / "a.h5") as opened:
        found = messages(export_mcap(opened, tmp_path)[0])
    topics = [topic for topic in found if topic not in ("/rosout", "/events")]
    assert all(re.fullmatch("(/[A-Za-z_][A-Za-z0-9_]*)+", topic) and "__" not in topic for topic in topics)
    celsius = [getattr(message, "temperature", message) for topic in topics for _, message in found[topic]][
        1:
    ]
    assert celsius == pytest.approx([20.0, 21.0, 22.0, 23.0])


def test_only_every_other_frame_of_one_stream(session, tmp_path):
    (name,) = (name for name, info in session.streams.items() if info.is_camera)
    (path,) = export_mcap(session, tmp_path, stream=name, every=2)
    assert path.name == f"field-{name}.mcap"
    found = messages(path)
    assert set(found) <= {f"/{name}/sample", f"/{name}/image_raw", "/rosout", "/events"}
    assert len(found[f"/{name}/image_raw"]) == len(found[f"/{name}/sample"]) == 3
    with pytest.raises(SessionError, match="sonar"):
        export_mcap(session, tmp_path, stream="sonar")


def test_every_sample_is_there_as_it_was_recorded(session, tmp_path):
    """By the format's own reader, which knows none of these messages, only their definitions in the file."""
    (path,) = export_mcap(session, tmp_path)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        (attachment,), (about,) = reader.iter_attachments(), reader.iter_metadata()
        decoded = list(reader.iter_decoded_messages())
    assert attachment.data.decode() == session.config_toml
    facts = json.loads(about.metadata["header"])
    assert facts["site"]["longitude_deg"] == session.site.longitude_deg
    assert [stream["scale"] for stream in facts["streams"] if stream["name"] == "camera"] == [0.01]
    samples = {
        (channel.topic, message.seq): message
        for _, channel, _, message in decoded
        if channel.topic.endswith("/sample")
    }
    for original in session.samples():
        message = samples.pop((f"/{original.stream}/sample", original.seq))
        stamps = message.mono_ns, message.flags, message.device_seq, message.device_time
        assert stamps == (original.mono_ns, original.quality, original.device_seq, original.device_time)
        is_frame = isinstance(original, Frame)
        raw = original.counts.tobytes() + original.metadata_rows.tobytes() if is_frame else original.raw
        assert bytes(message.raw) == raw
        fpa_k = original.fpa_temperature_k if is_frame else math.nan
        assert message.fpa_temperature == pytest.approx(fpa_k, nan_ok=True)
    assert samples == {}


def test_slopes_and_the_details_of_events_come_along(tmp_path):
    wind = Event(EventKind.MARK, 0, START_NS, "wind", data={"label": "wind", "wind_m_s": math.nan})
    slope = SlopeEstimate(START_NS, "b05", SlopeState.WIDE, 5.5, 180.0, 4.0, 7.0, n_bins=3, reason="haze")
    path = session_of(tmp_path / "a.h5", header((8, 8)), wind, MinuteRecord(START_NS, (slope,)))
    with open_session(path) as opened:
        found = messages(export_mcap(opened, tmp_path)[0])
        (stored,) = opened.estimates()
    ((time_ns, message),) = found["/slopes"]
    assert (message.header.frame_id, message.state, message.minutes) == ("b05", "wide", 3)
    assert (time_ns, message.reason) == (stored.time_ns, "haze")
    numbers = [getattr(message, name) for name in SLOPE_FIELDS]
    assert numbers == pytest.approx([getattr(stored, name) for name in SLOPE_FIELDS], nan_ok=True)
    assert [json.loads(event.data) for _, event in found["/events"] if event.text == "wind"] == [
        {"label": "wind", "wind_m_s": None}
    ]


def test_frames_and_meters_are_imported_again(session, tmp_path):
    """Counts of 0.01 K, as the camera of the session has; of what is beside them nothing becomes a meter."""
    (path,) = export_mcap(session, tmp_path)
    recording = read_bag(path, unit="K")
    assert [info.name for info in recording.streams if not info.is_camera] == [
        "lux-illuminance", *(f"thermometer-T{n}" for n in range(1, 5)),
    ]  # fmt: skip
    frames = [sample for sample in recording.samples if isinstance(sample, Frame)]
    for frame, original in zip(frames, session.samples("camera"), strict=True):
        assert (frame.time_ns, frame.counts.tobytes()) == (original.time_ns, original.counts.tobytes())
