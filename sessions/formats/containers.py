"""Tables in other files than text, as the text that they stand for: workbooks, Parquet, netCDF, packed ones.

Times of netCDF are by CF, in UTC; those of workbooks as the cells show them. Needs ``fieldkit-slope[files]``.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import date, datetime, time
from itertools import zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.native_code import quiet
from fieldkit.sessions.formats.imported import explained, refuse_large
from fieldkit.sessions.formats.times import spreadsheet_moment

if TYPE_CHECKING:
    from python_calamine import CalamineSheet

Cells = Sequence[Any]
_Read = tuple[Iterable[Cells], tuple[str, ...]]

_MOST_BYTES = 200_000_000
_OF_THIS_TIME = (30_000.0, 80_000.0)
"""Days since then from 1982 to 2119: other numbers are no dates."""
_MIDC = re.compile(rb"DATE \(MM/DD/YYYY\),[A-Z]{3}\b")
_DECIMAL_COMMA = re.compile(r"^\s*([+-]?\d+),(\d{1,2}|\d{4,})\s*$")
_TIME_WORDS = re.compile(r"date|time|stamp|zeit|datum|uhr|fecha|hora|heure|ora\b|日|時", re.IGNORECASE)


class Contents(NamedTuple):
    """The table as text, comma-separated, and what its reader assumed or left out."""

    text: str
    notes: tuple[str, ...] = ()


def is_container(path: Path) -> bool:
    """True if a file is one of these, by its name, or its beginning."""
    return _reader_of(path) is not None


def _reader_of(path: Path) -> Callable[[Path, str], _Read] | None:
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        with path.open("rb") as file:
            return _midc if _MIDC.match(file.read(40)) else None
    return _READERS.get(suffix)


def read_contents(path: Path, sheet: str = "") -> Contents:
    """The table of a file; of several in a workbook that of `sheet`. Raises `ConfigError`."""
    read = _reader_of(path)
    assert read is not None
    # every library has errors of its own; a panic of Rust is no `Exception`
    with explained(path, "cannot be read", "save it again, or export CSV", BaseException):
        refuse_large(path, _MOST_BYTES)
        with quiet():
            rows, notes = read(path, sheet)
    out = io.StringIO(newline="")
    columns = zip_longest(*rows, fillvalue="")
    csv.writer(out).writerows(zip(*map(_column, columns), strict=True))
    return Contents(out.getvalue(), notes)


def _workbook(path: Path, sheet: str) -> _Read:
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    names = [sheet] if sheet else book.sheet_names
    if unknown := {*names} - {*book.sheet_names}:
        fix = f"name one of its sheets: {', '.join(book.sheet_names)}"
        raise ConfigError(f"no sheet {unknown.pop()!r}", place=path, fix=fix)
    sheets = {name: _rows(book.get_sheet_by_name(name)) for name in names}
    tables = {name: rows for name, rows in sheets.items() if _has_table(rows)}
    if not tables:
        raise ConfigError("no sheet has a table", place=path, fix="name a workbook with a table of values")
    if len(tables) > 1:
        problem = f"has tables in several sheets: {', '.join(tables)}"
        raise ConfigError(problem, place=path, fix=Argument("sheet", next(iter(tables))))
    ((name, rows),) = tables.items()
    notes: tuple[str, ...] = (f"sheet {name!r}",) if len(book.sheet_names) > 1 else ()
    columns = [list(column) for column in zip_longest(*rows, fillvalue="")]
    while not any(map(_is_filled, columns[0])):
        del columns[0]
    if not any(isinstance(cell, date | time) for column in columns for cell in column):
        serial = [column for column in columns if _is_serial(column)]
        for column in serial:
            column[:] = [_moment(cell) if isinstance(cell, float) else cell for cell in column]
        if serial:
            notes += ("numbers of days taken as dates and times, as spreadsheets count them",)
    return zip(*columns, strict=True), notes


def _rows(sheet: CalamineSheet) -> list[list[Any]]:
    """The rows; a heading over several columns, but not over the first, stands before each name below it."""
    rows: list[list[Any]] = sheet.to_python(skip_empty_area=False)
    for (top, left), (bottom, right) in sorted(sheet.merged_cell_ranges or (), reverse=True):
        if 0 < left < right and top == bottom < len(rows) - 1:
            heading, below = rows[top], rows[top + 1]
            names = [f"{heading[left]} {below[col]}" for col in range(left, right + 1)]
            rows[top + 1] = [
                *(below[col] or heading[col] for col in range(left)),
                *names,
                *below[right + 1 :],
            ]
    return rows


def _has_table(rows: Sequence[Cells]) -> bool:
    return sum(sum(map(_is_filled, row)) > 1 for row in rows) > 1


def _is_filled(cell: object) -> bool:
    return cell not in ("", None)


def _is_serial(column: Cells) -> bool:
    """True of a column called a date or time whose numbers are days since 1899, or parts of a day."""
    numbers = [cell for cell in column if isinstance(cell, float)]
    is_named = any(isinstance(cell, str) and _TIME_WORDS.search(cell) for cell in column)
    low, high = _OF_THIS_TIME
    are_days = all(low < number < high for number in numbers) or all(0 <= number < 1 for number in numbers)
    return is_named and len(numbers) > 1 and are_days


def _moment(days: float) -> datetime | time:
    moment = spreadsheet_moment(days)
    return moment.time() if days < 1.0 else moment


def _columns(path: Path, sheet: str) -> _Read:
    import pandas as pd

    table = (pd.read_feather if path.suffix.lower() == ".feather" else pd.read_parquet)(path)
    if not isinstance(table.index, pd.RangeIndex):
        table = table.reset_index()
    return [list(map(str, table.columns)), *table.itertuples(index=False, name=None)], ()


def _midc(path: Path, sheet: str) -> _Read:
    """NREL's Measurement and Instrumentation Data Center, whose header names its days and its zone."""
    from pvlib.iotools import read_midc

    table = read_midc(path)
    stamps = [stamp.isoformat() for stamp in table.index]
    rows = zip(stamps, *(table[name].tolist() for name in table.columns[2:]), strict=True)
    return [("time", *table.columns[2:]), *rows], ("times by the header's zone",)


