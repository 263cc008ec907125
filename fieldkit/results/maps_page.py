"""Slope maps of several sessions on one page: beside each other, colours and pixels of one scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fieldkit.results.result_files import writing
from fieldkit.results.slope_map import MappedSession, map_png
from fieldkit.views import formatting, html
from fieldkit.views.slope_map_image import full_colour_deg

PIXELS_WIDE = 480
"""Of the map with the most camera pixels in a row."""


def write_maps_page(maps: Sequence[MappedSession], path: Path) -> Path:
    """Write maps, at least one, as one page that needs no second file.

    The tilt in full colour is that of the steepest map, and a camera pixel is as large on each. Raises
    `StorageError`.
    """
    full_deg = max(full_colour_deg(session_map.slopes.tilt_deg) for session_map in maps)
    widest = max(session_map.slopes.state.shape[1] for session_map in maps)
    factor = max(1, round(PIXELS_WIDE / widest))
    images = [
        (
            session_map.path.stem,
            html.data_uri(
                "image/png", map_png(session_map, factor * session_map.slopes.state.shape[1], full_deg)
            ),
        )
        for session_map in maps
    ]
    content = html.render(
        "maps.html", title="Slope maps", full_deg=full_deg, images=images, tilts=_tilts(maps)
    )
    with writing(path):
        path.write_text(content, encoding="utf-8")
    return path


def _tilts(maps: Sequence[MappedSession]) -> html.Table:
    """The median tilt and the quartiles of each region in each session."""
    by_session = [{region.region: region for region in session_map.by_region()} for session_map in maps]
    names = dict.fromkeys(name for regions in by_session for name in regions)
    rows = [
        (
            html.strong(name),
            *(
                formatting.plus_minus(region.tilt_deg, 0.5 * (region.tilt_high_deg - region.tilt_low_deg))
                if (region := regions.get(name))
                else formatting.UNKNOWN
                for regions in by_session
            ),
        )
        for name in names
    ]
    caption = "Median tilt of the pixels of each region in degrees, ± half the width between the quartiles."
    return html.Table(("region", *(session_map.path.stem for session_map in maps)), rows, caption)
