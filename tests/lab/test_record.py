"""Whole recordings through the real drivers: nothing lost, everything stamped, the same slopes."""

import statistics
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
from fieldlab.campaign import (
    ALL,
    CAMERA,
    CAMERA_BY_ID,
    LUX,
    LUX_BY_ID,
    SECOND_BY_ID,
    SECOND_CAMERA,
    THERMOMETER_BY_ID,
    toml,
)
from fieldlab.field import Field
from fieldlab.meters import LightMeter, Thermometer
from fieldlab.recording import Recording
from fieldlab.reference import tilts_deg
from losses import nothing_lost, places_in, skipped
from usblab.lab import STRANGER, Lab
from usblab.models.p2pro import P2Pro
from usblab.models.purethermal import BULK, PureThermal

from fieldkit.model.units import MINUTE_NS, SECOND_NS


def test_devices_lists_what_is_plugged_in_by_identity(lab, field):
    with lab.camera(PureThermal(field.lepton)), lab.meter(LightMeter(field)):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID)
        ended = lab.run("fieldkit", "devices", "--json")
    assert ended.code == 0, ended
    found = {device["identity"]: device["drivers"] for device in ended.json["devices"]}
    assert found["1e4e:0100:8007000b-5113-3037-3231"] == ["purethermal"]
    assert "lutron" in found["0403:6001:LUX0001"]


def test_doctor_finds_the_instruments_ready_and_the_clock_wrong(lab, field):
    with lab.camera(PureThermal(field.lepton)), lab.meter(LightMeter(field)):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID)
        known = {"camera": {**CAMERA, "identity": "1e4e:0100:8007000b-5113-3037-3231"}, "lux": LUX}
        lab.put("/home/observer/healthy/fieldkit.toml", toml(field.scene, known))
        ended = lab.run("fieldkit", "doctor", "--json", folder="/home/observer/healthy")
    failed = [check for check in ended.json["checks"] if check["level"] == "fail"]
    assert [check["what"] for check in failed] == ["clock"]  # the guest lives in 2016, and doctor sees it


LASTING_NS = 30 * SECOND_NS
STARTING_NS = 3 * SECOND_NS
"""Cameras stream since they were opened; some first pictures are lost until the session is there."""


@dataclass(frozen=True)
class Recorded:
    """A recording, its session, and what was on the cables meanwhile: pictures' checksums, lux records.

    `idle_share` is that of the guest's processors.
    """

    recording: Recording
    session: dict[str, Any]
    pictures_sent: list[int]
    lux_sent: int
    idle_share: float

    def settled(self, stream: str, what: str) -> list[Any]:
        """A column of a stream without the first seconds."""
        (start_ns,) = [event["mono_ns"] for event in self.session["events"] if event["kind"] == "START"]
        samples = self.session["streams"][stream]
        pairs = zip(samples["stamps_ns"], samples[what], strict=True)
        return [value for stamp, value in pairs if stamp > start_ns + STARTING_NS]

    def lost(self) -> int:
        """Pictures of both cameras; the second has no number of its own: the kernel's."""
        places = places_in(self.pictures_sent, self.settled("camera", "sums"))
        return skipped(places) + skipped(self.settled("second", "counters"))


@pytest.fixture(scope="module")
def recorded(lab, field):
    """A recording without a loss, or the last of three, as a fault of fieldkit loses pictures in each.

    The emulator itself drops packets while it gets no processor.
    """
    recorded = record_half_a_minute(lab, field)
    for _ in range(2):
        if recorded.lost() == 0:
            break
        recorded.recording.remove()
        recorded = record_half_a_minute(lab, field)
    yield recorded
    recorded.recording.remove()