def _netcdf(path: Path, sheet: str) -> _Read:
    import xarray as xr

    content = path.read_bytes()  # a mapped file cannot be closed while a damaged one is referred to
    engine = "scipy" if content.startswith(b"CDF") else "h5netcdf"
    if engine == "h5netcdf":
        with h5py.File(io.BytesIO(content), "r") as file:
            file.attrs.get("_nc3_strict")  # where not even this can be read, closing would fail as well
    with xr.open_dataset(io.BytesIO(content), engine=engine, decode_timedelta=False) as data:
        times = [name for name, of in data.variables.items() if of.ndim == 1 and of.dtype.kind == "M"]
        if not times:
            problem, fix = "no variable is a time by CF", 'give it units like "seconds since 2026-05-12"'
            raise ConfigError(problem, place=path, fix=fix)
        at = data[min(times, key=lambda name: name not in data.coords)]
        numbers = {str(name): of for name, of in data.data_vars.items() if of.dtype.kind in "fiu"}
        along = {name: of for name, of in numbers.items() if of.dims == at.dims}
        left = [name for name, of in numbers.items() if of.ndim > 1]
        units = {name: of.attrs.get("units") for name, of in along.items()}
        heads = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
        stamps = [f"{stamp}Z" for stamp in np.datetime_as_string(at.values)]
        rows = zip(stamps, *(of.values.tolist() for of in along.values()), strict=True)
        notes = (f"variables of more than the time are excluded: {', '.join(left)}",) if left else ()
        return [("time", *heads), *rows], notes


def _column(cells: Cells) -> list[str]:
    """Cells of a column as text: dates without a time of day where all of them are at midnight."""
    stamps = [cell for cell in cells if isinstance(cell, datetime) and cell == cell]  # NaT is one, of no time
    are_days = all(stamp.time() == time() for stamp in stamps)
    return [_text(cell, are_days=are_days) for cell in cells]


def _text(cell: Any, *, are_days: bool) -> str:
    if cell is None or cell != cell:  # NaN, and pandas' NaT
        return ""
    if isinstance(cell, datetime):
        return str(cell.date()) if are_days else cell.isoformat(" ")
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15:
        return str(int(cell))
    return re.sub(_DECIMAL_COMMA, r"\1.\2", str(cell))


_READERS: Mapping[str, Callable[[Path, str], _Read]] = MappingProxyType(
    {
        **dict.fromkeys((".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), _workbook),
        **dict.fromkeys((".parquet", ".feather"), _columns),
        **dict.fromkeys((".nc", ".nc4", ".cdf"), _netcdf),
    }
)
