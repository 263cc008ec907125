"""Write the table and the reliability diagram of ``explanation/trust.md`` from drawn worlds.

    FIELDKIT_WORLDS=40 python docs/accuracy.py

Worlds are those of `benchmarks.estimation_learned`. For the diagram a region for another probability than
90 % is taken to be the 90 % region made wider or narrower as a normal distribution would be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtri

from benchmarks.estimation_learned import (
    WORLDS,
    Cell,
    Outcome,
    Scenario,
    coverage_percent,
    estimates,
    mean_error_deg,
    outcomes,
    scenarios,
)
from fieldkit.model.arrays import FloatArray
from fieldkit.model.confidence import CONFIDENCE, interval_sds
from fieldkit.views.plotting import legend, line, panels, svg

DOCS = Path(__file__).parent
PAGE, FIGURE = DOCS / "explanation" / "trust.md", DOCS / "images" / "reliability.svg"
BEGIN, END = "<!-- accuracy -->\n", "<!-- end -->"
MINUTES = (20, 60, 180)
IN_FIGURE = ("clear, south, known", "broken, south, known", "clear, random beds, free")
IN_TABLE = (
    *IN_FIGURE,
    "clear, south, known, no air temperature",
    "clear, south, known, one known bed, offsets 0.1 K",
    "broken, random beds, free",
    "the world as configured",
)
PROBABILITIES: FloatArray = np.linspace(0.1, 0.98, 23)
Found = dict[str, tuple[Scenario, list[Outcome]]]


def table(found: Found) -> str:
    """A row for each kind of session: errors, coverage and goals after `MINUTES`, and the other models."""
    rows = [
        "| session | `learned` | in 90 % regions | goal | `full` | `paper` |",
        "|---|---|---|---|---|---|",
        *(_row(*found[name]) for name in IN_TABLE if name in found),
    ]
    minutes = " / ".join(map(str, MINUTES))
    text = f"Mean errors of tilt in degrees after {minutes} minutes; {WORLDS} worlds a row, three beds each."
    return "\n".join([text, "", *rows])


def _row(scenario: Scenario, worlds: Sequence[Outcome]) -> str:
    cells = {cell.minutes: cell for cell in scenario.cells}
    asked = [cells.get(minutes, Cell(minutes)) for minutes in MINUTES]
    learned, full, paper = (
        _joined((mean_error_deg(estimates(worlds, model, cell)) for cell in asked), ".2f")
        for model in ("learned", "full", "paper")
    )
    inside = _joined((coverage_percent(estimates(worlds, "learned", cell)) for cell in asked), ".0f")
    goals = _joined((cell.must_deg for cell in asked), "g")
    return f"| {scenario.name} | {learned} | {inside} % | {goals} | {full} | {paper} |"


def _joined(values: Iterable[float], form: str) -> str:
    return " / ".join("–" if math.isnan(value) else f"{value:{form}}" for value in values)


def diagram(found: Found) -> Figure:
    """On the diagonal regions are right, above it they are wider than they need be."""
    figure, (axes,) = panels(1, 3.6)
    axes.plot([0, 100], [0, 100], color="0.6", linewidth=1.0)
    limits = ndtri(0.5 * (1.0 + PROBABILITIES)) / interval_sds(CONFIDENCE)
    for number, name in enumerate(IN_FIGURE):
        if name not in found:
            continue
        scenario, worlds = found[name]
        errors = [
            estimate.scaled_error
            for cell in scenario.cells
            for estimate in estimates(worlds, "learned", cell)
        ]
        shares = np.mean(np.array(errors)[:, np.newaxis] <= limits, axis=0)
        axes.plot(100.0 * PROBABILITIES, 100.0 * shares, **line(number, name))
    axes.set(xlabel="stated probability of the region, %", ylabel="regions that hold the tilt, %")
    legend(axes)
    return figure


def main() -> None:
    """Write both."""
    asked = [scenario for scenario in scenarios() if scenario.name in IN_TABLE]
    found = {scenario.name: (scenario, worlds) for scenario, worlds in outcomes(asked)}
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(found)}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    FIGURE.write_text(svg(diagram(found)), encoding="utf-8")


if __name__ == "__main__":
    main()
