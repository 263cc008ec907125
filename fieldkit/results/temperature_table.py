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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import numpy as np

from fieldkit.estimation.table import TemperatureTable
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.text_file import read_text
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.sessions.formats.tables import refuse_swallowed

Row = Mapping[str, str | None]
LIGHT_COLUMNS = ("irradiance_w_m2", "ghi_w_m2", "illuminance_lx")
OTHER_COLUMNS = (*LIGHT_COLUMNS, "diffuse_w_m2", "longwave_w_m2", "wind_m_s")


def read_table(path: Path, *, needs_reference: bool = True) -> TemperatureTable:
    """Read and check a table; rows are put in order of time. Without a reference its temperature is NaN."""
    text = read_text(path, newline="")
    try:
        reader = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
        names = [name.strip() for name in reader.fieldnames or []]
        reader.fieldnames = names
        rows = list(_filled_rows(path, reader))
    except csv.Error as error:
        raise ConfigError(
            f"cannot be read as a table: {error}", place=path, fix="export it again as CSV"
        ) from error
    _refuse_repeated(path, names)
    temperatures = _temperature_columns(path, names, needs_reference)
    if not rows:
        raise ConfigError("the table has no rows", place=path, fix="give one row per measurement")
    times = np.array([_time_ns(path, line, row) for line, row in rows], np.int64)
    order = np.argsort(times, kind="stable")
    kelvin = {
        name: _column(path, rows, column)[order] + zero for name, (column, zero) in temperatures.items()
    }
    others = {name: _column(path, rows, name)[order] for name in OTHER_COLUMNS if name in names}
    flags = _flags(path, rows)[order] if "flags" in names else np.zeros(0, np.int64)
    reference = kelvin.pop("reference", np.full(times.size, np.nan))
    air_k = kelvin.pop("air", None)
    lines = np.array([line for line, _ in rows], np.int64)[order]
    return TemperatureTable(times[order], reference, kelvin, **others, air_k=air_k, flags=flags, lines=lines)


def _filled_rows(path: Path, reader: csv.DictReader[str]) -> Iterator[tuple[int, Row]]:
    """The rows that hold anything, each with its line of the file."""
    for row in reader:
        # the reader gathers what has no column under no name
        surplus = row.pop(None, [])
        if not any((cell or "").strip() for cell in (*row.values(), *surplus)):
            continue
        refuse_swallowed(path, reader.line_num, (cell or "" for cell in row.values()), len(row), ",")
        if surplus:
            raise ConfigError(
                "more cells than columns",
                place=_line(path, reader.line_num),
                fix="write decimals with a point, not a comma, and no comma after the last cell",
            )
        yield reader.line_num, row


def _refuse_repeated(path: Path, names: Sequence[str]) -> None:
    """Raise `ConfigError` for columns of one name, or a temperature in kelvin and in degrees Celsius."""
    columns: dict[str, str] = {}
    for name in filter(None, names):
        quantity = f"{name[:-2]}_k" if name.endswith("_c") else name
        if quantity in columns:
            raise ConfigError(
                f"the columns {columns[quantity]} and {name} are of the same quantity",
                place=path,
                fix="give each column a name of its own, or remove one of them",
            )
        columns[quantity] = name


def _temperature_columns(path: Path, names: list[str], needs_reference: bool) -> dict[str, tuple[str, float]]:
    """Column and its zero in kelvin by region; all missing columns are reported at once."""
    columns = {
        name[:-2]: (name, 0.0 if name.endswith("_k") else CELSIUS_ZERO_K)
        for name in names
        if name[-2:] in ("_k", "_c") and len(name) > 2
    }
    missing = [
        what
        for what, there in (
            ("time", "time" in names),
            ("reference_k (or reference_c)", "reference" in columns or not needs_reference),
            ("one NAME_k (or NAME_c) per target", columns.keys() - {"reference", "air"}),
            ("irradiance_w_m2, ghi_w_m2 or illuminance_lx", set(LIGHT_COLUMNS) & set(names)),
        )
        if not there
    ]
    if missing:
        raise ConfigError(
            f"missing columns: {'; '.join(missing)}",
            place=path,
            fix=f"name the columns in the first line; it has: {', '.join(names) or 'none'}",
        )
    return columns


def _line(path: Path, line: int) -> str:
    return f"{path}, line {line}"


def _time_ns(path: Path, line: int, row: Row) -> int:
    text, problem = (row["time"] or "").strip(), " is not ISO 8601 with a zone"
    with suppress(ValueError):
        time = datetime.fromisoformat(text)
        if time.utcoffset() is not None:
            try:
                return utc_ns(time)
            except ValueError as error:
                problem = f": {error}"
    fix = "write times like 2017-08-30T12:00:00+09:00"
    raise ConfigError(f"time '{text}'{problem}", place=_line(path, line), fix=fix)


def _column(path: Path, rows: Sequence[tuple[int, Row]], name: str) -> FloatArray:
    values = np.full(len(rows), np.nan)
    for index, (line, row) in enumerate(rows):
        cell = (row[name] or "").strip()
        try:
            values[index] = float(cell) if cell else np.nan
        except ValueError as error:
            raise ConfigError(
                f"{name} '{cell}' is not a number",
                place=_line(path, line),
                fix="leave a missing value empty",
            ) from error
    return values


def _flags(path: Path, rows: Sequence[tuple[int, Row]]) -> IntArray:
    """Flags of the rows, 0 for an empty cell."""
    values = np.nan_to_num(_column(path, rows, "flags"))
    wrong = np.flatnonzero((values % 1.0 != 0.0) | (values < 0.0) | (values >= 2.0**32))
    if wrong.size:
        line, row = rows[wrong[0]]
        raise ConfigError(
            f"flags '{(row['flags'] or '').strip()}' is not a sum of flags",
            place=_line(path, line),
            fix="add the values of Quality, such as 2048 for shaded, or leave the cell empty",
        )
    return values.astype(np.int64)
