"""Tables of loggers and spreadsheets (CSV) as streams: thermometers, light, anything with a time and numbers.

Zone and clock offset of the logger are given by the user, never guessed; the unit stands in
the column's header (``T1 [C]``, ``lux (lx)``) or is given. What the table states, no option overrides.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, tzinfo
from itertools import chain, compress, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fieldkit.model import quantities
from fieldkit.model.channels import how_to_state
from fieldkit.model.component_names import component_named, may_measure
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Sentence
from fieldkit.model.quantities import KNOWN_UNITS, POWER, Meaning, Quantity, meaning_of, unknown_meaning
from fieldkit.model.samples import Quality, Reading, Severity
from fieldkit.phrases import counted
from fieldkit.sessions.formats import imported, tables, times
from fieldkit.sessions.formats.imported import ImportedRecording, MissingOptionsError, UnstatedZoneError
from fieldkit.sessions.formats.logger_clock import Notes, TimedRow, in_clock_order, listing, row_count
from fieldkit.sessions.formats.long_tables import by_thing
from fieldkit.sessions.formats.tables import AS_WRITTEN, LogOptions, Table, read_table
from fieldkit.sessions.formats.time_columns import cell_of, counted_ns
from fieldkit.sessions.formats.times import Times, read_times
from fieldkit.sessions.formats.zones import example

_EXPORTED = ("seq", "flags", "mono_ns")
"""The last columns of the tables that fieldkit exports (`fieldkit.sessions.analysis.to_pandas`)."""
_ALL_FLAGS = 2**32 - 1
_MOST_RAW = 255
_MOST_LISTED = 50

_WITH_COMMA = re.compile(r"[+-]?\d+(,\d+)+(\.\d*)?")

# with the other mark behind them, or where there are two, marks can only be of thousands
_ANY_POINT = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")  # 12.345 may be twelve, or twelve thousand
_NO_VALUE = re.compile(r"nan|null|none|n/?a|[-*?]+|unavailable|unknown|no ?data", re.IGNORECASE)
_DECIMAL_POINT = re.compile(r"[+-]?\d*\.\d*([eE][+-]?\d+)?")


def read_log(path: Path, name: str, options: LogOptions = AS_WRITTEN) -> ImportedRecording:
    """Read a logger's table: one stream for each quantity in it, and one for its averages.

    The table has one header line; those of Campbell (TOA5) and HOBOware are recognised. `name` is that of the
    stream, or of the streams with their quantity behind it; `options` give what the table does not: by
    default the time and every column with a known unit are read. Readings are in order of time, cells without
    a number NaN; averages stamped at the end of their interval are moved into its middle. Tables that
    fieldkit exported keep their flags. Raises `ConfigError` with what was found if the table is ambiguous,
    contradicts an option or cannot be read.
    """
    table = by_thing(read_table(path, options))
    try:
        channels, about_columns = _channels(table)
        channels, about_components = _components(table, channels)
    except MissingOptionsError as error:
        raise imported.together(error, *_missing_of_times(table)) from None
    _refuse_marks(table, channels)
    _refuse_without_numbers(table, channels)
    rows, zone, about_times = _timed_rows(table)
    streams = _streams(name, table, channels, rows)
    readings = list(chain.from_iterable(_readings(stream, _flags_at(table)) for stream in streams))
    readings.sort(key=lambda reading: reading.time_ns)
    applied = f", clock offset {options.offset_ns / 1e9:+g} s applied" if options.offset_ns else ""
    about = f"{path.name}: {counted(len(rows), 'row')}, times {zone}{applied}"
    all_notes = (
        *((Severity.INFO, note) for note in (about, table.about, *table.notes) if note),
        *((Severity.WARNING, loss) for loss in table.losses),
        *about_times,
        *about_columns,
        *_on_end(table),
        *about_components,
        *_on_cells(rows, channels),
        *chain.from_iterable(map(_on_stream, streams)),
    )
    return ImportedRecording(tuple(stream.info for stream in streams), readings, all_notes)


# --- rows and their times


def _timed_rows(table: Table) -> tuple[list[TimedRow], str, Notes]:
    """The rows with a time, in order of time; the zone they were taken in; notes that name the others."""
    rows = table.rows
    moments, zone, notes = _times(table)
    errors = dict(moments.unreadable) | _too_long(table)
    if 2 * len(errors) >= len(rows):
        place = min(errors)
        error = errors[place]
        refusal = type(error)(error.message, place=f"{table.path}, row {rows[place].number}", fix=error.fix)
        has_offset = re.search(r"([+-]\d\d:?\d\d|Z|UTC|GMT)$", table.time_text(rows[place]))
        is_known = has_offset or table.options.zone or table.stated
        zone_error = UnstatedZoneError("no zone", fix=times.GIVE_ZONE)
        raise imported.together(refusal, *([] if is_known else [zone_error]))
    timed = [
        TimedRow(row.number, times.plausible_ns(moments.known_ns[place] + table.options.offset_ns), row.cells)
        for place, row in enumerate(rows)
        if place not in errors
    ]
    if errors:
        named_rows = [f"row {rows[place].number} ({errors[place].message})" for place in sorted(errors)]
        notes.append((Severity.WARNING, f"{row_count(named_rows)} excluded: {listing(named_rows)}"))
    ordered, about_order = _of_things(timed, table)
    return ordered, zone, notes + about_order


def _missing_of_times(table: Table) -> list[ConfigError]:
    try:
        _timed_rows(table)
    except ConfigError as error:  # others are raised when the options are there
        return [error] if isinstance(error, MissingOptionsError) else []
    return []


def _times(table: Table) -> tuple[Times, str, Notes]:
    """The times by row, words on their zone, and a note on one that is given for nothing.

    Raises `ConfigError` where what the table states differs from the zone given, or in itself, or is open.
    """
    read, given = _reader(table), table.options.zone
    stated = [zone for one in table.stated for zone in one.zones]
    zone = given or next(iter(stated), UTC if table.stated else None)
    moments = read(zone)
    if not moments.needed_zone:
        text = f"every time states its own offset: the zone {given} applies to none"
        return moments, "with their own offset", [(Severity.WARNING, text)] if given else []
    agree = [read(other).known_ns == moments.known_ns for other in stated]
    if given and stated and not any(agree):
        fix = "omit " + Argument("zone") + "; " + Argument("offset_s") + " moves times of a wrong clock"
        problem = f"its times are of the zone {stated[0]}, not of {given}"
        raise ConfigError(problem, place=table.path, fix=fix)
    words = " and ".join(repr(one.words) for one in table.stated)
    if not given and table.stated and not (stated and all(agree)):
        fix = "name the zone that its clock kept, such as " + Argument("zone", example(table.stated))
        raise MissingOptionsError(f"leaves the zone of its times open: {words}", place=table.path, fix=fix)
    source = ", as it states: " if not given else ", as given for "
    return moments, f"in {zone}" + (source + words if words else ""), []


def _of_things(rows: Sequence[TimedRow], table: Table) -> tuple[list[TimedRow], Notes]:
    """The rows in order of time, each thing's by its own clock; rows of one time are one."""
    groups: dict[str, list[TimedRow]] = {}
    for row in rows:
        groups.setdefault(table.things.get(row.number, ""), []).append(row)
    notes, merged = Notes(), dict[tuple[int, int], TimedRow]()
    for group in groups.values():
        ordered, about_order = in_clock_order(table.path, group, table.options.keep)
        notes += about_order
        repeats = Counter[int]()
        for row in ordered:
            key = row.time_ns, repeats[row.time_ns]
            repeats[row.time_ns] += 1
            if other := merged.get(key):
                row = row._replace(cells=[a or b for a, b in zip(other.cells, row.cells, strict=True)])
            merged[key] = row
    return [merged[key] for key in sorted(merged)], notes


