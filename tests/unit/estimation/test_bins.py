"""Minute means of a region, against sums written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.bins import CameraStream, OpenBin
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame, Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.radiance import brightness_temperature_k

INFO = StreamInfo("ir", "brightness_temperature", "K", (4, 6), scale=0.01)
FLAT = Region("flat", RegionKind.REFERENCE, ((0, 0), (1, 0), (1, 1), (0, 1)))
BED = Region("bed", RegionKind.TARGET, ((3, 2), (5, 2), (5, 3), (3, 3)))


def frame(counts: np.ndarray, second: float, quality: Quality = Quality.GOOD) -> Frame:
    time_ns = 7 * MINUTE_NS + round(second * 1e9)
    rows = np.zeros((0, 6), np.uint16)
    return Frame("ir", time_ns, time_ns, counts.astype(np.uint16), rows, quality)


def surface_settings(emissivity: float, reflected_k: float) -> EstimatorSettings:
    surface = SurfaceParameters(emissivity=emissivity)
    return EstimatorSettings(surface=surface, reflected_temperature_k=reflected_k)


def minute_of(camera: CameraStream, *frames: Frame) -> OpenBin:
    minute = OpenBin(7, np.arange(2), [camera])
    for each in frames:
        minute.cameras["ir"].add_frame(each)
    return minute


def test_mean_and_spread_of_a_region_are_those_of_its_pixels_in_kelvin():
    random = np.random.default_rng(2)
    frame_counts = [29_800 + random.integers(0, 300, (4, 6)) for _ in range(3)]
    camera = CameraStream(INFO, {0: FLAT, 1: BED}, surface_settings(1.0, 233.15))
    minute = minute_of(camera, *(frame(counts, 10.0 * n) for n, counts in enumerate(frame_counts)))
    mean, spread = camera.means(minute.cameras["ir"].sums)
    for place, box in enumerate((np.s_[0:2, 0:2], np.s_[2:4, 3:6])):
        pixels = np.array([counts[box] for counts in frame_counts]) * 0.01
        assert mean[place] == pytest.approx(pixels.mean(), abs=1e-4)
        assert spread[place] == pytest.approx(pixels.std(), rel=1e-9)


def test_each_region_has_its_own_emissivity_or_the_surfaces():
    surface_k = 320.0
    own = replace(BED, emissivity=0.8)
    camera = CameraStream(INFO, {0: FLAT, 1: own}, surface_settings(0.95, 240.0))
    counts = np.zeros((4, 6))
    counts[:2, :2] = round(float(brightness_temperature_k(surface_k, 0.95, 240.0)) * 100)
    counts[2:, 3:] = round(float(brightness_temperature_k(surface_k, 0.80, 240.0)) * 100)
    mean, _ = camera.means(minute_of(camera, frame(counts, 0.0)).cameras["ir"].sums)
    assert mean == pytest.approx([surface_k, surface_k], abs=0.01)


def test_a_minute_stands_at_the_mean_of_its_pictures_or_in_its_middle():
    camera = CameraStream(INFO, {0: FLAT, 1: BED}, surface_settings(1.0, 233.15))
    flat_counts = np.full((4, 6), 30_000)
    minute = minute_of(camera, *(frame(flat_counts, second) for second in (10.0, 20.0, 45.0)))
    assert minute.time_ns == 7 * MINUTE_NS + 25 * 10**9
    assert minute_of(camera).time_ns == 7 * MINUTE_NS + 30 * 10**9
    under_the_shutter = minute_of(camera, frame(flat_counts, 10.0, Quality.SHUTTER))
    assert under_the_shutter.time_ns == 7 * MINUTE_NS + 30 * 10**9
    assert under_the_shutter.flags == Quality.SHUTTER


def test_pixels_that_cannot_be_are_left_out_of_the_mean_of_their_region():
    """A dead pixel of 0 counts, -273 degC, would move the mean of 4 pixels by 73 K."""
    camera = CameraStream(INFO, {0: FLAT, 1: BED}, surface_settings(1.0, 233.15))
    counts = np.full((4, 6), 29_315)
    counts[1, 1] = 0
    sums = minute_of(camera, frame(counts, 0.0)).cameras["ir"].sums
    kelvin, spread = camera.means(sums)
    assert kelvin == pytest.approx([293.15, 293.15])
    assert spread == pytest.approx([0.0, 0.0])
    assert camera.mean_pixels(sums).tolist() == [3, 6]
