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


def emissivity_figure(found: Emissivity, pairs: Pairs, band: Band) -> Figure:
    """The fit (surface against camera, °C) over the bars of the budget, the largest named."""
    from matplotlib.figure import Figure

    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 4.0 + 0.4 * len(found.budget)), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(8, len(found.budget)))
        _draw_line(above, found, pairs, band)
        _draw_budget(below, found)
    return figure


def _draw_line(axes: Axes, found: Emissivity, pairs: Pairs, band: Band) -> None:
    contact = np.linspace(pairs.contact_k.min() - 2.0, pairs.contact_k.max() + 2.0, 60)
    mirror = float(band.signal(found.reflected_k)) if np.isfinite(found.reflected_k) else 0.0
    seen = band.temperature(found.value * (band.signal(contact) - mirror) + mirror)
    axes.plot(contact - CELSIUS_ZERO_K, seen - CELSIUS_ZERO_K, color=COLOURS[0])
    axes.errorbar(
        pairs.contact_k - CELSIUS_ZERO_K, pairs.apparent_k - CELSIUS_ZERO_K,
        pairs.apparent_sd_k, pairs.contact_sd_k,
        "o", color=COLOURS[1], markersize=5,
    )  # fmt: skip
    axes.set_xlabel("surface [°C]")
    axes.set_ylabel("seen by the camera [°C]")
    axes.set_title(f"emissivity {found.value:.3f} ± {found.expanded:.3f} (k=2)")


def _draw_budget(axes: Axes, found: Emissivity) -> None:
    """Bars with their names above them, since long names beside them would leave no room."""
    for row, line in enumerate(found.budget):
        is_largest = line == found.largest
        axes.barh(row, abs(line.effect), 0.35, color=COLOURS[1 if is_largest else 0])
        axes.text(0.0, row - 0.25, f"{line.name}{', the largest' * is_largest}", va="bottom", fontsize=10)
    axes.set_ylim(len(found.budget) - 0.6, -0.95)  # the first on top
    axes.set_yticks([])
    axes.set_xlim(0.0, 1.05 * abs(found.largest.effect))
    axes.locator_params(axis="x", nbins=4)
    axes.set_axisbelow(True)
    axes.set_xlabel("effect on the emissivity")