def _reader(table: Table) -> Callable[[tzinfo | None], Times]:
    """Reads the times in a zone; raises `ConfigError` where they have no date and no option gives it."""
    options, texts = table.options, [table.time_text(row) for row in table.rows]
    is_timed = options.time_format or times.is_dated(texts[0]) or times.is_unix(texts[0])
    if table.kind == "moment" and not is_timed:
        return lambda zone: read_times(texts, zone)  # which names what is wrong with them
    is_start, is_date = options.start is not None, options.date is not None
    uses = {"moment": (), "clock": ("date", "start"), "count": ("start",)}[table.kind]
    idle = [Argument(name) for name in ("start", "date") if getattr(options, name) and name not in uses]
    if idle or (is_start and is_date):
        problem = "its times have dates" if table.kind == "moment" else "its times need one origin"
        raise ConfigError(problem, place=table.path, fix="omit " + (idle or [Argument("date")])[0])
    head = table.columns[table.time_at[0]].head
    unit_ns = counted_ns(options.time_format or head)
    if is_start and (unit_ns or table.kind == "clock"):
        return lambda zone: times.times_from_start(texts, read_times([f"{options.start}"], zone), unit_ns)
    if is_date:
        time_format = options.time_format and f"%Y-%m-%d {options.time_format}"
        days = times.times_on_days(texts, f"{options.date}")
        return lambda zone: read_times(days, zone, time_format)
    if table.kind == "count" and options.time_format == "d" and not is_start:
        dated = [times.spreadsheet_time(text) for text in texts]
        return lambda zone: read_times(dated, zone)
    if table.kind == "moment":
        return lambda zone: read_times(texts, zone, options.time_format)
    fixes = [Argument(name, table.dates.get(name)) for name in uses if not (is_start and name == "start")]
    fix = Sentence.listing(fixes)
    if table.kind == "count" and not unit_ns:
        fix = fix + ("; " if fixes else "") + Argument("time_format", "s") + " for its unit, ms, min or h"
        if not is_start:
            fix = fix + "; or " + Argument("time_format", "d") + " alone for a spreadsheet's days"
    text = "has times of day" if table.kind == "clock" else f"counts from {texts[0]}"
    raise MissingOptionsError(f"{text}, without a date", place=f"{table.path}, column {head!r}", fix=fix)


