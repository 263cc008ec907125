"""Output of studies: texts, tables as CSV and figures as SVG in one folder."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from fieldkit.model.errors import StorageError

Rows = list[dict[str, Any]]


def write_files(folder: Path, texts: dict[str, str], made: dict[str, Rows], drawn: dict[str, str]) -> None:
    """Write texts by file name, tables as CSV and figures as SVG; raises `StorageError`."""
    texts = texts | {f"{name}.svg": svg for name, svg in drawn.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in made.items():
            if rows:
                _write_csv(folder / f"{name}.csv", rows)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise StorageError(
            f"cannot write into {folder}: {error.strerror}", fix="give another --out"
        ) from error


def _write_csv(path: Path, rows: Rows) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
