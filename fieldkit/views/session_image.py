"""One image of a session for a slide: its first, noon and last frame, the slope map, and the slopes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate
from fieldkit.palettes import INFERNO, Colours
from fieldkit.views import formatting, frame_image, plotting, slope_map_image

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fieldkit.estimation.pixel_slopes import SlopeMap

SIZE_IN, DPI = (16.0, 9.0), 120
"""1920 x 1080 pixels: a slide."""
COLUMNS = ("region", "given", "tilt", "azimuth", "state")


@dataclass(frozen=True, slots=True)
class ShownFrame:
    """Values of a frame (rows, cols) in °C or counts, with the words above it."""

    words: str
    values: FloatArray
    unit: str


def session_image(
    title: str,
    subtitle: str,
    frames: Sequence[ShownFrame],
    regions: Sequence[Region],
    slopes: SlopeMap | None,
    estimates: Sequence[SlopeEstimate],
    palette: str = INFERNO,
) -> bytes:
    """A PNG file, its frames in a palette; without `slopes` the table has their place. Needs matplotlib."""
    from matplotlib.figure import Figure

    scale = frame_image.scale_of(np.stack([frame.values for frame in frames]), frames[0].unit)
    colours = f"colours from {scale.low:.0f} to {scale.text(scale.high)}"
    with plotting.figure_style():
        figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
        figure.suptitle(f"{title}\n{subtitle}   {colours}", fontsize=16)
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 1.2))[:, 0]
        for axes, frame in zip(above.subplots(1, len(frames), squeeze=False)[0], frames, strict=True):
            _image(axes, frame_image.colours(frame.values, scale, palette), regions, frame.words)
        left, right = below.subplots(1, 2)
        if slopes is not None:
            full_deg = slope_map_image.full_colour_deg(slopes.tilt_deg)
            words = f"slope: hue is azimuth, full colour {full_deg:.0f}° of tilt, grey: no slope"
            _image(left, slope_map_image.map_colours(slopes, full_deg), regions, words)
        else:
            left.set_axis_off()
        _table(right, regions, estimates)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _image(axes: Axes, colours: Colours, regions: Sequence[Region], words: str) -> None:
    from matplotlib.patheffects import withStroke

    axes.imshow(colours, interpolation="nearest")
    edge = [withStroke(linewidth=3.0, foreground="black")]  # white on black shows on any colour
    for region in regions:
        corners = np.array([*region.points_px, region.points_px[0]])
        axes.plot(*corners.T, color="white", linewidth=1.5, path_effects=edge)
        middle = corners[:-1].mean(axis=0)
        axes.text(
            middle[0], middle[1], region.name, color="white", ha="center", va="center", path_effects=edge
        )
    axes.set_title(words, fontsize=13)
    axes.set_axis_off()


def _table(axes: Axes, regions: Sequence[Region], estimates: Sequence[SlopeEstimate]) -> None:
    axes.set_axis_off()
    by_name = {region.name: region for region in regions}
    rows = [_row(estimate, by_name[estimate.region]) for estimate in estimates if estimate.region in by_name]
    if rows:
        table = axes.table(rows, colLabels=COLUMNS, loc="center", cellLoc="left", edges="horizontal")
        table.auto_set_font_size(False)
        table.set_fontsize(14)
        table.scale(1.0, 2.2)
        sure = formatting.confidence(estimates)
        axes.set_title(f"last minute; {formatting.region_words(sure)}", fontsize=13)


def _row(estimate: SlopeEstimate, region: Region) -> tuple[str, ...]:
    return (
        estimate.region,
        formatting.given_slope(region),
        formatting.tilt_degrees(estimate),
        formatting.azimuth(estimate),
        formatting.state(estimate),
    )
