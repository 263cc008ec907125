from dataclasses import replace

import cv2
import numpy as np
import pytest

from fieldkit.palettes import palette
from fieldkit.pixel_axes import BELOW_PX, LEFT_PX
from fieldkit.views import frame_image


def luminance(rgb):
    """Relative luminance of sRGB colours by IEC 61966-2-1."""
    linear = np.where(rgb <= 0.04045 * 255, rgb / 255 / 12.92, ((rgb / 255 + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


def test_counts_become_celsius_by_the_declared_scale(frame, streams):
    shown = frame_image.values(frame, streams[0])
    assert shown[24, 20] == pytest.approx(310.0 - 273.15, abs=1e-9)


@pytest.mark.parametrize("change", [{"law": "table"}, {"scale": float("nan")}, {"unit": "1"}])
def test_without_a_known_temperature_counts_are_shown_as_counts(frame, streams, change):
    info = replace(streams[0], **change)
    assert frame_image.unit(info) == "counts"
    assert np.array_equal(frame_image.values(frame, info), frame.counts)


def test_scale_is_in_whole_units_and_holds_the_picture(frame, streams):
    scale = frame_image.scale_of(frame_image.values(frame, streams[0]), "°C")
    assert (scale.low, scale.high) == (16, 47)  # 290 K = 16.85 °C, 320 K = 46.85 °C


def test_a_uniform_picture_still_has_a_scale():
    scale = frame_image.scale_of(np.full((3, 3), 20.0), "°C")
    assert scale.high > scale.low
    assert np.all(frame_image.colours(np.full((3, 3), 20.0), scale) == palette()[0])


def test_dead_and_hot_pixels_do_not_set_the_scale():
    shown = np.full((100, 100), 20.0)
    shown[0, 0], shown[0, 1] = -273.0, 400.0
    assert frame_image.scale_of(shown, "°C").high < 30


def test_palette_grows_brighter_at_every_step():
    steps = np.diff(luminance(palette().astype(np.float64)))
    assert np.all(steps > -1e-3)  # 8-bit rounding
    assert luminance(palette()[-1].astype(np.float64)) > 0.9


def test_outline_passes_through_the_corners_and_leaves_the_inside(regions):
    edge = frame_image.outline_mask(regions[2], (30, 40), 30, 40)
    assert all(edge[int(y), int(x)] for x, y in regions[2].points_px)
    assert not edge[9, 33]
    assert edge.sum() == 2 * (11 + 11) - 4  # the rim of an 11 by 11 box


def test_png_shows_each_bed_in_the_colour_of_its_temperature(frame, streams, regions):
    data = frame_image.png(frame, streams[0], regions, width=400)
    seen = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    # ten for one, the axes left and below, and the scale beside it
    assert seen.shape == (300 + BELOW_PX, LEFT_PX + 400 + 110, 3)
    scale = frame_image.scale_of(frame_image.values(frame, streams[0]), "°C")
    for kelvin, (x, y) in ((300.0, (4, 26)), (310.0, (18, 26)), (320.0, (31, 12))):
        expected = frame_image.colours(np.array([[kelvin - 273.15]]), scale)[0, 0]
        assert seen[y * 10 + 5, LEFT_PX + x * 10 + 5] == pytest.approx(expected, abs=1)


def test_bare_png_is_a_pixel_for_a_pixel(frame, streams):
    scale = frame_image.Scale(0.0, 50.0, "°C")
    data = frame_image.bare_png(frame, streams[0], scale)
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (30, 40, 3)
