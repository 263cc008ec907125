"""Cameras through the real uvcvideo, read by fieldkit's two readers: every byte, every picture."""

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from fieldlab.field import Field
from losses import first_without_loss, nothing_lost, places_in, skipped
from usblab.lab import Lab
from usblab.models.ht301 import HT301
from usblab.models.p2pro import P2Pro
from usblab.models.purethermal import BULK, PureThermal
from usblab.port import UsbPort

SECONDS, FEWEST = 1.6, 12
FORMATS = {"purethermal": ("Y16 ", 160, 122), "p2pro": ("YUYV", 256, 384), "ht301": ("YUYV", 384, 292)}


@pytest.fixture(params=list(FORMATS))
def kind(request):
    return str(request.param)


def camera(kind: str, field: Field) -> Any:
    makers = {
        "purethermal": lambda: PureThermal(field.lepton),
        "p2pro": lambda: P2Pro(field.wide(192, 256)),
        "ht301": lambda: HT301(field.wide(288, 384)),
    }
    return makers[kind]()


def stream(
    lab: Lab, port: UsbPort, kind: str, backend: str, actions: Sequence[Sequence[Any]] = ()
) -> dict[str, Any]:
    fourcc, width, height = FORMATS[kind]
    report: dict[str, Any] = lab.guest.call(
        "inside_guest.cameras:stream",
        path="/dev/video0", backend=backend, fourcc=fourcc, width=width, height=height,
        pictures=max(FEWEST, round(SECONDS * port.camera.shape.rate_hz)), actions=actions,
    )  # fmt: skip
    return report


def rate_hz(report: dict[str, Any]) -> float:
    stamps = report["stamps_ns"]
    return float((len(stamps) - 1) / (stamps[-1] - stamps[0]) * 1e9)


@pytest.mark.parametrize("backend", ["v4l2", "opencv"])
def test_every_picture_arrives_unchanged_and_in_order(lab, field, kind, backend):
    def attempt() -> tuple[dict[str, Any], int]:
        lab.wait_for_empty_sockets()
        with port:
            lab.wait_for("/dev/video0")
            report = stream(lab, port, kind, backend)
        lost = skipped(places_in(port.count.sums, report["sums"]))
        if lost:
            port.camera.slow_down()  # a computer that is busy gets through with half as many
        return report, lost

    port = lab.camera(camera(kind, field))
    report = first_without_loss(attempt)
    assert all(later > earlier for earlier, later in pairwise(report["stamps_ns"]))
    assert min(report["ages_ns"]) > 0
    assert rate_hz(report) == pytest.approx(port.camera.shape.rate_hz, rel=0.6)  # a slow computer is no fault
    if backend == "v4l2":  # OpenCV does not tell
        assert report["sequences"] == list(range(len(report["sums"])))


def test_lepton_commands_are_obeyed_while_pictures_flow(lab, field):
    with lab.camera(PureThermal(field.lepton, endpoint=BULK)) as port:
        lab.wait_for("/dev/video0")
        report = stream(
            lab, port, "purethermal", "v4l2",
            [
                [5, "set_control", 6, 17, "01"],  # run a shutter correction
                [8, "get_control", 6, 20, 4],  # its state
                [10, "set_control", 6, 19, "01000000"],  # low gain
                [11, "get_control", 6, 19, 4],
                [12, "get_control", 6, 31, 4],  # no such selector
                [13, "set_control", 6, 19, "01"],  # wrong size
            ],
        )  # fmt: skip
        model, sent = port.camera, port.count.sums
    assert report["said"][:4] == ["None", "02000000", "None", "01000000"]
    assert all(said.startswith("DeviceError") for said in report["said"][4:])
    assert model.ffc_runs == 1
    nothing_lost(skipped(places_in(sent, report["sums"])))


def test_ht301_gives_temperatures_once_its_zoom_is_set(lab, field):
    with lab.camera(camera("ht301", field)) as port:
        lab.wait_for("/dev/video0")
        report = stream(lab, port, "ht301", "v4l2", [[5, "set_zoom", 0x8004], [20, "set_zoom", 0x8000]])
        commands = port.camera.commands
    assert report["said"] == ["None", "None"]
    assert commands == [0x8004, 0x8000]


def test_p2pro_answers_vendor_requests_beside_the_kernels_stream(lab, field):
    def attempt() -> tuple[dict[str, Any], int]:
        lab.wait_for_empty_sockets()
        with port:
            lab.wait_for("/dev/video0")
            report = lab.guest.call("inside_guest.vendor:ask_p2pro_while_streaming", path="/dev/video0")
        return report, skipped(report["sequences"])

    port = lab.camera(camera("p2pro", field))
    report = first_without_loss(attempt)
    assert report["date"] == b"20220808".hex()
    assert report["gain"] == "0000"
    assert port.camera.properties[5] == 0
    assert report["class_request"] == "EBUSY"  # extension units must go through the video node


IDENTITIES = {"purethermal": "1e4e:0100", "p2pro": "0bda:5830", "ht301": "1514:0001"}
OPTIONS = {"p2pro": {"gain": "low"}}


def test_the_driver_opens_it_by_identity_and_runs_its_shutter(lab, field, kind):
    with lab.camera(camera(kind, field)) as port:
        lab.wait_for("/dev/video0")
        mean_k = field.lepton(time.monotonic()).mean()
        report = lab.guest.call(
            "inside_guest.cameras:drive",
            driver=kind, identity=IDENTITIES[kind], options=OPTIONS.get(kind, {}),
            pictures=25, shutter_after=10,
        )  # fmt: skip
        model = port.camera
    assert (
        tuple(report["shape"]) == {"purethermal": (120, 160), "p2pro": (192, 256), "ht301": (288, 384)}[kind]
    )
    assert report["ran"] is True
    assert report["rejected"] == 0
    assert "SHUTTER" in report["flags"][-1]
    assert "SHUTTER" not in report["flags"][5]
    assert report["means_k"][0] == pytest.approx(mean_k, abs=0.1)
    if kind == "ht301":
        assert model.commands == [0x8020, 0x8004, 0x8000]  # range, temperatures, shutter
    elif kind == "p2pro":
        assert (model.properties[5], report["settings"]["gain"], model.calibrations) == (0, "low", 1)
    else:
        assert (model.ffc_runs, report["settings"]["gain"]) == (1, "high")
