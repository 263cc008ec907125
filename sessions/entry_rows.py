"""Rows of entries in the tables of the session file: each to its row, and back.

Numbers are stored as they are; text is cut to the width of its field. An event's text that its field would
cut stands whole among its details; details that do not fit are omitted, and the entry is marked.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.samples import Event, EventKind, Health, Quality, Severity, StreamHealth
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.sessions import layout
from fieldkit.sessions.chunks import as_column
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord, field_names

Table = Mapping[str, AnyArray]
Row = dict[str, Any]
T = TypeVar("T")
_BY_REGION = ("residual_k", "autocorrelation")
_TEXT_BYTES, _DATA_BYTES, _WHOLE_TEXT = 256, 1024, "whole_text"
_PER_STREAM = ("received", "dropped", "queued", "late_max_us", "rejected", "implausible")
_ATTRIBUTES = {
    "time": "time_ns", "window_start": "window_start_ns", "offset_error_ns": "error_ns", "label": "name",
}  # fmt: skip
"""Attributes of an entry that are not called as their columns."""


class EntryRows:
    """Converts entries to rows, for one session."""

    def __init__(self, header: layout.SessionHeader, anchor_ns: int) -> None:
        self._columns = layout.entry_columns(header)
        self._regions = {name: number for number, name in enumerate(header.region_names)}
        self._streams = {info.name: number for number, info in enumerate(header.streams)}
        self._anchor_ns = anchor_ns

    def rows(self, entry: Entry) -> Iterable[tuple[str, Row]]:
        """The rows of an entry, each with its table; their numbers may not fit: see `fitting_column`."""
        if isinstance(entry, MinuteRecord):
            value, model = entry.irradiance_w_m2, entry.irradiance_model
            yield "irradiance", self._row("irradiance", entry, value=value, model=model)
            for estimate in entry.estimates:
                yield "estimates", self._row("estimates", estimate, time=entry.time_ns)
            if entry.learnt is not None:
                yield "learnt", self._learnt_row(entry.time_ns, entry.learnt)
        elif isinstance(entry, RegionRecord):
            yield "regions", self._region_row(entry)
        elif isinstance(entry, Event):
            yield "events", row_of(layout.EVENT_COLUMNS, entry, data=stored_details(entry))
        elif isinstance(entry, Health):
            yield "health", self._health_row(entry)
        else:
            yield "clock", self._row("clock", entry, time=entry.mono_ns + self._anchor_ns)

    def _row(self, table: str, entry: object, **values: Any) -> Row:
        return row_of(self._columns[table], entry, **values)

    def _learnt_row(self, time_ns: int, learnt: Learnt) -> Row:
        row: Row = {name: np.full(layout.MAX_LEARNT, np.nan) for name in layout.LEARNT_NUMBERS}
        row |= {name: np.zeros(layout.MAX_LEARNT, "S32") for name in ("name", "unit")}
        for place, parameter in enumerate(learnt.parameters[: layout.MAX_LEARNT]):
            for name, column in row.items():
                value = getattr(parameter, name)
                column[place] = layout.encode_text(value, 32) if isinstance(value, str) else value
        for name in _BY_REGION:
            row[name] = np.full(max(1, len(self._regions)), np.nan)
            for region, value in getattr(learnt, name).items():
                if region in self._regions:  # of those drawn later there is no column
                    row[name][self._regions[region]] = value
        return {"time": time_ns // 1000, "chi_square": learnt.chi_square, **row}

    def _region_row(self, record: RegionRecord) -> Row:
        region = record.region
        points_px, points_m = (np.full((layout.MAX_VERTICES, axes), np.nan) for axes in (2, 3))
        points_px[: len(region.points_px)] = region.points_px
        if region.points_m:
            points_m[: len(region.points_m)] = region.points_m
        return self._row(
            "regions", region, time=record.time_ns, removed=record.is_removed, points_px=points_px,
            n_points=len(region.points_px), points_m=points_m,
        )  # fmt: skip

    def _health_row(self, health: Health) -> Row:
        counts: Row = {name: np.zeros(max(1, len(self._streams)), object) for name in _PER_STREAM}
        for stream in health.streams:
            if stream.stream in self._streams:
                for name, values in counts.items():
                    values[self._streams[stream.stream]] = getattr(stream, name)
        return self._row("health", health, **counts)


def row_of(columns: Iterable[layout.Column], entry: object, **values: Any) -> Row:
    """The row of an entry: its attributes by the columns called alike, and the `values` of the others."""
    names = {column.name: _ATTRIBUTES.get(column.name, column.name) for column in columns}
    row = {name: values[name] if name in values else getattr(entry, own) for name, own in names.items()}
    return {column.name: _stored_value(row[column.name], column) for column in columns}


def _stored_value(value: Any, column: layout.Column) -> Any:
    if column.is_text and not isinstance(value, bytes):
        return layout.encode_text(str(value), np.dtype(column.dtype).itemsize)
    return value // 1000 if column.is_time else value


def fitting_column(values: Sequence[Any], column: layout.Column) -> AnyArray:
    """The values of some rows; numbers too large or small for a column of integers as the outermost it holds.

    A journal may hold any number, and one entry must not keep all the rest from being stored.
    """
    kind = np.dtype(column.dtype)
    if kind.kind not in "iu":
        return as_column(values, column)
    per = 1000 if column.is_time else 1  # read as nanoseconds
    lowest, highest = -(-np.iinfo(kind).min // per), np.iinfo(kind).max // per
    return as_column(np.clip(np.array(values, object), lowest, highest), column)


def stored_column(rows: Sequence[Row], column: layout.Column) -> AnyArray:
    """A column of some rows as h5py stores it, text marked as UTF-8."""
    values = [row[column.name] for row in rows]
    if column.is_text:
        return np.array(values, h5py.string_dtype("utf-8", np.dtype(column.dtype).itemsize))
    return fitting_column(values, column)


def event_columns(events: Sequence[Event]) -> Table:
    """The columns of a table of these events."""
    rows = [row_of(layout.EVENT_COLUMNS, event, data=stored_details(event)) for event in events]
    return {column.name: stored_column(rows, column) for column in layout.EVENT_COLUMNS}


def stored_details(event: Event) -> bytes:
    """The details of an event as its row has them; what does not fit is omitted."""
    data = _details(event) or _json(event.data)
    return data if len(data) <= _DATA_BYTES else _json({"left_out": f"details of {len(data)} bytes"})


def event_fits(event: Event) -> bool:
    """True if a session keeps an event with all of its text and details."""
    return _details(event) is not None


def _details(event: Event) -> bytes | None:
    """The details as stored, with a text that is longer than its column; None where that is too much."""
    whole = str(event.text)
    is_cut = len(whole.encode(errors="replace")) > _TEXT_BYTES
    data = _json({**event.data, _WHOLE_TEXT: whole} if is_cut else event.data)
    return data if len(data) <= _DATA_BYTES else None


def _json(data: Mapping[str, Any]) -> bytes:
    return json.dumps(dict(data), default=str, ensure_ascii=False).encode(errors="replace") if data else b""


def _rows(table: Table) -> Iterator[Row]:
    """The rows of a table by the attributes they are of, as plain numbers, texts and lists."""
    names = [_ATTRIBUTES.get(name, name) for name in table]  # "time" gives way to the "time_ns" behind it
    columns = [_plain(values) for values in table.values()]
    return (dict(zip(names, row, strict=True)) for row in zip(*columns, strict=False))


def _plain(values: AnyArray) -> list[Any]:
    is_text = values.dtype.kind == "S" and values.ndim == 1
    return [layout.decode_text(text) for text in values.tolist()] if is_text else values.tolist()


def _entry(kind: type[T], row: Row, /, **values: Any) -> T:
    """An entry from its row, the inverse of `row_of`: the `values`, and the row's for the other fields."""
    names = field_names(kind)  # type: ignore[arg-type]  # mypy takes no type[T] for hashable
    return kind(**{name: row[name] for name in names if name in row} | values)