def _too_long(table: Table) -> dict[int, ConfigError]:
    """Rows with more cells than the header, in which no cell can be trusted to stand in its column.

    A header that ends in a separator names nothing there: digits below that may be a number's decimals.
    """
    table = table.long or table
    width = len(table.columns)
    named_width = max((at for at, column in enumerate(table.columns, start=1) if column.head), default=0)
    fix = "quote cells with a separator in them, and write decimals with points"
    return {
        place: ConfigError(f"it has {len(row.cells)} cells, the header {named_width}", fix=fix)
        for place, row in enumerate(table.rows)
        if any(row.cells[width:]) or any(cell.isdecimal() for cell in row.cells[named_width:])
    }


# --- columns and what they measure


class Channel(NamedTuple):
    """A column that is read: its place and label, what its numbers mean, whether they are averages.

    `unit_at` is the column with the unit of each row, -1 where the header or an option gives the unit;
    `component` is of radiation.
    """

    place: int
    label: str
    meaning: Meaning
    is_average: bool
    unit_at: int
    component: str = ""

    def value(self, cells: Sequence[str]) -> float:
        """The number of a row in the stream's unit; NaN without one."""
        meaning, number = self.meaning_in(cells), tables.number_of(tables.number_at(cells, self.place))
        return meaning.in_stream_unit(number) if meaning else math.nan

    def meaning_in(self, cells: Sequence[str]) -> Meaning | None:
        """Meaning of a row's number; None where its unit is of another quantity."""
        if self.unit_at < 0:
            return self.meaning
        written = tables.written_unit(cells, self.place, self.unit_at)
        if not written and self.unit_at == self.place:
            return self.meaning
        meaning = meaning_of(written, self.label) or unknown_meaning(written)
        return meaning if meaning.quantity == self.meaning.quantity else None


