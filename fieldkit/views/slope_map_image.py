"""A slope map as an image, or one of its products above its uncertainty.

Of the map hue is azimuth, saturation is tilt, brightness is relief shading; beside it the colour wheel with
north up, and what the hatchings mean. Drawn with OpenCV, whose own letters are ASCII only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap
from fieldkit.model.arrays import ByteArray, SingleArray
from fieldkit.model.confidence import percent
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeState, half_width_deg
from fieldkit.palettes import Colours
from fieldkit.physics.facet import normal
from fieldkit.pixel_axes import BLACK, WHITE, letters, with_axes
from fieldkit.views.frame_image import enlargement, mark_region, png_file

WIDTH = 960
PANEL_WIDTH, PANEL_HEIGHT = 340, 640
WHEEL_RADIUS = 100
LIGHT_TILT_DEG, LIGHT_AZIMUTH_DEG = 45.0, 315.0
"""Direction from which reliefs are lit by convention, so that hills do not look like hollows."""
MEANINGS = {
    SlopeState.OK: "slope known",
    SlopeState.FLAT: "flat, faces nowhere",
    SlopeState.WIDE: "wide, or no region",
    SlopeState.TOO_FEW: "too few minutes",
    SlopeState.NOT_RESOLVED: "two slopes fit, flatter shown",
    SlopeState.NO_INTERSECTION: "no slope explains it",
    SlopeState.SHADED: "in its own shade",
    SlopeState.NO_DATA: "no data",
}
MASKS = {
    SlopeState.TOO_FEW: (200, 200, 200),
    SlopeState.NO_INTERSECTION: (120, 120, 120),
    SlopeState.SHADED: (40, 40, 40),
    SlopeState.NO_DATA: WHITE,
}
"""Grey levels of pixels without a slope; colours are reserved for slopes."""


def png(
    slopes: SlopeMap, bounds: PixelBounds, regions: Sequence[Region] = (), title: str = "",
    subtitle: str = "", *, width: int = WIDTH, full_deg: float = 0.0,
) -> bytes:  # fmt: skip
    """A PNG file: the map enlarged close to `width`, axes in camera pixels, outlines, names, legend.

    `full_deg` is the tilt in full colour, by default that of the map.
    """
    full_deg = full_deg or full_colour_deg(slopes.tilt_deg)
    under = "   ".join(filter(None, (subtitle, tilt_uncertainty(slopes.tilt_deg, bounds, regions))))
    rgb, panel = map_colours(slopes, full_deg), legend(slopes, full_deg)
    return png_file(_page(rgb, slopes.state, panel, title, under, width, regions))


def _page(
    rgb: Colours, state: ByteArray, panel: Colours, title: str, subtitle: str,
    width: int = WIDTH, regions: Sequence[Region] = (),
) -> Colours:  # fmt: skip
    """Colours of pixels enlarged close to `width`, hatched by state, with regions and axes, and a legend."""
    factor = enlargement(state.shape, width)
    canvas = enlarge(rgb, factor)
    hatch(canvas, enlarge(state, factor))
    for region in regions:
        mark_region(canvas, region, state.shape, 0.7)
    return add_frame(with_axes(canvas, factor), panel, title, subtitle)


def tilt_uncertainty(tilt_deg: SingleArray, bounds: PixelBounds, regions: Sequence[Region]) -> str:
    """Half the width of a pixel's likelihood region of the tilt: of half and of nine tenths of the pixels.

    Of those in the regions, where there are any; empty without a slope.
    """
    rows, cols = tilt_deg.shape
    inside = np.full((rows, cols), not regions)
    for region in regions:
        inside |= region.mask((rows, cols))
    half = half_width_deg(tilt_deg, bounds.tilt_low_deg, bounds.tilt_high_deg)[inside]
    if not np.isfinite(half).any():
        return ""
    half_deg, most_deg = np.nanpercentile(half, (50, 90))
    most = f"+-{most_deg:.1f} for 9 in 10"
    of_tilt = f"{percent(bounds.confidence)} region of the tilt"
    return f"{of_tilt}: +-{half_deg:.1f} deg for half of the pixels, {most}"


def full_colour_deg(tilt_deg: SingleArray) -> float:
    """Tilt shown in full colour: 98 % of the pixels are flatter; a multiple of 5 degrees, at least 10."""
    finite = tilt_deg[np.isfinite(tilt_deg)]
    highest = float(np.percentile(finite, 98.0)) if finite.size else 0.0
    return max(10.0, 5.0 * math.ceil(highest / 5.0))


def slope_colours(tilt_deg: ArrayLike, azimuth_deg: ArrayLike, full_deg: float) -> Colours:
    """Red-green-blue of slopes of shape (rows, cols): shape (rows, cols, 3); black where they are NaN."""
    import cv2

    tilt, azimuth = np.broadcast_arrays(np.asarray(tilt_deg, float), np.asarray(azimuth_deg, float))
    lit = np.clip(normal(tilt, azimuth) @ normal(LIGHT_TILT_DEG, LIGHT_AZIMUTH_DEG), 0.0, 1.0)
    hsv = np.stack([azimuth % 360.0, np.clip(tilt / full_deg, 0.0, 1.0), 0.35 + 0.65 * lit], axis=-1)
    rgb = cv2.cvtColor(np.nan_to_num(hsv).astype(np.float32), cv2.COLOR_HSV2RGB)
    rgb[np.isnan(hsv).any(axis=-1)] = 0.0
    colours: Colours = np.rint(rgb * 255.0).astype(np.uint8)
    return colours


def map_colours(slopes: SlopeMap, full_deg: float) -> Colours:
    """The map at its own resolution: slopes in colour, other states in grey."""
    rgb = slope_colours(slopes.tilt_deg, slopes.azimuth_deg, full_deg)
    for state, grey in MASKS.items():
        rgb[slopes.state == state] = grey
    return rgb


def legend(slopes: SlopeMap, full_deg: float) -> Colours:
    """The colour wheel, north up, and the states in the map with their shares, on white."""
    panel: Colours = np.full((PANEL_HEIGHT, PANEL_WIDTH, 3), 255, np.uint8)
    letters(panel, "colour: which way it faces", 20, 24)
    letters(panel, "strength: how steep", 20, 46)
    _wheel(panel, PANEL_WIDTH // 2, 190, full_deg)
    letters(panel, "north is up on this wheel,", 20, 340, 0.5)
    letters(panel, "not in the camera's image", 20, 360, 0.5)
    letters(panel, "shading: light from the north-west,", 20, 388, 0.5)
    letters(panel, f"{90 - LIGHT_TILT_DEG:.0f} deg high", 20, 408, 0.5)
    _state_rows(panel, slopes.state, 440)
    return panel


def _wheel(panel: Colours, x: int, y: int, full_deg: float) -> None:
    import cv2

    down, right = np.mgrid[-WHEEL_RADIUS : WHEEL_RADIUS + 1, -WHEEL_RADIUS : WHEEL_RADIUS + 1]
    away = np.hypot(down, right)
    disc = slope_colours(away / WHEEL_RADIUS * full_deg, np.degrees(np.arctan2(right, -down)), full_deg)
    square = panel[y - WHEEL_RADIUS : y + WHEEL_RADIUS + 1, x - WHEEL_RADIUS : x + WHEEL_RADIUS + 1]
    square[away <= WHEEL_RADIUS] = disc[away <= WHEEL_RADIUS]
    for part in (0.5, 1.0):
        cv2.circle(panel, (x, y), round(part * WHEEL_RADIUS), BLACK, 1, cv2.LINE_AA)
        letters(panel, f"{part * full_deg:g}", x + 4, y + round(part * WHEEL_RADIUS) - 6, 0.45)
    letters(panel, "0", x - 5, y + 5, 0.45)
    letters(panel, "N", x - 7, y - WHEEL_RADIUS - 10, 0.65)
    letters(panel, "S", x - 6, y + WHEEL_RADIUS + 24, 0.65)
    letters(panel, "E", x + WHEEL_RADIUS + 12, y + 7, 0.65)
    letters(panel, "W", x - WHEEL_RADIUS - 30, y + 7, 0.65)
    letters(panel, "tilt in degrees", x + 30, y + WHEEL_RADIUS + 26, 0.45)


def _state_rows(panel: Colours, state: ByteArray, y: int) -> None:
    """The states of a map from `y` on, each in a line."""
    present = [meaning for meaning in MEANINGS if (state == meaning).any()]
    for row, state_value in enumerate(present):
        _state_row(panel, state_value, float((state == state_value).mean()), y + 32 * row)


def _state_row(panel: Colours, state: SlopeState, share: float, y: int) -> None:
    """A state, what it means and its share of the pixels, as a line of a legend."""
    import cv2

    swatch = panel[y : y + 22, 20:54]
    swatch[:] = MASKS.get(state, (120, 200, 160))
    hatch(swatch, np.full(swatch.shape[:2], state, np.uint8))
    cv2.rectangle(panel, (20, y), (53, y + 21), BLACK, 1)
    percent = f"{share:.0%}" if share >= 0.01 else "<1%"
    letters(panel, f"{MEANINGS[state]}: {percent}", 62, y + 16, 0.45)


def hatch(canvas: Colours, state: ByteArray) -> None:
    """Strokes at one slant for two slopes that fit, at the other for none, dots for a wide one."""
    rows, cols = np.ogrid[: state.shape[0], : state.shape[1]]
    canvas[(state == SlopeState.WIDE) & (rows % 6 == 0) & (cols % 6 == 0)] = WHITE
    canvas[(state == SlopeState.NOT_RESOLVED) & ((rows + cols) % 8 == 0)] = BLACK
    canvas[(state == SlopeState.NO_INTERSECTION) & ((rows - cols) % 8 < 2)] = (175, 175, 175)


def enlarge(image: ByteArray, factor: int) -> ByteArray:
    """Each pixel as a square of `factor` pixels."""
    return np.ascontiguousarray(image.repeat(factor, axis=0).repeat(factor, axis=1))


def add_frame(canvas: Colours, panel: Colours, title: str, subtitle: str) -> Colours:
    """Map and legend side by side under a title, on white."""
    head = 64
    height = head + max(canvas.shape[0], panel.shape[0])
    page: Colours = np.full((height, canvas.shape[1] + panel.shape[1], 3), 255, np.uint8)
    page[head : head + canvas.shape[0], : canvas.shape[1]] = canvas
    page[head : head + panel.shape[0], canvas.shape[1] :] = panel
    letters(page, title, 10, 28, 0.75)
    letters(page, subtitle, 10, 52, 0.5)
    return page


# --- one product: colours with their scale; states without a slope as in the map

BAR = slice(50, 300), slice(20, 54)


def layer_png(
    planes: Sequence[SingleArray], state: ByteArray, title: str, subtitle: str = "", *,
    units: str, is_cyclic: bool = False,
) -> bytes:  # fmt: skip
    """A PNG file: the values, below them their standard uncertainty if it is given.

    `planes` are values, or values and uncertainties, (rows, cols) each, NaN without a slope; `state` is the
    `SlopeState` of every pixel, `units` those of the arrays, "1" of a ratio; `is_cyclic` are angles in
    degrees that begin anew after a turn.
    """
    values, *sd = planes
    pages = [
        _framed_plane(values, state, title, subtitle, units, is_cyclic),
        *(_framed_plane(plane, state, "standard uncertainty", "", units, False) for plane in sd),
    ]
    return png_file(np.concatenate(pages))


def _framed_plane(
    values: SingleArray, state: ByteArray, title: str, subtitle: str, units: str, is_cyclic: bool
) -> Colours:
    low, high = (0.0, 360.0) if is_cyclic else _range(values)
    rgb = _colours(values, low, high, is_cyclic)
    for mask, grey in MASKS.items():
        rgb[(state == mask) & np.isnan(values)] = grey
    return _page(rgb, state, _legend(state, low, high, units, is_cyclic), title, subtitle)


def _range(values: SingleArray) -> tuple[float, float]:
    """Limits of the colours: 96 % of the values lie between them."""
    finite = values[np.isfinite(values)]
    low, high = (float(limit) for limit in np.percentile(finite, (2.0, 98.0))) if finite.size else (0.0, 1.0)
    return (low, high) if high > low else (low, low + 1.0)


def _colours(values: SingleArray, low: float, high: float, is_cyclic: bool) -> Colours:
    import cv2

    shares = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0.0, 1.0)
    scale = cv2.COLORMAP_TWILIGHT if is_cyclic else cv2.COLORMAP_VIRIDIS
    rgb: Colours = cv2.applyColorMap(np.rint(shares * 255.0).astype(np.uint8), scale)[:, :, ::-1].copy()
    rgb[np.isnan(values)] = 255
    return rgb


def _legend(state: ByteArray, low: float, high: float, units: str, is_cyclic: bool) -> Colours:
    """The scale of the colours, and the states in the map with their shares."""
    import cv2

    panel: Colours = np.full((PANEL_HEIGHT, PANEL_WIDTH, 3), 255, np.uint8)
    length = BAR[0].stop - BAR[0].start
    column = np.linspace(high, low, length, dtype=np.float32)[:, np.newaxis]
    panel[BAR] = _colours(column, low, high, is_cyclic)
    cv2.rectangle(panel, (BAR[1].start, BAR[0].start), (BAR[1].stop, BAR[0].stop), BLACK, 1)
    letters(panel, "" if units == "1" else units, 20, 34, 0.5)
    for share in np.linspace(0.0, 1.0, 5):
        at = round(BAR[0].stop - share * length)
        letters(panel, f"{low + share * (high - low):.3g}", BAR[1].stop + 10, at + 5, 0.45)
    _state_rows(panel, state, BAR[0].stop + 30)
    return panel
