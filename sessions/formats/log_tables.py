"""The table in a file of a logger or spreadsheet: its header, its rows, and what its first lines say.

Tables have one header line with the unit of a column in brackets. Two makers write their own:

- Campbell Scientific (TOA5): a line on the logger, names, units, how each value was made (``Avg``, ``Smp``).
- Onset (HOBOware): a title, then cells like ``Temp, °C (LGR S/N: 1, SEN S/N: 2, LBL: bed)`` and the zone in
  that of the time, ``Date Time, GMT+09:00``.

Sources: both makers' manuals, and public programs that read such files.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass
from datetime import timedelta, timezone, tzinfo
from pathlib import Path

from fieldkit.model.errors import ConfigError

_MAX_BYTES = 100_000_000
_TOA5_LINES = 4
_GMT = re.compile(r"\bGMT ?([+-])(\d{2}):?(\d{2})\b")
_HOBO = re.compile(r"(?P<name>[^,(]+?)(?:, (?P<unit>[^,(]+?))?(?: \((?P<more>(?:LGR|SEN|LBL).*)\))?")


@dataclass(frozen=True, slots=True)
class Table:
    """Cells of `head` are ``name`` or ``name [unit]``; `time_at` is the place of the time or the date.

    `has_decimal_commas` tells that a comma in a number is its decimal point; `averages` that values are means
    up to the time of their row; `zone` is of the times, where the file says it.
    """

    head: list[str]
    rows: list[list[str]]
    has_decimal_commas: bool
    time_at: int = 0
    averages: bool = False
    zone: tzinfo | None = None


def read_table(path: Path, encoding: str) -> Table:
    """The table of a file, of the forms above; raises `ConfigError`."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(f"{path} is larger than {_MAX_BYTES // 10**6} MB", fix="split it")
        text = path.read_text(encoding=encoding)
        dialect = csv.Sniffer().sniff(text[:4096], delimiters=",;\t")
        ended = io.StringIO(text, newline="")  # `str.splitlines` would end lines at U+2028 and its like too
        lines = [row for row in csv.reader(ended, dialect) if any(cell.strip() for cell in row)]
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not in {error.encoding}: byte {error.object[error.start]:#04x} at {error.start}",
            fix="name its encoding: --encoding cp1252 (Western Windows), cp932 (Japanese), utf-16",
        ) from error
    except LookupError as error:
        raise ConfigError(f"{error}", fix="--encoding utf-8, cp1252, cp932 or utf-16") from error
    except (OSError, UnicodeError, csv.Error) as error:
        raise ConfigError(
            f"{path} cannot be read as a table: {error}", fix="save it as CSV, UTF-8"
        ) from error
    rows = [[cell.strip() for cell in line] for line in lines]
    table = _of_campbell(rows) or _of_onset(rows, dialect.delimiter) or _plain(rows, dialect.delimiter)
    if not table.rows or len(table.head) < 2:
        raise ConfigError(
            f"{path} has no table with a header line and rows",
            fix="keep the header line, with the unit of each column in brackets",
        )
    return table


def _plain(rows: list[list[str]], delimiter: str) -> Table:
    return Table(rows[0] if rows else [], rows[1:], delimiter != ",")


def _of_campbell(rows: list[list[str]]) -> Table | None:
    if len(rows) < _TOA5_LINES or rows[0][0] != "TOA5":
        return None
    _, names, units, made = rows[:_TOA5_LINES]
    head = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=False)]
    head[:2] = names[:2]  # the time and the number of the record, whose units are TS and RN
    return Table(head, rows[_TOA5_LINES:], False, averages="Avg" in made)


def _of_onset(rows: list[list[str]], delimiter: str) -> Table | None:
    """HOBOware writes its title or leaves it out, and numbers the rows or does not."""
    for line, cells in enumerate(rows[:2]):
        zones = [found for found in map(_GMT.search, cells) if found]
        dates = [place for place, cell in enumerate(cells) if cell.startswith("Date")]
        if zones and dates:
            sign, hours, minutes = zones[0].groups()
            ahead = timedelta(hours=int(hours), minutes=int(minutes)) * (-1 if sign == "-" else 1)
            return Table(_named(cells), rows[line + 1 :], delimiter != ",", dates[0], zone=timezone(ahead))
    return None


def _named(cells: list[str]) -> list[str]:
    """Headers as ``name [unit]``: the label of a sensor, or what it measures, with its number if need be."""
    parts = [_parts(cell) for cell in cells]
    count = Counter(name for name, _, _ in parts)
    return [
        (f"{name} {serial}" if count[name] > 1 and serial else name) + (f" [{unit}]" if unit else "")
        for name, unit, serial in parts
    ]


def _parts(cell: str) -> tuple[str, str, str]:
    """Name, unit and serial number of the sensor, as far as the cell of a header has them."""
    found = _HOBO.fullmatch(cell)
    if found is None or _GMT.search(cell):
        return cell, "", ""
    more = found["more"] or ""
    label, serial = re.search(r"LBL: ([^,]+)", more), re.search(r"SEN S/N: (\w+)", more)
    return (
        label[1].strip() if label else found["name"],
        found["unit"] or "",
        serial[1] if serial else "",
    )