def _channels(table: Table) -> tuple[list[Channel], Notes]:
    """The columns asked for, or every column with numbers, and notes on what they are.

    The option gives the unit where the table has none; what it does not give is stored as it came, and so are
    extremes, sums and deviations, which are no samples of their quantity unless they are asked for.
    """
    unit = table.options.unit
    if unit and quantities.unit_of(unit) is None:
        fix = f"state one of the known units: {KNOWN_UNITS}"
        raise ConfigError("not a unit that is known", place=Argument("unit", unit), fix=fix)
    by_name = [tables.place_of(table.path, table.columns, name) for name in table.options.columns]
    channels: list[Channel] = []
    heads: dict[str, list[str]] = {"table": [], "option": [], "unknown": [], "process": []}
    for place in by_name or _free(table):
        column, (written, stated) = table.columns[place], _stated_unit(table, place)
        if not (by_name or stated or table.has_numbers(place)):
            continue
        option = meaning_of(unit, column.label)
        if by_name and written and option and stated != option:
            text = f"states the unit {written!r}, not {unit!r}"
            omit = "omit " + Argument("unit") + ", or the column"
            raise ConfigError(text, place=table.named(place), fix=omit)
        is_average = column.process in tables.AVERAGED
        is_sample = is_average or column.process in tables.SAMPLED
        meaning = (stated or (None if written else option)) if is_sample or by_name else None
        source = "unknown" if meaning is None else "table" if stated else "option"
        meaning = meaning or unknown_meaning(written)
        channels.append(Channel(place, column.label, meaning, is_average, column.unit_at))
        heads[source].append(column.head)
        heads["process"] += [f"{column.head} ({column.process})"] if by_name and not is_sample else []
    _refuse_open_units(table, channels, heads["option"])
    notes = _on_option("the unit", unit, heads["option"], heads["table"])
    if heads["unknown"]:
        text = f"stored as they came, and not used: {', '.join(heads['unknown'])}; known units: {KNOWN_UNITS}"
        notes.append((Severity.WARNING, text))
    if heads["process"]:
        text = f"neither samples nor averages, stamped as the table has them: {', '.join(heads['process'])}"
        notes.append((Severity.WARNING, text))
    return channels, notes


def _refuse_open_units(table: Table, channels: Sequence[Channel], heads: Sequence[str]) -> None:
    """Refuse columns without a unit, an option that may not be of all of them, or not of the table."""
    unit, about = table.options.unit, f" ({table.about})" if table.about else ""
    without = [channel for channel in channels if not channel.meaning.unit.shown]
    if without and (table.options.columns or len(without) == len(channels)):
        place = table.named(without[0].place) if table.options.columns else table.path
        fix = 'headers like "T1 [C]", or ' + Argument("unit") + f" of {KNOWN_UNITS} for the others"
        raise MissingOptionsError(f"no column has a unit{about}", place=place, fix=fix)
    option = meaning_of(unit)
    above = [meaning for word in table.units if (meaning := meaning_of(word))]
    other = [meaning.unit.shown for meaning in above if option and meaning.quantity == option.quantity]
    if heads and option and other and option not in above:
        fix = "omit " + Argument("unit") + f" {unit}, or give " + Argument("unit", other[0])
        raise ConfigError(
            f"states the unit {other[0]!r} above its header, not {unit!r}", place=table.path, fix=fix
        )
    kinds = {re.sub(r"[\W_][A-Za-z]$|[\W\d_]", "", tables.split_head(head)[0]).lower() for head in heads}
    if len(kinds) > 1 and not table.options.columns:
        columns = Sentence.listing([Argument("columns", head) for head in heads])
        text = f"{len(heads)} columns state no unit, and {unit} need not be that of all{about}"
        raise MissingOptionsError(text, place=table.path, fix=f"choose those of {unit} from " + columns)


