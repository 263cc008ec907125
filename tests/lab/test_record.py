"""Whole recordings through the real drivers: nothing lost, everything stamped, the same slopes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from busy import nothing_lost
from usblab.campaign import (
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
from usblab.field import Field
from usblab.lab import STRANGER, Lab
from usblab.meters import LightMeter, Thermometer
from usblab.models.p2pro import P2Pro
from usblab.models.purethermal import BULK, PureThermal
from usblab.recording import Recording
from usblab.reference import tilts_deg


def test_devices_lists_what_is_plugged_in_by_identity(lab: Lab, field: Field):
    with lab.camera(PureThermal(field.lepton)), lab.meter(LightMeter(field)):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID)
        ended = lab.run("fieldkit", "devices", "--json")
    assert ended.code == 0, ended
    found = {device["identity"]: device["drivers"] for device in ended.json["devices"]}
    assert found["1e4e:0100:8007000b-5113-3037-3231"] == ["purethermal"]
    assert "lutron" in found["0403:6001:LUX0001"]


def test_doctor_finds_the_instruments_ready_and_the_clock_wrong(lab: Lab, field: Field):
    with lab.camera(PureThermal(field.lepton)), lab.meter(LightMeter(field)):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID)
        known = {"camera": {**CAMERA, "identity": "1e4e:0100:8007000b-5113-3037-3231"}, "lux": LUX}
        lab.put("/home/observer/healthy/fieldkit.toml", toml(field.scene, known))
        ended = lab.run("fieldkit", "doctor", "--json", folder="/home/observer/healthy")
    failed = [check for check in ended.json["checks"] if check["level"] == "fail"]
    assert [check["what"] for check in failed] == ["clock"]  # the guest lives in 2016, and doctor sees it


STARTING_NS = 3_000_000_000
"""Cameras stream since they were opened; some first pictures are lost until the session is there."""


@pytest.fixture(scope="module")
def recorded(lab: Lab, field: Field) -> Iterator[tuple[Recording, dict[str, Any], int]]:
    """A little more than a minute of two cameras and two meters, and the lux records sent meanwhile.

    It begins ten seconds before the minute is full, so that it touches the three minutes a slope needs.
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
        recording = Recording(
            lab, field, devices, lambda: lab.set_clock(field.scene.start_ns + 650_000_000_000)
        )
        recording.flows()
        sent_before = lux.records
        recording.until(port, 9 * 68, timeout_s=120)
        sent = lux.records - sent_before
        session = recording.stop()
    yield recording, session, sent
    recording.remove()


def lost(session: dict[str, Any]) -> int:
    """Pictures missing from the cameras' streams once the recording had begun, by time and by flag."""
    (start_ns,) = [event["mono_ns"] for event in session["events"] if event["kind"] == "START"]
    missing = 0
    for name, rate_hz in (("camera", 9.0), ("second", 25.0)):
        samples = zip(session["streams"][name]["stamps_ns"], session["streams"][name]["flags"], strict=True)
        settled = [(stamp, flags) for stamp, flags in samples if stamp > start_ns + STARTING_NS]
        lasting_s = (settled[-1][0] - settled[0][0]) * 1e-9
        missing += abs(round(lasting_s * rate_hz) + 1 - len(settled))
        missing += sum("DROPPED_BEFORE" in flags for _, flags in settled)
    return missing


def test_no_picture_and_no_reading_is_lost(recorded: tuple[Recording, dict[str, Any], int]):
    _, session, lux_sent = recorded
    assert session["state"] == "sealed"
    assert session["streams"]["lux"]["count"] >= lux_sent
    assert all(session["streams"][name]["unflagged_duplicates"] == 0 for name in ("camera", "second"))
    nothing_lost(lost(session))


def test_pictures_are_stamped_by_the_kernel(recorded: tuple[Recording, dict[str, Any], int]):
    """Its stamps are as regular as the camera; those of a reader who polls are not."""
    camera = recorded[1]["streams"]["camera"]
    assert camera["info"]["settings"]["backend"] == "v4l2"
    steps_ms = [(later - earlier) / 1e6 for earlier, later in pairwise(camera["stamps_ns"])]
    assert statistics.median(steps_ms) == pytest.approx(1000 / 9, rel=0.02)


def test_slopes_are_those_of_the_same_field_recorded_without_usb(
    recorded: tuple[Recording, dict[str, Any], int], field: Field, tmp_path: Path
):
    session = recorded[1]
    if not all(math.isfinite(tilt) for _, _, tilt, _ in session["estimates"][-3:]):
        nothing_lost(lost(session))  # whole minutes may be missing on a busy computer
    lasting_s = (session["end_ns"] - session["start_ns"]) / 1e9
    expected = tilts_deg(field.scene, session["start_ns"], lasting_s, tmp_path)
    found = {region: tilt for region, _, tilt, _ in session["estimates"]}
    assert found == pytest.approx(expected, abs=0.05)


def test_check_and_show_read_what_was_recorded(recorded: tuple[Recording, dict[str, Any], int]):
    recording, session, _ = recorded
    checked = recording.fieldkit("check", recording.session, "--json")
    assert checked.code == 0, checked
    assert checked.json["sessions"][0]["level"] != "fail"
    shown = recording.fieldkit("show", recording.session, "--json")
    assert {one["name"]: one["samples"] for one in shown.json["streams"]} == {
        name: stream["count"] for name, stream in session["streams"].items()
    }


def test_somebody_outside_the_groups_is_told_what_to_do(lab: Lab, field: Field):
    with lab.camera(PureThermal(field.lepton)):
        lab.wait_for(CAMERA_BY_ID)
        lab.put("/home/stranger/campaign/fieldkit.toml", toml(field.scene, {"camera": CAMERA}), STRANGER)
        ended = lab.run("fieldkit", "record", "--for", "5s", user=STRANGER, folder="/home/stranger/campaign")
    assert ended.code == 4, ended
    assert "no permission for the camera /dev/video0" in ended.err
    assert "usermod -aG video" in ended.err
