"""Tables of measured temperatures as CSV files, for `fieldkit.results.estimate.estimate_tables`.

Columns: ``time`` (ISO 8601 with zone), ``reference_k``, one ``NAME_k`` per target (or
``_c`` for both), ``irradiance_w_m2`` (direct normal), ``ghi_w_m2`` (global horizontal) or
``illuminance_lx``; if there, ``air_k`` (or ``air_c``), ``wind_m_s``, ``diffuse_w_m2``, ``longwave_w_m2`` and
``flags``.
Empty cells are missing values.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.estimation.table import TemperatureTable
from fieldkit.model.arrays import AnyArray
from fieldkit.model.clock import YEARS, as_moment, utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.text_file import read_text
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.sessions.formats.imported import explained
from fieldkit.sessions.formats.tables import refuse_swallowed
from fieldkit.sessions.formats.time_columns import cell_of

LIGHT_COLUMNS = ("irradiance_w_m2", "ghi_w_m2", "illuminance_lx")
OTHER_COLUMNS = (*LIGHT_COLUMNS, "diffuse_w_m2", "longwave_w_m2", "wind_m_s")


def read_table(path: Path, *, needs_reference: bool = True) -> TemperatureTable:
    """Read and check a table; rows are put in order of time. Without a reference its temperature is NaN."""
    names, rows = _rows(path)
    _refuse_repeated(path, names)
    temperatures = _temperature_columns(path, names, needs_reference)
    if not rows:
        raise ConfigError("the table has no rows", place=path, fix="give one row per measurement")

    def column(name: str) -> AnyArray:
        place = names.index(name)
        return _column(path, name, [(line, cell_of(cells, place)) for line, cells in rows])

    time_ns = column("time")
    order = np.argsort(time_ns, kind="stable")
    kelvin = {region: column(name)[order] + zero for region, (name, zero) in temperatures.items()}
    others = {name: column(name)[order] for name in (*OTHER_COLUMNS, "flags") if name in names}
    reference = kelvin.pop("reference", np.full(time_ns.size, np.nan))
    air_k = kelvin.pop("air", None)
    lines = np.array([line for line, _ in rows], np.int64)[order]
    return TemperatureTable(time_ns[order], reference, kelvin, **others, air_k=air_k, lines=lines)


def _rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names of the columns, and the rows that hold anything, each with its line of the file."""
    reader = csv.reader(io.StringIO(read_text(path, newline=""), newline=""), skipinitialspace=True)
    with explained(path, "cannot be read as a table", "export it again as CSV", csv.Error):
        numbered = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    filled = [(line, cells) for line, cells in numbered if any(cells)]
    (_, names), *rows = filled or [(0, list[str]())]
    for line, cells in rows:
        refuse_swallowed(path, line, cells, len(names), ",")
        if len(cells) > len(names):
            fix = "write decimals with a point, not a comma, and no comma after the last cell"
            raise ConfigError("more cells than columns", place=f"{path}, line {line}", fix=fix)
    return names, rows


def _refuse_repeated(path: Path, names: Sequence[str]) -> None:
    """Raise `ConfigError` for columns of one name, or a temperature in kelvin and in degrees Celsius."""
    columns: dict[str, str] = {}
    for name in filter(None, names):
        quantity = f"{name[:-2]}_k" if name.endswith("_c") else name
        if quantity in columns:
            problem = f"the columns {columns[quantity]} and {name} are of the same quantity"
            fix = "give each column a name of its own, or remove one of them"
            raise ConfigError(problem, place=path, fix=fix)
        columns[quantity] = name


def _temperature_columns(path: Path, names: list[str], needs_reference: bool) -> dict[str, tuple[str, float]]:
    """Column and its zero in kelvin by region; all missing columns are reported at once."""
    columns = {
        name[:-2]: (name, 0.0 if name.endswith("_k") else CELSIUS_ZERO_K)
        for name in names
        if name[-2:] in ("_k", "_c") and len(name) > 2
    }
    needed = {
        "time": "time" in names,
        "reference_k (or reference_c)": "reference" in columns or not needs_reference,
        "one NAME_k (or NAME_c) per target": columns.keys() - {"reference", "air"},
        "irradiance_w_m2, ghi_w_m2 or illuminance_lx": set(LIGHT_COLUMNS) & set(names),
    }
    if missing := [what for what, there in needed.items() if not there]:
        fix = f"name the columns in the first line; it has: {', '.join(names) or 'none'}"
        raise ConfigError(f"missing columns: {'; '.join(missing)}", place=path, fix=fix)
    return columns


def _time_ns(text: str) -> int:
    return utc_ns(as_moment(text))


def _number(text: str) -> float:
    return float(text or "nan")


def _flags(text: str) -> int:
    if not 0.0 <= (flags := float(text or 0)) < 2.0**32 or flags % 1.0:
        raise ValueError(text)
    return int(flags)


_KINDS: dict[str, tuple[Callable[[str], Any], str, str]] = {
    "time": (
        _time_ns,
        f"ISO 8601 with a zone, of {YEARS[0]} to {YEARS[-1]}",
        "write times like 2017-08-30T12:00:00+09:00",
    ),
    "flags": (
        _flags,
        "a sum of flags",
        "add values of Quality, such as 2048 for shaded, or leave it empty",
    ),
}
"""How the cells of a column are read, what they are, and the next step for one that is not."""
_NUMBERS = _number, "a number", "leave a missing value empty"


def _column(path: Path, name: str, cells: Sequence[tuple[int, str]]) -> AnyArray:
    """The values of a column's cells, each with its line."""
    read, kind, fix = _KINDS.get(name, _NUMBERS)
    values = []
    for line, cell in cells:
        try:
            values.append(read(cell))
        except ValueError as error:
            problem = f"{name} '{cell}' is not {kind}"
            raise ConfigError(problem, place=f"{path}, line {line}", fix=fix) from error
    return np.array(values)