def _components(table: Table, channels: Sequence[Channel]) -> tuple[list[Channel], Notes]:
    """The columns, those of radiation with the component that their name or the option gives, and notes.

    Raises `ConfigError` where the option cannot be of a column, or may be of several.
    """
    given, is_chosen = table.options.measures, bool(table.options.columns)
    measures = given if isinstance(given, Mapping) else {"": given}
    names = {channel.place: channel.label for channel in channels if channel.meaning.quantity.units == POWER}
    components = {place: component_named(label) for place, label in names.items()}
    stated = [names[place] for place, component in components.items() if component]
    unnamed = [place for place, component in components.items() if is_chosen or not component]
    if len(unnamed) > 1 and measures.get("") and not is_chosen:
        labels = ", ".join(names[place] for place in unnamed)
        fix = Argument("measures", {names[unnamed[0]]: measures[""]}) + ", and so each of the others"
        problem = f"{measures['']} may be what each of {labels} measures"
        raise MissingOptionsError(problem, place=table.path, fix=fix)
    by_option = dict.fromkeys(unnamed, measures[""]) if measures.get("") else {}
    by_option |= {tables.place_of(table.path, table.columns, key): measures[key] for key in measures if key}
    for place, component in by_option.items():
        own = components.get(place)
        if own not in ("", component) or not may_measure(names[place], component):
            text = f"states {own}, not {component}" if own else f"measures no {component}"
            fix = "omit " + Argument("measures") + ", or the column"
            raise ConfigError(text, place=table.named(place), fix=fix)
    notes = Notes()
    for component in dict.fromkeys(measures.values()):
        applied = [names[place] for place in by_option if by_option[place] == component]
        notes += _on_option("measures", component, applied, stated)
    components |= by_option
    return [one._replace(component=components.get(one.place, "")) for one in channels], notes


def _free(table: Table) -> list[int]:
    """The columns that may hold values, without those of fieldkit's own tables."""
    exported = set(range(len(table.columns))[-len(_EXPORTED) :]) if _flags_at(table) >= 0 else set()
    return [place for place in table.free if place not in exported]


def _stated_unit(table: Table, place: int) -> tuple[str, Meaning | None]:
    """The unit that the table states of a column, as written and what it means."""
    column = table.columns[place]
    if column.unit_at < 0:
        return column.unit, meaning_of(column.unit, column.label)
    units = ((tables.written_unit(row.cells, place, column.unit_at), row) for row in reversed(table.rows))
    cells = {unit: row.number for unit, row in units if unit}
    known = [(meaning, cell) for cell in cells if (meaning := meaning_of(cell, column.label))]
    meanings = {meaning.quantity.name: (meaning, cell) for meaning, cell in known}
    if len(meanings) > 1:
        several = " and ".join(f"{cell!r} (row {cells[cell]})" for _, cell in meanings.values())
        fix = "import the rows of each quantity on their own"
        raise ConfigError(f"has values in {several}", place=table.named(place), fix=fix)
    meaning, written = next(iter(meanings.values()), (None, next(iter(cells), "")))
    return written, meaning


class _Stream(NamedTuple):
    """A stream, the columns of its channels, and its rows."""

    info: StreamInfo
    channels: list[Channel]
    rows: Sequence[TimedRow]


