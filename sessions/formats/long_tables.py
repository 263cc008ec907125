"""Long tables, of a row per sensor and time: each sensor becomes a column.

So are exports of home automation (``entity_id,state,last_changed``), of networks of sensors, of data bases of
series (``_time,_value,_field``) and logs of messages (``topic,payload``). A column tells the thing of a row
by its name, or because rows of one time differ in it, or because it changes from row to row.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats import tables
from fieldkit.sessions.formats.time_columns import cell_of

_MOST_THINGS = 200
_A_TIME = re.compile(r"\d\d?\D+\d\d?|\d{5}|^\d+$")
_NAME = re.compile(
    r"(?!nan$|null$|none$|n/?a$|[+−-]?[ .]*\d)\D.*|\d+|[\da-f]+(?:[:-][\da-f]+)*", re.IGNORECASE | re.DOTALL
)


def by_thing(table: tables.Table) -> tables.Table:
    """A long table with a column for each thing; any other as it is.

    Raises `ConfigError` where there are too many things.
    """
    telling = _telling(table)
    values = [
        place
        for place in table.free
        if place not in telling
        and (table.columns[place].unit or not tables.THING.fullmatch(table.columns[place].label))
        and table.has_numbers(place)
    ]
    fewest = _fewest(table, telling) or telling[:1]
    if not telling or not values:
        several = [table.columns[place].head for place in table.free if _may_tell(table, place)]
        text = f"one channel has rows of several {', '.join(several)}: if it separates them, name it 'sensor'"
        return replace(table, notes=(*table.notes, text)) if several else table
    things = {row.number: " ".join(filter(None, _cells(row.cells, fewest))) for row in table.rows}
    labels = list(dict.fromkeys(things[row.number] for row in _timed(table)))
    heads = ", ".join(table.columns[place].head for place in fewest)
    shown = ", ".join(labels[:10]) + (" ..." if len(labels) > 10 else "")
    text = f"a row per {heads}: a channel for each of {shown}"
    if len(labels) > _MOST_THINGS:
        raise ConfigError(
            f"{len(labels)} things, {text}", place=table.path, fix=f"keep at most {_MOST_THINGS}"
        )
    return replace(_spread(table, things, labels, values), about=text)


def _spread(
    table: tables.Table, things: Mapping[int, str], labels: Sequence[str], values: Sequence[int]
) -> tables.Table:
    columns, width = [table.columns[place] for place in table.time_at], len(table.time_at)
    rows = [row._replace(cells=_cells(row.cells, table.time_at)) for row in table.rows]
    for thing in labels:
        ours = [at for at, row in enumerate(table.rows) if things[row.number] == thing]
        for place in values:
            old, texts = table.columns[place], {at: cell_of(table.rows[at].cells, place) for at in ours}
            units = {
                at: tables.written_unit(table.rows[at].cells, place, old.unit_at) for at in ours if texts[at]
            }
            if not units:
                continue
            several = len(set(units.values()) - {""}) > 1
            unit = "" if several else next(filter(None, units.values()), old.unit)
            for at in units:
                text = f"{texts[at]} {units[at]}" if several and old.unit_at != place else texts[at]
                rows[at].cells.extend([""] * (len(columns) - len(rows[at].cells)) + [text])
            label = thing if len(values) == 1 else f"{thing} {old.label}"
            unit = unit or ("" if several else tables.split_head(thing)[1])
            head = f"{label} [{unit}]" if unit else label
            columns.append(tables.Column(head, label, unit, old.process, len(columns) if several else -1))
    for row in rows:
        row.cells.extend([""] * (len(columns) - len(row.cells)))
    return replace(table, columns=columns, rows=rows, time_at=tuple(range(width)), long=table, things=things)


def _cells(cells: Sequence[str], places: Sequence[int]) -> list[str]:
    return [cell_of(cells, place) for place in places]


def _timed(table: tables.Table) -> list[tables.Row]:
    """The rows without those of a header that stands there again."""
    return [row for row in table.rows if _A_TIME.search(table.time_text(row))]


def _telling(table: tables.Table) -> list[int]:
    """The columns that tell the thing of a row, words before numbers."""
    rows = _timed(table)
    free = [at for at in table.free if not table.columns[at].unit and table.columns[at].unit_at < 0]
    telling = [place for place in free if _is_telling(table, place, rows)]
    return sorted(telling, key=lambda place: all(cell_of(row.cells, place).isdecimal() for row in rows))


def _fewest(table: tables.Table, telling: Sequence[int]) -> list[int]:
    """Those of the columns without which fewer things could be told."""
    fewest: list[int] = []
    known = 1
    for place in telling:
        things = {tuple(_cells(row.cells, [*fewest, place])) for row in table.rows}
        if len(things) > known:
            fewest, known = [*fewest, place], len(things)
    return fewest


def _is_telling(table: tables.Table, place: int, rows: Sequence[tables.Row]) -> bool:
    cells = [cell_of(row.cells, place).removesuffix(".0") for row in rows]
    names, by_name = set(cells) - {""}, tables.THING.fullmatch(table.columns[place].label.strip())
    are_numbers, is_repeated = all(map(str.isdecimal, cells)), 2 * len(names) <= len(cells)
    is_mixed = not (are_numbers or by_name) and any(map(str.isdecimal, names))  # 20, OL, 21
    has_value = any(tables.VALUE.search(column.label) for column in table.columns)
    least = 1 if by_name and not are_numbers and has_value else 2
    if len(names) < least or is_mixed or not all(map(_NAME.fullmatch, names)):
        return False
    groups: dict[str, list[str]] = {}
    for row, cell in zip(rows, cells, strict=True):
        groups.setdefault(table.time_text(row), []).append(cell)
    several = [group for group in groups.values() if len(group) > 1]
    differ = all(len(set(group)) == len(group) for group in several)
    are_same = not are_numbers or len(set(map(frozenset, several))) <= 1
    if differ and are_same and 2 * sum(map(len, several)) >= len(cells):
        return True
    if by_name and not are_numbers:
        return True
    if by_name and not by_name["place"]:
        changes = sum(earlier != later for earlier, later in pairwise(cells))
        is_unsorted = [*groups] not in (sorted(groups), sorted(groups, reverse=True))
        return is_repeated and (2 * changes >= len(cells) or is_unsorted)
    counts = not are_numbers or (min(map(int, names)) < 2 and max(map(int, names)) <= len(names))
    return is_repeated and counts and "" not in cells and (_is_cycle(cells) or _parts(table, rows, cells))


def _may_tell(table: tables.Table, place: int) -> bool:
    """True for a column of a few words in every row, which may be its condition or its sensor."""
    cells = {cell_of(row.cells, place) for row in table.rows}
    return "" not in cells and 1 < len(cells) <= len(table.rows) / 3 and not table.has_numbers(place)


def _is_cycle(cells: Sequence[str]) -> bool:
    """True where names come round and round, as of the inputs of a logger."""
    after: dict[str, str] = {}
    for (earlier, later), _ in Counter(pairwise(cells)).most_common():
        after.setdefault(earlier, later)
    follow = sum(after[earlier] == later for earlier, later in pairwise(cells))
    is_round = len(set(after.values())) == len(after) and all(name != other for name, other in after.items())
    return is_round and len(cells) >= 3 * len(after) and follow >= 0.9 * (len(cells) - 1)


def _parts(table: tables.Table, rows: Sequence[tables.Row], names: Sequence[str]) -> bool:
    """True where numbers jump from row to row, and not from row to row of one name."""
    for place in table.free:
        numbers = np.array([tables.number_of(tables.number_at(row.cells, place)) for row in rows])
        within = [_jump(numbers[np.array(names) == name]) for name in set(names)]
        if _jump(numbers) > 3.0 * max(within) > 0.0:
            return True
    return False


def _jump(numbers: FloatArray) -> float:
    steps = np.abs(np.diff(numbers[np.isfinite(numbers)]))
    return float(steps.mean()) if steps.size else 0.0
