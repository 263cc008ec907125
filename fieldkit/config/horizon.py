"""A horizon's file: ``horizon = "ridge.csv"`` becomes its pairs, so that a session holds them itself."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fieldkit.config.files import read_text
from fieldkit.config.references import campaign_folder
from fieldkit.config.toml_lines import KeyPath, regions_in
from fieldkit.config.validation import Mistake
from fieldkit.model.errors import ConfigError

COLUMNS = ["azimuth_deg", "elevation_deg"]


def load_horizon(path: Path) -> list[list[float]]:
    """The pairs (azimuth, elevation) of a CSV file, in degrees. Raises `ConfigError`."""
    rows = [row for row in csv.reader(read_text(path).splitlines()) if row]
    if not rows or [name.strip() for name in rows[0]] != COLUMNS:
        raise ConfigError(f"the first line must be {','.join(COLUMNS)}", place=path)
    pairs = [_pair(path, number, row) for number, row in enumerate(rows[1:], 2)]
    azimuths = [azimuth % 360.0 for azimuth, _ in pairs]
    if not pairs or len(set(azimuths)) < len(azimuths):
        raise ConfigError(f"{path}: needs at least one row, and every azimuth once (0 and 360 are the same)")
    return pairs


def _pair(path: Path, number: int, row: list[str]) -> list[float]:
    try:
        azimuth, elevation = map(float, row)
    except ValueError:
        raise ConfigError(f"row {number}: write azimuth,elevation in degrees", place=path) from None
    if not (math.isfinite(azimuth) and 0.0 <= azimuth <= 360.0 and -90.0 < elevation < 90.0):
        raise ConfigError(f"row {number}: azimuth must be 0 to 360, elevation between -90 and 90", place=path)
    return [azimuth, elevation]


def with_horizons(values: dict[str, Any], path: Path) -> list[Mistake]:
    """Replace file names in `values` by their pairs; returns the mistakes."""
    mistakes = []
    for place, table in _tables(values):
        if isinstance(name := table.get("horizon"), str):
            try:
                table["horizon"] = load_horizon(campaign_folder(path) / name)
            except ConfigError as error:
                mistakes.append(Mistake((*place, "horizon"), error.message))
    return mistakes


def _tables(values: dict[str, Any]) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    if isinstance(site := values.get("site"), dict):
        yield ("site",), site
    yield from regions_in(values)
