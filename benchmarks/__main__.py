"""``python -m benchmarks [NAME ...]``: run all or some modules here and print what they measured."""

from __future__ import annotations

import importlib
import json
import pkgutil
import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.result import Result

HELPERS = {"__main__", "drawn_worlds", "mjpeg_page", "replayed", "result", "session_data", "sides"}


def modules() -> list[str]:
    """Names of the modules that measure something."""
    found = (module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)]))
    return sorted(name for name in found if name not in HELPERS)


def main(wanted: list[str]) -> None:
    """Run and print; ``--json`` prints one JSON document instead of tables."""
    as_json = "--json" in wanted
    names = [name for name in wanted if name != "--json"] or modules()
    if unknown := set(names) - set(modules()):
        sys.exit(f"no such benchmark: {', '.join(sorted(unknown))}\nthere are: {', '.join(modules())}")
    results: dict[str, list[Result]] = {}
    for name in names:
        results[name] = importlib.import_module(f"benchmarks.{name}").run()
        if not as_json:
            _print(name, results[name])
    if as_json:
        print(
            json.dumps(
                {name: [asdict(result) for result in rows] for name, rows in results.items()}, indent=2
            )
        )


def _print(name: str, rows: list[Result]) -> None:
    table = Table(title=name, title_justify="left")
    for column in ("what", "measured", "must", "note"):
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(row.name, f"{row.value:.4g} {row.unit}", row.must, row.note)
    Console().print(table)


if __name__ == "__main__":
    main(sys.argv[1:])