def record_half_a_minute(lab: Lab, field: Field) -> Recorded:
    """Thirty seconds of two cameras and two meters.

    It begins half a minute before the minute is full, so that it touches the two minutes a slope needs.
    """
    ports = (
        lab.camera(PureThermal(field.lepton, endpoint=BULK), 0),
        lab.camera(P2Pro(field.wide(192, 256)), 1),
        lab.meter(LightMeter(field), 0),
        lab.meter(Thermometer(field), 1),
    )
    devices = {**ALL, "device.second": SECOND_CAMERA}
    with ports[0] as port, ports[1], ports[2] as lux, ports[3]:
        lab.wait_for(CAMERA_BY_ID, SECOND_BY_ID, LUX_BY_ID, THERMOMETER_BY_ID)
        lab.warm()  # or the minute is full before the recording has begun
        lab.set_clock(field.scene.start_ns + 10 * MINUTE_NS + 30 * SECOND_NS)
        recording = Recording(lab, field, devices)
        recording.flows()
        lux_before, idle_before_s = lux.records, lab.idle_s()
        begun_ns = lab.utc_ns(time.monotonic())
        minute_full_ns = (begun_ns + 10 * SECOND_NS) // MINUTE_NS * MINUTE_NS + MINUTE_NS
        end_ns = max(begun_ns + LASTING_NS, minute_full_ns + 10 * SECOND_NS)
        recording.wait(lambda: lab.utc_ns(time.monotonic()) > end_ns, 0.1)
        idle_share = (lab.idle_s() - idle_before_s) / ((lab.utc_ns(time.monotonic()) - begun_ns) / SECOND_NS)
        lux_sent = lux.records - lux_before
        session = recording.stop()
    return Recorded(recording, session, port.count.sums, lux_sent, idle_share)


def test_no_picture_and_no_reading_is_lost(recorded):
    streams = recorded.session["streams"]
    assert recorded.session["state"] == "sealed"
    assert streams["lux"]["count"] >= recorded.lux_sent
    assert all(streams[name]["unflagged_duplicates"] == 0 for name in ("camera", "second"))
    told = [event["text"] for event in recorded.session["events"]]
    nothing_lost(recorded.lost(), recorded.idle_share, told)


def test_streams_state_the_latency_timer_of_their_adapter(recorded):
    for name in ("lux", "thermometer"):
        assert recorded.session["streams"][name]["info"]["settings"]["usb_latency_ms"] == 1


def test_pictures_carry_the_kernels_stamp_and_a_number(recorded):
    """Its stamps are as regular as the camera; those of a reader who polls are not."""
    for name, rate_hz, step in (("camera", 9.0, 3), ("second", 25.0, 1)):  # a Lepton counts at 27 Hz
        assert recorded.session["streams"][name]["info"]["settings"]["backend"] == "v4l2"
        stamps, counters = (recorded.settled(name, what) for what in ("stamps_ns", "counters"))
        counted = [later - earlier for earlier, later in pairwise(counters)]
        assert min(counted) == step
        waited_ms = [(later - earlier) / 1e6 for earlier, later in pairwise(stamps)]
        one_ms = [waited * step / count for waited, count in zip(waited_ms, counted, strict=True)]
        assert statistics.median(one_ms) == pytest.approx(1000 / rate_hz, rel=0.2)


def test_slopes_are_those_of_the_same_field_recorded_without_usb(recorded, field, tmp_path):
    session = recorded.session
    lasting_s = (session["end_ns"] - session["start_ns"]) / 1e9
    expected = tilts_deg(field.scene, session["start_ns"], lasting_s, tmp_path)
    found = {region: tilt for region, _, tilt, _ in session["estimates"]}
    assert found == pytest.approx(expected, abs=0.05)


def test_check_and_show_read_what_was_recorded(recorded):
    recording, session = recorded.recording, recorded.session
    checked = recording.fieldkit("check", recording.session, "--json")
    assert checked.code == 0, checked.out
    assert checked.json["sessions"][0]["level"] != "fail"
    shown = recording.fieldkit("show", recording.session, "--json")
    assert {one["name"]: one["samples"] for one in shown.json["streams"]} == {
        name: stream["count"] for name, stream in session["streams"].items()
    }


def test_somebody_outside_the_groups_is_told_what_to_do(lab, field):
    with lab.camera(PureThermal(field.lepton)):
        lab.wait_for(CAMERA_BY_ID)
        lab.put("/home/stranger/campaign/fieldkit.toml", toml(field.scene, {"camera": CAMERA}), STRANGER)
        ended = lab.run("fieldkit", "record", "--for", "5s", user=STRANGER, folder="/home/stranger/campaign")
    assert ended.code == 4, ended
    assert "/dev/video0: " in ended.err
    assert "usermod -aG video" in ended.err
