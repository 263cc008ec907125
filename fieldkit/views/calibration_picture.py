"""The picture of a calibration: the pairs on their line, and the budget as bars."""

from __future__ import annotations

import numpy as np

from fieldkit.calibration.band import Band
from fieldkit.calibration.emissivity import Emissivity, Pairs
from fieldkit.views.report.canvas import COLOURS, WIDTH_IN, svg


def emissivity_svg(found: Emissivity, pairs: Pairs, band: Band) -> str:
    """SVG of the fit (surface against camera, °C) over the bars of the budget, the largest named."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    contact = np.linspace(pairs.contact_k.min() - 2.0, pairs.contact_k.max() + 2.0, 60)
    mirror = float(band.signal(found.reflected_k)) if np.isfinite(found.reflected_k) else 0.0
    seen = band.temperature(found.value * (band.signal(contact) - mirror) + mirror)
    above.plot(contact - 273.15, seen - 273.15, color=COLOURS[0])
    above.errorbar(
        pairs.contact_k - 273.15, pairs.apparent_k - 273.15, pairs.apparent_sd_k, pairs.contact_sd_k,
        "o", color=COLOURS[1], markersize=5,
    )  # fmt: skip
    above.set_xlabel("surface [°C]")
    above.set_ylabel("seen by the camera [°C]")
    above.set_title(f"emissivity {found.value:.3f} ± {found.expanded:.3f} (k=2)")
    effects = [abs(line.effect) for line in found.budget]
    colours = [COLOURS[1] if line == found.largest else COLOURS[0] for line in found.budget]
    below.barh([line.name for line in found.budget], effects, color=colours)
    below.invert_yaxis()
    below.set_xlabel(f"effect on the emissivity; largest: {found.largest.name}", fontsize=10)
    return svg(figure)
