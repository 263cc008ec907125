"""Draw the ranks of truths in what the learned estimator states of them, ``images/ranks.svg``; some hours.

    FIELDKIT_WORLDS=500 python docs/ranks.py

Worlds and ranks are those of `benchmarks.estimation_ranks`, whose rows are printed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom

from benchmarks.estimation_ranks import BINS, WORLDS, Ranks, ranks, rows
from fieldkit.views.plotting import WIDTH_IN, colour, figure_style, svg

FIGURE = Path(__file__).parent / "images" / "ranks.svg"
COLUMNS = 3
ENDS = (0.005, 0.995)
"""Of the band that holds a bar of uniform ranks."""


def histograms(found: Ranks) -> Figure:
    """A histogram of each quantity's ranks, over the band that 99 % of the bars of uniform ranks lie in."""
    lines = -(-len(found) // COLUMNS)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 0.5 + lines), layout="constrained")
        axes = figure.subplots(lines, COLUMNS, sharex=True, sharey=True, squeeze=False).flat
    for place, (name, values) in zip(axes, found.items(), strict=False):
        low, high = 100.0 * binom.ppf(ENDS, values.size, 1.0 / BINS) / values.size
        place.axhspan(low, high, color="0.85")
        counts, edges = np.histogram(values, BINS, (0.0, 1.0))
        place.stairs(100.0 * counts / values.size, edges, color=colour(0), fill=True, alpha=0.7)
        place.set_title(name.replace("_", " "), fontsize="medium")
    figure.axes[0].set_xlim(0.0, 1.0)
    for unused in figure.axes[len(found) :]:
        unused.remove()
    figure.supxlabel(f"rank of the truth in the posterior, {WORLDS} worlds", fontsize="medium")
    figure.supylabel("truths, %", fontsize="medium")
    return figure


def main() -> None:
    """Draw it, and print the rows."""
    found = ranks(WORLDS)
    for row in rows(found):
        print(f"{row.name}: {row.value:.2g}; {row.note}")
    FIGURE.write_text(svg(histograms(found)), encoding="utf-8")


if __name__ == "__main__":
    main()