def _streams(name: str, table: Table, channels: Sequence[Channel], rows: Sequence[TimedRow]) -> list[_Stream]:
    """A stream for each quantity, and one of its own for averages beside samples of it.

    A long table has rows of other quantities alone, which are none of a stream.
    """
    groups: dict[tuple[Quantity, bool], list[Channel]] = {}
    for channel in sorted(channels, key=lambda channel: channel.meaning.quantity.name == quantities.UNKNOWN):
        groups.setdefault((channel.meaning.quantity, channel.is_average), []).append(channel)
    streams: dict[str, _Stream] = {}
    for (quantity, is_average), ours in groups.items():
        suffix = "-mean" if is_average and (quantity, False) in groups else ""
        stream = name if len(groups) == 1 else f"{name}-{quantity.name}{suffix}"
        free = imported.free_name(stream, streams, "{}-{}")  # unknown quantities of several units
        has_cells = [any(cell_of(row.cells, channel.place) for channel in ours) for row in rows]
        own = list(compress(rows, has_cells)) if table.long else rows
        streams[free] = _Stream(_info(free, ours, own), ours, own)
    return list(streams.values())


def _info(name: str, channels: Sequence[Channel], rows: Sequence[TimedRow]) -> StreamInfo:
    labels, quantity = tuple(channel.label for channel in channels), channels[0].meaning.quantity
    measures = tuple(channel.component for channel in channels)
    rate_hz = imported.usual_rate_hz([row.time_ns for row in rows])
    raw_bytes = max((len(_raw(row)) for row in rows), default=1)
    return StreamInfo(
        name, quantity.name, quantity.units.stored, (len(labels),), channels=labels,
        measures=measures if any(measures) else (), rate_hz=rate_hz, driver="import", raw_bytes=raw_bytes,
    )  # fmt: skip


def _flags_at(table: Table) -> int:
    """The column of the flags in a table that fieldkit exported; -1 in any other."""
    labels = [column.label for column in table.columns]
    return labels.index("flags") if labels[-len(_EXPORTED) :] == [*_EXPORTED] else -1


def _readings(stream: _Stream, flags_at: int) -> Iterator[Reading]:
    time_ns = [row.time_ns for row in stream.rows]
    if stream.channels[0].is_average:
        time_ns = middles_ns(time_ns)
    for stamp, row in zip(time_ns, stream.rows, strict=True):
        values = tuple(channel.value(row.cells) for channel in stream.channels)
        flags = row.cells[flags_at] if flags_at >= 0 else ""
        quality = Quality(int(flags) & _ALL_FLAGS if flags.isdecimal() else 0)
        more = {"raw": _raw(row), "quality": quality, "device_seq": row.number}
        yield imported.imported_reading(stream.info.name, stamp, values, **more)


def _raw(row: TimedRow) -> bytes:
    return ",".join(row.cells).encode()[:_MOST_RAW]


