"""Write the rows of ``explanation/trust.md`` from worlds of `benchmarks.estimation_table`.

FIELDKIT_WORLDS=48 python docs/rows.py
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.estimation_learned import Cell, Outcome, Scenario, outcomes
from benchmarks.estimation_table import row_of, scenarios

PAGE = Path(__file__).parent / "explanation" / "trust.md"
BEGIN, END = "<!-- rows -->\n", "<!-- end of rows -->"


def table(worlds_of: Iterable[tuple[Scenario, Sequence[Outcome]]]) -> str:
    """A row for each kind of session and number of minutes."""
    lines = [
        "| session; what differs | min | worlds | error | goal | held (95 %) | half-width | goal "
        "| over calibrated | ok, held; before | beds |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *(_line(scenario, cell, worlds) for scenario, worlds in worlds_of for cell in scenario.cells),
    ]
    return "\n".join(lines)


def _line(scenario: Scenario, cell: Cell, worlds: Sequence[Outcome]) -> str:
    row, (name, sizes) = row_of(scenario, cell, worlds), (scenario.name, scenario.sizes)
    low, high = row.held_within
    ok = f"{row.ok}, {_text(row.ok_held_percent, '.0f', ' %')}; {row.ok_before}"
    cells = [
        f"{name}; {sizes}" if sizes else name,
        row.minutes,
        row.worlds,
        f"{row.error_deg:.2f}°",
        _text(cell.must_deg, "g", "°"),
        "refused" if math.isnan(row.held_percent) else f"{row.held_percent:.0f} % ({low:.0f}–{high:.0f})",
        f"{row.half_deg:.1f}°",
        _text(cell.half_deg, "g", "°"),
        f"{row.over_calibrated:.2f}",
        ok,
        row.beds,
    ]
    return f"| {' | '.join(map(str, cells))} |"


def _text(value: float, form: str, unit: str) -> str:
    return "–" if math.isnan(value) else f"{value:{form}}{unit}"


def main() -> None:
    """Write the table into its page."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    rows = table(outcomes(list(scenarios())))
    PAGE.write_text(f"{before}{BEGIN}\n{rows}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
