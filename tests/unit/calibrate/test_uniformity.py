"""Two views of a board belong to one camera."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from fieldkit.calibrate.uniformity import _one_camera
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError

CAMERA = StreamInfo(
    "camera", "brightness_temperature", "K", (120, 160),
    model="Lepton 3.5", serial_number="12", settings={"gain": "high"},
)  # fmt: skip


def session(name: str, camera: StreamInfo) -> SimpleNamespace:
    return SimpleNamespace(path=Path(name), streams={"camera": camera})


def test_the_camera_of_both_views_is_that_of_the_record():
    found = _one_camera([session("a.h5", CAMERA), session("b.h5", CAMERA)])
    assert (found.model, found.serial_number, found.range) == ("Lepton 3.5", "12", "high")


@pytest.mark.parametrize("other", [{"serial_number": "13"}, {"settings": {"gain": "low"}}])
def test_views_of_two_cameras_or_ranges_are_not_averaged(other):
    with pytest.raises(ConfigError, match=r"a\.h5 is of the camera Lepton 3\.5 12 high"):
        _one_camera([session("a.h5", CAMERA), session("b.h5", replace(CAMERA, **other))])
