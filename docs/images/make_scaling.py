"""How costs grow with the size of the work, by `benchmarks.scaling`; the page states the exponents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from demo_day import DemoDay
from matplotlib.figure import Figure

from benchmarks.scaling import Growth, growths
from fieldkit.views.plotting import legend, line, marks, panels, svg

IMAGES = ("scaling.svg",)


def main(day: DemoDay) -> None:
    """Measure, draw, and print the exponents."""
    found = list(growths())
    for growth in found:
        print(f"{growth.row.id} {growth.exponent:.2f}")
    (day.images / IMAGES[0]).write_text(svg(diagram(found)), encoding="utf-8")


def diagram(found: Sequence[Growth]) -> Figure:
    """Size and cost over those of the smallest; along the grey line they grow alike."""
    figure, (axes,) = panels(1, 3.2)
    axes.plot([1, 8], [1, 8], color="0.6", linewidth=1.0)
    for number, growth in enumerate(found):
        sizes, seconds = np.array(growth.sizes), np.array(growth.seconds)
        label = f"{growth.row.id}, from {sizes[0]}"
        style = line(number, label) | marks(number, label)
        axes.loglog(sizes / sizes[0], seconds / seconds[0], **style)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    axes.set_xticks([1, 2, 4, 8])
    axes.set_yticks([1, 2, 4, 8])
    axes.set_xlabel("size over the smallest")
    axes.set_ylabel("processor time over the smallest")
    legend(axes)
    return figure
