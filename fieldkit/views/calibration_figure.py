"""The figure of an emissivity calibration: pairs with the fitted line, and the budget as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fieldkit.calibration.band import Band
from fieldkit.calibration.emissivity import Emissivity, Pairs
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.views.plotting import COLOURS, WIDTH_IN, figure_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def emissivity_figure(emissivity: Emissivity, pairs: Pairs, band: Band) -> Figure:
    """The fit (surface against camera, °C) over the bars of the budget, the largest named."""
    from matplotlib.figure import Figure

    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 4.0 + 0.4 * len(emissivity.budget)), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(8, len(emissivity.budget)))
        _draw_line(above, emissivity, pairs, band)
        _draw_budget(below, emissivity)
    return figure


def _draw_line(axes: Axes, emissivity: Emissivity, pairs: Pairs, band: Band) -> None:
    contact = np.linspace(pairs.contact_k.min() - 2.0, pairs.contact_k.max() + 2.0, 60)
    mirror = float(band.signal(emissivity.reflected_k)) if np.isfinite(emissivity.reflected_k) else 0.0
    apparent = band.temperature(emissivity.value * (band.signal(contact) - mirror) + mirror)
    axes.plot(contact - CELSIUS_ZERO_K, apparent - CELSIUS_ZERO_K, color=COLOURS[0])
    x, y = pairs.contact_k - CELSIUS_ZERO_K, pairs.apparent_k - CELSIUS_ZERO_K
    axes.errorbar(x, y, pairs.apparent_sd_k, pairs.contact_sd_k, "o", color=COLOURS[1], markersize=5)
    axes.set_xlabel("surface [°C]")
    axes.set_ylabel("seen by the camera [°C]")
    axes.set_title(f"emissivity {emissivity.value:.3f} ± {emissivity.expanded:.3f} (k=2)")


def _draw_budget(axes: Axes, emissivity: Emissivity) -> None:
    """Bars with their names above them, since long names beside them would leave no room."""
    for row, line in enumerate(emissivity.budget):
        is_largest = line == emissivity.largest
        axes.barh(row, abs(line.effect), 0.35, color=COLOURS[1 if is_largest else 0])
        axes.text(0.0, row - 0.25, f"{line.name}{', the largest' * is_largest}", va="bottom", fontsize=10)
    axes.set_ylim(len(emissivity.budget) - 0.6, -0.95)  # the first on top
    axes.set_yticks([])
    axes.set_xlim(0.0, 1.05 * abs(emissivity.largest.effect))
    axes.locator_params(axis="x", nbins=4)
    axes.set_axisbelow(True)
    axes.set_xlabel("effect on the emissivity")
