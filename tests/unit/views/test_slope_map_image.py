import colorsys
import re

import cv2
import numpy as np
import pytest

from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.pixel_axes import LEFT_PX
from fieldkit.views import slope_map_image
from fieldkit.views.slope_map_image import full_colour_deg, legend, map_colours, slope_colours

SHAPE = (30, 40)


def slope_map(tilt_deg=10.0, azimuth_deg=180.0, state=SlopeState.OK):
    tilt, azimuth = (np.full(SHAPE, angle, np.float32) for angle in (tilt_deg, azimuth_deg))
    nothing = np.full(SHAPE, np.nan, np.float32)
    return SlopeMap(tilt, azimuth, nothing, nothing, np.full(SHAPE, state, np.uint8))


def bounds(low_deg=8.0, high_deg=12.0):
    angles = (low_deg, high_deg, 170.0, 190.0)
    return PixelBounds(*(np.full(SHAPE, angle, np.float32) for angle in angles))


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), 1)


def hsv(colour):
    return colorsys.rgb_to_hsv(*(np.asarray(colour) / 255.0))


@pytest.mark.parametrize("azimuth", [0.0, 45.0, 90.0, 180.0, 270.0, 359.0])
def test_hue_is_azimuth_and_saturation_is_tilt(azimuth):
    colours = slope_colours([[10.0, 20.0, 30.0]], [[azimuth] * 3], 20.0)
    hues, saturations, _ = zip(*(hsv(colour) for colour in colours[0]), strict=True)
    assert np.array(hues[1:]) * 360.0 == pytest.approx([azimuth] * 2, abs=1.0)
    assert saturations == pytest.approx((0.5, 1.0, 1.0), abs=0.01)


def test_what_faces_the_north_west_is_brightest():
    values = [max(slope_colours([[25.0]], [[azimuth]], 30.0)[0, 0]) for azimuth in range(0, 360, 45)]
    assert int(np.argmax(values)) == 315 // 45
    assert int(np.argmin(values)) == 135 // 45


def test_flat_ground_has_no_colour():
    assert np.ptp(slope_colours([[0.0]], [[77.0]], 30.0)) == 0


def test_pixels_without_a_slope_are_grey_by_their_state():
    greys = set()
    for state in (SlopeState.TOO_FEW, SlopeState.NO_INTERSECTION, SlopeState.SHADED, SlopeState.NO_DATA):
        picture = map_colours(slope_map(np.nan, np.nan, state), 30.0)
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1
        assert np.ptp(picture[0, 0]) == 0
        greys.add(int(picture[0, 0, 0]))
    assert len(greys) == 4


def test_full_colour_is_a_round_tilt_and_never_less_than_ten():
    assert full_colour_deg(np.array([1.0, 2.0], np.float32)) == 10.0
    assert full_colour_deg(np.array([26.0, np.nan], np.float32)) == 30.0
    assert full_colour_deg(np.array([np.nan], np.float32)) == 10.0


def test_wheel_has_north_up_and_east_to_the_right():
    panel = legend(slope_map(), 30.0)
    x, y, near = slope_map_image.PANEL_WIDTH // 2, 190, 60
    for azimuth, dx, dy in ((0.0, 0, -near), (90.0, near, 0), (270.0, -near, 0)):
        expected = hsv(slope_colours([[30.0 * near / 100]], [[azimuth]], 30.0)[0, 0])
        assert hsv(panel[y + dy, x + dx]) == pytest.approx(expected, abs=0.02)


def test_two_slopes_are_hatched_over_their_colour(regions):
    sure, doubtful = (
        decoded(slope_map_image.png(slope_map(state=state), bounds(), regions))
        for state in (SlopeState.OK, SlopeState.NOT_RESOLVED)
    )
    assert sure.shape == doubtful.shape
    corner = slice(64 + 14, 64 + 110), slice(LEFT_PX + 14, LEFT_PX + 125)  # within a cell of the grid
    assert not (sure[corner] == 0).all(axis=-1).any()
    dark = (doubtful[corner] == 0).all(axis=-1)
    assert 0.05 < dark.mean() < 0.3
    assert (doubtful[corner][~dark] == sure[corner][~dark]).all()


def test_outlines_and_names_are_drawn(regions):
    plain, drawn = (decoded(slope_map_image.png(slope_map(), bounds(), given)) for given in ((), regions))
    changed = (plain != drawn).any(axis=-1)
    for region in regions:
        x, y = np.mean(region.points_px, axis=0) * 24 + 12
        assert changed[64 + round(y), LEFT_PX + round(x)]
    assert not changed[:64].any()


def test_picture_says_tilt_uncertainty_the_pixels_of_the_regions_are():
    corners = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
    region = Region("bed", RegionKind.TARGET, corners)
    inside, everywhere = bounds(), bounds(8.0, 28.0)
    everywhere.tilt_high_deg[region.mask(SHAPE)] = inside.tilt_high_deg[0, 0]
    within, around = (
        re.findall(
            r"\+-([\d.]+)", slope_map_image.tilt_uncertainty(slope_map().tilt_deg, everywhere, regions)
        )
        for regions in ((region,), ())
    )
    assert within == ["2.0", "2.0"]  # of half of the pixels, of nine in ten
    assert around[0] == "10.0"
    assert slope_map_image.tilt_uncertainty(slope_map().tilt_deg, bounds(np.nan, np.nan), ()) == ""


def test_uncertain_pixels_are_dotted_and_flat_ones_are_not():
    for state, dots in ((SlopeState.WIDE, True), (SlopeState.FLAT, False), (SlopeState.OK, False)):
        canvas = np.full((24, 24, 3), 90, np.uint8)
        slope_map_image.hatch(canvas, np.full((24, 24), state, np.uint8))
        assert (canvas == 255).any() == dots
