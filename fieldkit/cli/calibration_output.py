"""Output of the commands of ``fieldkit calibrate``: value, error budget, and where the record is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common

if TYPE_CHECKING:
    from fieldkit.calibrate.result import Calibration
    from fieldkit.calibration.uncertainty import Contribution

WIDEST_BAR = 24


def save_and_print(calibration: Calibration, used_by: str = "") -> None:
    """Save the record, print value and budget; `used_by` replaces the calibration's own advice."""
    from fieldkit.calibration.calibration_record import as_document

    path, record = calibration.save(), calibration.record
    if common.print_if_json({"record": str(path), **as_document(record)}):
        return
    click.echo(calibration.summary)
    if record.budget:
        print_budget(record.budget, record.unit)
    for note in record.remarks:
        click.echo(f"note: {note}")
    common.say(f"saved {path}     used by: {used_by or calibration.used_by}")


def print_budget(budget: Sequence[Contribution], unit: str) -> None:
    """The budget as a table with bars; the largest contribution is named below it."""
    from fieldkit.calibration.uncertainty import combined_uncertainty, largest

    worst = max(abs(line.effect) for line in budget) or 1.0
    rows: list[tuple[str, ...]] = [
        (
            line.name,
            f"{line.uncertainty:.3g} {'' if line.unit == '1' else line.unit}".strip(),
            line.kind,
            f"{abs(line.effect):.2g}",
            "█" * round(WIDEST_BAR * abs(line.effect) / worst),
        )
        for line in budget
    ]
    rows.append(("combined (k=1)", "", "", f"{combined_uncertainty(budget):.2g}", ""))
    effect = "effect" if unit == "1" else f"effect [{unit}]"
    common.print_table(("contribution", "uncertainty", "type", effect, ""), rows)
    click.echo(f"largest contribution: {largest(budget).name}")
