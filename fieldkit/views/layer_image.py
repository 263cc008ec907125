"""One product of a slope map as an image: colours with their scale, above its uncertainty.

States without a slope are grey and hatched as in the slope map.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fieldkit.palettes import Colours
from fieldkit.pixel_axes import with_axes
from fieldkit.views.frame_image import BLACK
from fieldkit.views.slope_map_image import (
    MASKS,
    MEANINGS,
    PANEL_HEIGHT,
    PANEL_WIDTH,
    enlarged,
    framed,
    hatch,
    state_row,
    text,
)

BAR = slice(50, 300), slice(20, 54)


def png(
    planes: Sequence[NDArray[np.float32]], state: NDArray[np.uint8], title: str, subtitle: str = "", *,
    units: str, is_cyclic: bool = False, width: int = 960,
) -> bytes:  # fmt: skip
    """A PNG file: the values, below them their standard uncertainty if it is given.

    `planes` are values, or values and uncertainties, (rows, cols) each, NaN without a slope; `state` is the
    `SlopeState` of every pixel, `units` those of the arrays, "1" of a ratio; `is_cyclic` are angles in
    degrees that begin anew after a turn.
    """
    import cv2

    values, *sd = planes
    first = _framed_plane(values, state, title, subtitle, units, is_cyclic, width)
    pages = [
        first,
        *(_framed_plane(one, state, "standard uncertainty", "", units, False, width) for one in sd),
    ]
    ok, data = cv2.imencode(".png", np.concatenate(pages)[:, :, ::-1])
    assert ok
    return data.tobytes()


def _framed_plane(
    values: NDArray[np.float32], state: NDArray[np.uint8], title: str, subtitle: str, units: str,
    is_cyclic: bool, width: int,
) -> Colours:  # fmt: skip
    low, high = (0.0, 360.0) if is_cyclic else _range(values)
    factor = max(1, round(width / state.shape[1]))
    rgb = _colours(values, low, high, is_cyclic)
    for one, grey in MASKS.items():
        rgb[(state == one) & np.isnan(values)] = grey
    canvas = enlarged(rgb, factor)
    hatch(canvas, enlarged(state, factor))
    panel = _legend(state, low, high, units, is_cyclic)
    return framed(with_axes(canvas, factor), panel, title, subtitle)


def _range(values: NDArray[np.float32]) -> tuple[float, float]:
    """Limits of the colours: 96 % of the values lie between them."""
    known = values[np.isfinite(values)]
    low, high = (float(one) for one in np.percentile(known, (2.0, 98.0))) if known.size else (0.0, 1.0)
    return (low, high) if high > low else (low, low + 1.0)


def _colours(values: NDArray[np.float32], low: float, high: float, is_cyclic: bool) -> Colours:
    import cv2

    shares = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0.0, 1.0)
    scale = cv2.COLORMAP_TWILIGHT if is_cyclic else cv2.COLORMAP_VIRIDIS
    rgb: Colours = cv2.applyColorMap(np.rint(shares * 255.0).astype(np.uint8), scale)[:, :, ::-1].copy()
    rgb[np.isnan(values)] = 255
    return rgb


def _legend(state: NDArray[np.uint8], low: float, high: float, units: str, is_cyclic: bool) -> Colours:
    """The scale of the colours, and the states in the map with their shares."""
    import cv2

    panel: Colours = np.full((PANEL_HEIGHT, PANEL_WIDTH, 3), 255, np.uint8)
    length = BAR[0].stop - BAR[0].start
    column = np.linspace(high, low, length, dtype=np.float32)[:, np.newaxis]
    panel[BAR] = _colours(column, low, high, is_cyclic)
    cv2.rectangle(panel, (BAR[1].start, BAR[0].start), (BAR[1].stop, BAR[0].stop), BLACK, 1)
    text(panel, "" if units == "1" else units, 20, 34, 0.5)
    for share in np.linspace(0.0, 1.0, 5):
        at = round(BAR[0].stop - share * length)
        text(panel, f"{low + share * (high - low):.3g}", BAR[1].stop + 10, at + 5, 0.45)
    present = [one for one in MEANINGS if (state == one).any()]
    for row, one in enumerate(present):
        state_row(panel, one, float((state == one).mean()), BAR[0].stop + 30 + 32 * row)
    return panel