def events_from(table: Table) -> list[Event]:
    """The events of a table."""
    return [_event(row, _details_from(row["data"])) for row in _rows(table)]


def _event(row: Row, details: dict[str, Any]) -> Event:
    text = str(details.pop(_WHOLE_TEXT, row["text"]))
    kind, severity = EventKind(row["kind"]), Severity(row["severity"])
    return _entry(Event, row, kind=kind, severity=severity, text=text, data=details)


def _details_from(text: str) -> dict[str, Any]:
    """Details of an event; text that is none, or ends at no time, as it is."""
    try:
        details = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return {"unreadable": text}
    ends = details.get("end_ns", 0) if isinstance(details, dict) else None
    return details if isinstance(ends, int) and abs(ends) < 2**63 else {"unreadable": text}


def health_from(table: Table, streams: tuple[str, ...]) -> list[Health]:
    """The health of a recording, second by second."""
    return [_health(row, streams) for row in _rows(table)]


def _health(row: Row, streams: tuple[str, ...]) -> Health:
    of_streams = (
        StreamHealth(name, **{key: row[key][place] for key in _PER_STREAM})
        for place, name in enumerate(streams)
    )
    return _entry(Health, row, streams=tuple(of_streams))


def clock_checks_from(table: Table) -> list[ClockCheck]:
    """The comparisons of the clocks."""
    return [_entry(ClockCheck, row) for row in _rows(table)]