def middles_ns(ends_ns: Sequence[int]) -> list[int]:
    """The middles of the intervals that end at these times, each at the end of the one before.

    An interval after a gap is as long as the one after it, or as is usual.
    """
    ends = np.array(ends_ns, np.int64)
    if ends.size < 2:
        return list(ends_ns)
    steps = np.diff(ends)
    before, after = np.append(steps[0], steps), np.append(steps, steps[-2:][0])
    after[0] = steps[:2][-1]
    long = 1.5 * np.median(steps)
    is_alone = (before > long) & (after > long) & ~np.isclose(before, after, rtol=0.1)
    length = np.where(before > long, np.minimum(before, after), before)
    return [int(middle) for middle in ends - np.where(is_alone, int(np.median(steps)), length) // 2]


# --- notes


def _on_end(table: Table) -> Notes:
    text = f"row {table.rows[-1].number} does not end its line: was the file cut off within its last number?"
    return [] if table.has_end else [(Severity.INFO, text)]


def _on_option(option: str, given: str, applied: Sequence[str], stated: Sequence[str]) -> Notes:
    """Columns that an option applies to: those that state nothing."""
    if not given:
        return []
    note = f"; stated by the table: {', '.join(stated)}" if stated else ""
    severity = Severity.INFO if applied else Severity.WARNING
    columns = listing(applied) if len(applied) > _MOST_LISTED else ", ".join(applied) or "no column"
    return [(severity, f"{option} {given} applies to {columns}{note}")]


def _on_cells(rows: Sequence[TimedRow], channels: Sequence[Channel]) -> Iterator[tuple[Severity, str]]:
    """Number of cells that are not numbers at all, or have a unit that is not known."""
    words, units = list[str](), list[str]()
    for row, channel in product(rows, channels):
        if cell := tables.number_at(row.cells, channel.place):
            words += [cell] if math.isnan(tables.number_of(cell)) and cell.lower() != "nan" else []
            if channel.meaning_in(row.cells) is None:
                units.append(f"{cell_of(row.cells, channel.unit_at)!r} (row {row.number})")
    if words:
        text = f"cells that are not numbers and have no value: {len(words)}, such as {words[0][:20]!r}"
        yield Severity.WARNING, text
    if units:
        yield Severity.WARNING, f"cells without a value for their unit: {len(units)}, {listing(units)}"


def _on_stream(stream: _Stream) -> Iterator[tuple[Severity, str]]:
    """Notes on what a stream of radiation does not state, and on averages that were moved."""
    info, labels = stream.info, ", ".join(stream.info.channels)
    if info.unit == POWER.stored and not info.measures:
        note = f"what {labels} measures is not known, so slopes cannot use it"
        fix = f"import it as global irradiance (ghi), or {how_to_state(info.name)}"
        yield Severity.WARNING, f"{note}: {fix}"
    if stream.channels[0].is_average and len(stream.rows) > 1:
        middle = f"in the middle of their interval of {1 / info.rate_hz:g} s, not at its end"
        yield Severity.INFO, f"averages of {labels} are stamped {middle}"
    elif stream.channels[0].is_average:
        end = "at the end of their interval, which one row does not show"
        yield Severity.WARNING, f"averages of {labels} are stamped {end}"


# --- cells


def _refuse_marks(table: Table, channels: Sequence[Channel]) -> None:
    """Refuse a mark in a number that may be of thousands or of decimals: which it is, is not guessed.

    Where commas part the columns that is a comma, elsewhere a point.
    """
    heads = {channel.place: table.columns[channel.place].head for channel in channels}
    cells = [(tables.number_at(row.cells, at), head) for row in table.rows for at, head in heads.items()]
    may_be_points = table.has_decimal_commas
    if may_be_points and _show_decimal_points([cell for cell, _ in cells]):
        return
    for cell, head in cells:
        has_comma = _WITH_COMMA.fullmatch(cell) and not tables.BY_COMMAS.fullmatch(cell)
        if _ANY_POINT.fullmatch(cell) if may_be_points else has_comma:
            problem = f"{cell!r} has a {'point' if may_be_points else 'comma'}, of thousands or of decimals"
            fix = "export it with commas between the columns, points as decimals, no marks of thousands"
            raise ConfigError(problem, place=f"{table.path}, column {head!r}", fix=fix)


def _refuse_without_numbers(table: Table, channels: Sequence[Channel]) -> None:
    """Refuse a column of cells that are no numbers, but for words that say that there is no value."""
    for channel in channels:
        cells = [cell for row in table.rows if (cell := tables.number_at(row.cells, channel.place))]
        words = [cell for cell in cells if not _NO_VALUE.fullmatch(cell)]
        if words and all(math.isnan(tables.number_of(cell)) for cell in words):
            others = [Argument("columns", other.label) for other in channels if other != channel]
            or_others = ", or import the others: " + Sentence.listing(others) if others else ""
            place, fix = table.named(channel.place), "write numbers as 1234.5"
            raise ConfigError(f"has no number, but {words[0][:20]!r}", place=place, fix=fix + or_others)


def _show_decimal_points(cells: Sequence[str]) -> bool:
    """True if some numbers show that points are of decimals, and none has a comma."""
    are_decimals = any(_DECIMAL_POINT.fullmatch(cell) and not _ANY_POINT.fullmatch(cell) for cell in cells)
    return are_decimals and not any("," in cell for cell in cells)
