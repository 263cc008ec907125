"""How often pixels are steeper than a limit, by the stated probability."""

from __future__ import annotations

import numpy as np
from demo_day import DemoDay
from matplotlib.figure import Figure

from fieldkit.model.arrays import FloatArray
from fieldkit.views.plotting import colour, panels, svg
from tests.harness.pixels import drawn, simulated

IMAGES = ("risk-reliability.svg",)
PIXELS, LIMIT_DEG = 327_680, 20.0
EDGES: FloatArray = np.linspace(0.0, 1.0, 11)


def main(day: DemoDay) -> None:
    """Draw it, and print the shares."""
    tilt, azimuth = drawn(PIXELS)
    probability = simulated(tilt, azimuth)[1].risk(LIMIT_DEG)[0]
    known = np.isfinite(probability)
    which = np.clip(np.digitize(probability[known], EDGES) - 1, 0, 9)
    steeper = tilt[known] > LIMIT_DEG
    stated, found = (
        np.array([values[which == number].mean() for number in range(10)])
        for values in (probability[known], steeper)
    )
    print("steeper", " ".join(f"{100.0 * share:.1f}" for share in found))
    (day.images / IMAGES[0]).write_text(svg(diagram(stated, found)), encoding="utf-8")


def diagram(stated: FloatArray, found: FloatArray) -> Figure:
    """On the diagonal probabilities are right."""
    figure, (axes,) = panels(1, 3.2)
    axes.plot([0, 100], [0, 100], color="0.6", linewidth=1.0)
    axes.plot(100.0 * stated, 100.0 * found, "o-", color=colour(0), markersize=5)
    axes.set_xlabel(f"stated probability of a tilt over {LIMIT_DEG:.0f}°, %")
    axes.set_ylabel("pixels that are steeper, %")
    return figure
