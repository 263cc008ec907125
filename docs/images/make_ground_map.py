"""The figure of a map on synthetic terrain, hillshade, true and found tilt, error: a minute.

It shows the session that `benchmarks.ground_map` records.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from demo_day import DemoDay
from matplotlib.colors import LightSource
from matplotlib.figure import Figure

from benchmarks.ground_map import GroundMap, dem, height_m, record_terrain, write_map

IMAGES = ("ground-map.png",)
WIDTH_PX = 800
SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG = 205.0, 25.0
"""Of the middle of the afternoon."""


def figure(found: GroundMap) -> Figure:
    """Four panels, north up."""
    light = LightSource(SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG)
    seen = np.isfinite(found.layers["slope"])
    shade = light.hillshade(height_m(found.east_m, found.north_m), dx=found.cell_m, dy=found.cell_m)
    panels = {
        "hillshade, afternoon": (shade, "gray", (0.0, 1.0)),
        "true tilt, °": (np.where(seen, found.tilt_deg, np.nan), "viridis", (0.0, 30.0)),
        "tilt found, °": (found.layers["slope"], "viridis", (0.0, 30.0)),
        "found less true, °": (found.layers["slope"] - found.tilt_deg, "RdBu_r", (-5.0, 5.0)),
    }
    drawn = Figure(figsize=(10.0, 8.4), layout="constrained")
    for axes, (title, (values, colours, (low, high))) in zip(
        drawn.subplots(2, 2).flat, panels.items(), strict=True
    ):
        side_m = found.cell_m * np.array(values.shape[::-1])
        image = axes.imshow(values, cmap=colours, vmin=low, vmax=high, extent=(0, side_m[0], 0, side_m[1]))
        axes.set_title(title)
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        if colours != "gray":
            drawn.colorbar(image, ax=axes, shrink=0.8)
    return drawn


def main(day: DemoDay) -> None:
    """Record, map, draw."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "terrain")
        record_terrain(folder, "3h", dem()).close()
        drawn = Path(parent, IMAGES[0])
        figure(GroundMap.read(write_map(folder), 0.0)).savefig(drawn, dpi=80)
        day.write_png(drawn, drawn.stem, WIDTH_PX)
