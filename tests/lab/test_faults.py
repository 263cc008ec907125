"""Trouble on the cable while recording: each is seen and named, and the session is sealed and whole."""

import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from fieldlab.campaign import CAMERA_BY_ID, LUX, LUX_BY_ID, THERMOMETER_BY_ID
from fieldlab.meters import LightMeter, Thermometer
from fieldlab.recording import Recording, events
from usblab.models.p2pro import P2Pro
from usblab.models.purethermal import BULK, PureThermal

CYCLES = 20
LOST, BACK, GAP = "camera: lost", "camera: back", "camera: the device or its driver lost samples"


@dataclass
class Troubled:
    """A recording in which one thing after another went wrong.

    `spans_ns` say by the guest's monotonic clock from when on, and when all was well again.
    """

    session: dict[str, Any]
    checked: dict[str, Any]
    spans_ns: dict[str, tuple[int, int]] = field(default_factory=dict)

    def events(self, trouble: str, kind: str, stream: str) -> list[str]:
        """The events of a kind from a trouble's begin until pictures flowed again."""
        begin, end = self.spans_ns[trouble]
        return [
            event["text"]
            for event in self.session["events"]
            if (event["kind"], event["stream"]) == (kind, stream) and begin <= event["mono_ns"] < end
        ]

    def flags(self, trouble: str, stream: str) -> set[str]:
        """The flags of the samples taken meanwhile."""
        begin, end = self.spans_ns[trouble]
        samples = self.session["streams"][stream]
        spans = zip(samples["stamps_ns"], samples["flags"], strict=True)
        return {flag for stamp, flags in spans if begin <= stamp < end for flag in flags}


@pytest.fixture(scope="module")
def troubled(lab, field):
    """One recording for all troubles: starting and sealing one is the dear part."""
    spans: dict[str, tuple[int, int]] = {}
    port, lux = lab.camera(PureThermal(field.lepton, endpoint=BULK)), lab.meter(LightMeter(field), 0)

    @contextmanager
    def trouble(name: str, told: str, times: int = 1) -> Iterator[None]:
        begin = lab.mono_ns()
        with recording.telling(told, times):
            yield
        spans[name] = (begin, lab.mono_ns())

    with port, lux, lab.meter(Thermometer(field), 1):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID, THERMOMETER_BY_ID)
        recording = Recording(lab, field)
        recording.flows()
        for name in ("silent", "stall"):
            with trouble(name, BACK):
                with recording.telling(LOST):
                    setattr(port.faults, name, True)
                setattr(port.faults, name, False)
        with trouble("short", GAP, times=3):
            port.faults.short_every = 5
        port.faults.short_every = 0
        with trouble("garbled", "garbled"):
            lux.garbled = True
        lux.garbled = False
        with trouble("stuck", BACK):
            port.faults.stuck = True
        recording.until(port, 5)  # opened again and still stuck
        port.faults.stuck = False
        session = recording.stop()
    checked = recording.fieldkit("check", "--no-estimates", "--json", recording.session)
    assert checked.code == 0, checked
    recording.remove()
    return Troubled(session, checked.json["sessions"][0], spans)


def test_the_session_is_sealed_and_whole_in_spite_of_all(troubled):
    assert troubled.session["state"] == "sealed"
    assert troubled.checked["level"] == "warn"  # troubles are told, nothing is damaged


def test_a_camera_that_falls_silent_is_named_and_opened_again(troubled):
    assert any("silent" in text for text in troubled.events("silent", "LOST", "camera"))
    assert troubled.events("silent", "BACK", "camera")


def test_a_picture_that_stands_still_is_flagged_and_named(troubled):
    assert {"DUPLICATE", "FROZEN"} <= troubled.flags("stuck", "camera")
    assert any("frozen" in text for text in troubled.events("stuck", "LOST", "camera"))


def test_no_picture_comes_twice_unflagged_even_when_the_camera_was_opened_again(troubled):
    assert troubled.session["streams"]["camera"]["unflagged_duplicates"] == 0


def test_a_stalled_endpoint_is_a_lost_camera_that_comes_back(troubled):
    assert troubled.events("stall", "LOST", "camera")
    assert troubled.events("stall", "BACK", "camera")


def test_pictures_cut_short_are_gaps_in_the_kernels_numbers(troubled):
    assert "DROPPED_BEFORE" in troubled.flags("short", "camera")
    assert len(troubled.events("short", "GAP", "camera")) >= 3


def test_garbled_records_are_dropped_and_told(troubled, field):
    assert troubled.events("garbled", "GARBLED", "lux")
    truth = field.lux()
    assert all(abs(lux - truth) < 0.1 * truth for (lux,) in troubled.session["streams"]["lux"]["values"])


def test_twenty_replugs_are_survived_by_the_same_camera_under_changing_nodes(lab, field):
    port, decoy = (
        lab.camera(PureThermal(field.lepton, endpoint=BULK), 0),
        lab.camera(P2Pro(field.wide(192, 256)), 1),
    )
    with decoy, lab.meter(LightMeter(field), 0), lab.meter(Thermometer(field), 1):
        lab.wait_for("/dev/video0")  # the wrong camera is there first
        with port:
            lab.wait_for(CAMERA_BY_ID, LUX_BY_ID, THERMOMETER_BY_ID)
            nodes = {lab.nodes()[CAMERA_BY_ID]["to"]}
            recording = Recording(lab, field)
            recording.flows()
            for cycle in range(CYCLES):
                with recording.telling(LOST):
                    port.unplug()
                lab.wait_for(CAMERA_BY_ID, present=False)
                if cycle == CYCLES // 2:
                    decoy.unplug()  # frees the first node, which the camera will now get
                with recording.telling(BACK):
                    port.plug()
                    lab.wait_for(CAMERA_BY_ID)
                nodes.add(lab.nodes()[CAMERA_BY_ID]["to"])
            recording.flows()  # and not only opened
            session = recording.stop()
    assert len(nodes) > 1
    lost, back = (events(session, kind, "camera") for kind in ("LOST", "BACK"))
    # a slow computer may lose it between, and once more while the recording stops
    assert CYCLES <= len(back) <= len(lost) <= len(back) + 1
    assert all(re.search(r"back after [\d.]+ s", text) for text in back)
    assert session["streams"]["camera"]["info"]["identity"] == "1e4e:0100:8007000b-5113-3037-3231"
    assert session["state"] == "sealed"


def test_a_killed_recorder_leaves_everything_to_recover(lab, field):
    port = lab.camera(PureThermal(field.lepton, endpoint=BULK))
    with port, lab.meter(LightMeter(field), 0), lab.meter(Thermometer(field), 1):
        lab.wait_for(CAMERA_BY_ID, LUX_BY_ID, THERMOMETER_BY_ID)
        recording = Recording(lab, field)
        recording.flows()
        recording.until(port, 20)
        second = Recording(lab, field, {"lux": LUX}).job.wait()
        recording.job.signal(signal.SIGKILL)
        assert recording.job.wait().code == -signal.SIGKILL
    assert second.code == 4
    assert "fuser -v" in second.err
    recovered = recording.fieldkit("recover", "--json")
    assert recovered.code == 0, recovered
    (report,) = recovered.json["sessions"]
    session = recording.look(report["session"])
    assert session["state"] == "recovered"
    assert session["streams"]["camera"]["count"] >= 20
    assert session["streams"]["camera"]["unflagged_duplicates"] == 0
