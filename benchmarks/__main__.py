"""``python -m benchmarks [NAME ...]``: run all or some modules here and print what they measured."""

from __future__ import annotations

import importlib
import json
import math
import sys
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.result import Result, Sides, module_rows
from benchmarks.sides import BUSY_STEAL, Steal

LEAST_WIDTH = 150


def modules() -> list[str]:
    """Names of the modules that measure something: those with a function `run`."""
    files = Path(__file__).parent.glob("*.py")
    return sorted(file.stem for file in files if "\ndef run(" in file.read_text(encoding="utf-8"))


def main(words: list[str]) -> None:
    """Run and print; ``--json`` prints one JSON document instead of tables."""
    as_json = "--json" in words
    names = [word for word in words if word != "--json"] or modules()
    if unknown := set(names) - set(modules()):
        sys.exit(f"no such benchmark: {', '.join(sorted(unknown))}\nthere are: {', '.join(modules())}")
    results: dict[str, list[Result]] = {}
    for name in names:
        results[name] = _measure(name)
        if not as_json:
            _print(name, results[name])
    if as_json:
        document = {name: [asdict(result) for result in rows] for name, rows in results.items()}
        print(json.dumps(document, indent=2))


def _measure(name: str) -> list[Result]:
    """Results of a module, and the rows it declares and did not measure: something is not installed."""
    module, steal = importlib.import_module(f"benchmarks.{name}"), Steal()
    results: list[Result] = module.run()
    results = [replace(result, steal=steal.share()) if result.steal is None else result for result in results]
    ids = {result.id for result in results}
    missing = [row for row in module_rows(module) if row.id not in ids]
    return [*results, *(row.result(float("nan"), "not measured here") for row in missing)]


def _print(name: str, rows: list[Result]) -> None:
    table = Table(title=name, title_justify="left", show_lines=True)
    for column in ("what", "measured", "goal", "ours", "theirs", "steal", "includes, notes"):
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(row.name, _value(row), row.must, *_medians(row.sides), _steal(row), _words(row))
    Console(width=max(Console().width, LEAST_WIDTH)).print(table)


def _value(row: Result) -> str:
    if math.isnan(row.value):
        return "-"
    value = f"{row.value:.4g} {row.unit}"
    if row.sides is None:
        return value
    return f"{value}\n{row.sides.least:.3g} to {row.sides.largest:.3g} in {row.sides.rounds} rounds"


def _medians(sides: Sides | None) -> tuple[str, str]:
    if sides is None:
        return "", ""
    return _amount(sides.ours, sides.unit), _amount(sides.theirs, sides.unit)


def _amount(value: float, unit: str) -> str:
    if unit != "s" or value >= 1.0:
        return f"{value:.3g} {unit}"
    return f"{1e3 * value:.3g} ms" if value >= 1e-3 else f"{1e6 * value:.3g} µs"


def _steal(row: Result) -> str:
    steal = row.steal or 0.0
    return f"{100.0 * steal:.0f} %{': busy machine' if steal > BUSY_STEAL else ''}"


def _words(row: Result) -> str:
    return "; ".join(words for words in (row.included, row.note) if words)


if __name__ == "__main__":
    main(sys.argv[1:])
