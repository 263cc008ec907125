import re

import cv2
import numpy as np
import pytest

from fieldkit.drivers.cameras.y16 import Y16
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Quality
from tests.harness.next_steps import at
from tests.shared_data import shared

COUNTS = np.random.default_rng(0).integers(6900, 7000, (240, 320)).astype("<u2")


def opened(source, **options):
    settings = DeviceSettings("ir", "y16", source=source, options={"width": 320, "height": 240, **options})
    return Y16().open(settings, HostClock())


@pytest.mark.parametrize(
    ("options", "unit", "quality"),
    [({}, "counts", Quality.NO_VALUE), ({"kelvin_per_count": 0.04, "kelvin_offset": 0.0}, "K", Quality.GOOD)],
)
def test_counts_are_temperatures_by_the_users_scale_alone(reel, options, unit, quality):
    camera = opened(reel(COUNTS.tobytes(), (COUNTS + 1).tobytes()), **options)
    assert (camera.info.unit, camera.info.scale == 0.04) == (unit, unit == "K")
    frame = camera.read(1.0)
    assert frame.quality == quality
    assert (frame.counts == COUNTS + 1).all()


def test_it_must_be_told_which_camera():
    with pytest.raises(ConfigError, check=at("ir")):
        Y16().open(DeviceSettings("ir", "y16"), HostClock())


def test_recorded_frame_of_unknown_scale_stays_counts():
    image = cv2.imread(str(shared("data/frames/flir_file/example_radiometric.tiff")), cv2.IMREAD_UNCHANGED)
    decoded = Y16().decode(image.astype("<u2").tobytes(), {"width": 640, "height": 512})
    low, mean, high = decoded.values
    assert (low.value, high.value, low.unit) == (6743, 7077, "counts")
    assert mean.value == pytest.approx(6983.25, abs=0.005)
    assert "no_value" in mean.flags


def test_bytes_of_no_usual_size_are_not_cut_into_one():
    data = bytes.fromhex("4b73") * (208 * 156)
    (part,) = Y16().decode(data, {}).rejected
    assert part.length == len(data)
    assert "-o width" in part.reason
    told = Y16().decode(data + b"\0", {"width": 208, "height": 156})
    assert (told.values[1].value, told.rest) == (29515.0, 1)
    assert [re.findall(r"\d+", note) for note in told.notes] == [["208", "156"], ["64896"]]
    with pytest.raises(ConfigError, match="width = 'wide'"):
        Y16().decode(data, {"width": "wide", "height": 156})