def regions_from(table: Table) -> list[RegionRecord]:
    """Every outline of every region, in the order they were drawn."""
    return [RegionRecord(_region(row), row["time_ns"], bool(row["removed"])) for row in _rows(table)]


def _region(row: Row) -> Region:
    corners, corners_m = (row[name][: row["n_points"]] for name in ("points_px", "points_m"))
    points_m = () if np.isnan(corners_m).any() else tuple(map(tuple, corners_m))
    points_px = tuple(map(tuple, corners))
    return _entry(Region, row, kind=RegionKind(row["kind"]), points_px=points_px, points_m=points_m)


def estimates_from(table: Table) -> list[SlopeEstimate]:
    """The estimates of every minute and region that has one."""
    return [
        _entry(SlopeEstimate, row, state=SlopeState(row["state"]), flags=Quality(row["flags"]))
        for row in _rows(table)
    ]


def minutes_from(
    table: Table, estimates: Iterable[SlopeEstimate], learnt: Mapping[int, Learnt]
) -> list[MinuteRecord]:
    """The minutes of a table of irradiance, with the estimates and what was learnt at each."""
    slopes = defaultdict(list)
    for estimate in estimates:
        slopes[estimate.time_ns].append(estimate)
    return [
        MinuteRecord(at, tuple(slopes[at]), row["value"], row["model"], Quality(row["flags"]), learnt.get(at))
        for row in _rows(table)
        for at in [row["time_ns"]]
    ]


def learnt_from(table: Table, regions: tuple[str, ...]) -> dict[int, Learnt]:
    """Parameters learnt, by the UTC nanoseconds of each minute that has it."""
    return {row["time_ns"]: _learnt(row, regions) for row in _rows(table)}


def _learnt(row: Row, regions: tuple[str, ...]) -> Learnt:
    texts = (map(layout.decode_text, row[name]) for name in ("name", "unit"))
    parameters = (
        LearntParameter(name, unit, **dict(zip(layout.LEARNT_NUMBERS, numbers, strict=True)))
        for name, unit, *numbers in zip(*texts, *(row[name] for name in layout.LEARNT_NUMBERS), strict=True)
        if name
    )
    by_region = {
        # without regions, one place
        name: {at: value for at, value in zip(regions, row[name], strict=False) if not math.isnan(value)}
        for name in _BY_REGION
    }
    return Learnt(tuple(parameters), **by_region, chi_square=row["chi_square"])
