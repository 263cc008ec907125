"""Opening a session: sealed, recovered, interrupted, or while it is being recorded.

Nothing is changed and nothing is read before it is asked for; samples come a block of frames at a
time. All times are as the active time map corrects them, unless those `recorded` are asked for;
estimates stay as they were computed.
"""

from __future__ import annotations

import contextlib
import heapq
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import cached_property, partial
from itertools import compress
from operator import itemgetter
from pathlib import Path
from typing import Any, Self, TypeVar

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray, FlagArray, IntArray
from fieldkit.model.clock import ClockCheck, utc_ns
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.learnt import Learnt
from fieldkit.model.marks import corrected_events, marks_now
from fieldkit.model.next_step import Action
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import Event, Health, Quality, Sample
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.spelling import did_you_mean
from fieldkit.phrases import Words
from fieldkit.sessions import entry_rows, layout, stored
from fieldkit.sessions.digests import object_digest
from fieldkit.sessions.journal import SessionIdentity
from fieldkit.sessions.lock import is_locked, journal_path, locked_within
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord
from fieldkit.sessions.stream_reader import Readings, StreamReader
from fieldkit.sessions.superblock import CHECK_PATH, BinaryFile, MendedFile, is_clean
from fieldkit.sessions.time_map import StoredTimes, TimeStep, corrections, mapped_event


def check_format(path: Path, file: h5py.File) -> None:
    """Raise `SessionError` where the file is not a session, `FormatError` for one of another version."""
    if attribute(file, "fieldkit_format") != layout.FORMAT_NAME:
        raise SessionError(Words("error.not_session"), place=path, fix=CHECK_PATH)
    layout.check_version(path, str(attribute(file, "fieldkit_format_version")))


def attribute(file: h5py.File, name: str) -> str | None:
    """A root attribute as text, or None where there is none."""
    value = file.attrs.get(name)
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def scalar(file: h5py.File, name: str) -> Any:
    """A single value of this very file; raises `SessionError` where there is none or a hostile one."""
    dataset = stored.stored_here(file, name)
    if not isinstance(dataset, h5py.Dataset) or dataset.shape != ():
        raise SessionError(f"{name} is missing", place=file.filename)
    stored.check_size(dataset)
    return dataset[()]


def text(file: h5py.File, name: str) -> str:
    """A single text of this very file; raises `SessionError` where there is none or a hostile one."""
    if not isinstance(value := scalar(file, name), bytes):
        raise SessionError("is no text", place=name)
    return layout.decode_text(value)


def header_of(file: h5py.File) -> layout.SessionHeader:
    """Header declared when the recording began; raises `SessionError` where it is damaged."""
    return layout.SessionHeader.from_json(text(file, "config/header"))


log: logging.Logger = logging.getLogger(__name__)

_MEANING = ("config/header", "entry/utc_minus_mono_ns")
_CHANGED = "%s: %s changed after it was sealed; times, places and scales may be wrong: check it"


class SessionReader:
    """One recording, as `fieldkit.open_session` opens it. Use as a context manager, or call `close`.

    ``session["camera"]`` is one of its streams, ``list(session)`` their names.

    Attributes
    ----------
    path : Path
        The session file.
    state : str
        "recording" until it is sealed, "interrupted" (its writer ended without sealing it: `fieldkit
        recover`), "recovered" or "sealed".
    streams : Mapping of str to StreamInfo
        What was declared of each stream before its first sample.
    site : Site
        Where it was recorded.
    """

    _is_outline = False

    def __init__(self, path: Path, file: h5py.File, state: str, *, salvage: bool = False) -> None:
        self.path = path
        self.state = state
        self.header: layout.SessionHeader = header_of(file)
        self.anchor_ns: int = int(scalar(file, "entry/utc_minus_mono_ns"))
        self._handle = file
        self._salvage = salvage
        self.site: Site = self.header.site
        self.streams: Mapping[str, StreamInfo] = {info.name: info for info in self.header.streams}
        self.session_id: str = str(attribute(file, "session_id"))
        self._times = StoredTimes(path, file, self.anchor_ns)
        self._readers = {
            name: StreamReader(file, info, self.site, self._times, salvage=salvage, outline=self._is_outline)
            for name, info in self.streams.items()
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __contains__(self, stream: object) -> bool:
        return stream in self.streams

    def __iter__(self) -> Iterator[str]:
        return iter(self.streams)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        if self._handle:
            self._handle.close()

    @property
    def was_finished(self) -> bool:
        """True if the file itself says that it was sealed or recovered, whatever became of it since."""
        return int(scalar(self._file, "entry/complete")) != layout.RECORDING

    @property
    def is_closed(self) -> bool:
        """True if it can be read no more."""
        return not self._handle

    def require_open(self) -> None:
        """Raise `SessionError` where it is closed."""
        if self.is_closed:
            raise stored.closed_error(self.path)

    @property
    def _file(self) -> h5py.File:
        self.require_open()
        return self._handle

    def refresh(self) -> None:
        """Read what a running recording has added since."""
        for reader in self._readers.values():
            reader.refresh()
        for name in self.tables:
            for dataset in self._table_datasets(name).values():
                dataset.refresh()

    def require_finished(self) -> None:
        """Raise `SessionError` where its journal may still hold samples missing from the file."""
        self.require_open()
        if self.state not in ("sealed", "recovered"):
            fix = Action.STOP() if self.state == "recording" else Action.RECOVER(self.path)
            raise SessionError(f"its journal may hold more ({self.state})", place=self.path, fix=fix)

    # --- what was declared

    @property
    def identity(self) -> SessionIdentity:
        """Head of the journal of this session; where its start cannot be read, that of the first sample."""
        try:
            start_ns = utc_ns(datetime.fromisoformat(text(self._file, "entry/start_time")))
        except (SessionError, ValueError):
            start_ns = self.start_ns
        return SessionIdentity(self.session_id, start_ns, self.anchor_ns, self.header)

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions with their latest outlines, removed ones included."""
        latest = {record.region.name: record.region for record in self.region_history(recorded=True)}
        return tuple(latest.values()) or self.header.regions

    @property
    def region_schedule(self) -> RegionSchedule:
        """The regions with the minutes in which they hold, as they were changed during the recording.

        Times are as the active time map corrects them.
        """
        at_start, changes = self._drawn_and_changed()
        schedule = RegionSchedule.of([record.region for record in at_start] or self.header.regions)
        for record in changes:
            schedule = schedule.with_record(record)
        return schedule

    @property
    def config_toml(self) -> str:
        """The configuration as it was used."""
        return self.header.config_toml

    @property
    def provenance(self) -> dict[str, str]:
        """Provenance of the file: fieldkit, packages, platform, command line."""
        root = ("fieldkit_version", "h5py_version", "hdf5_version", "history")
        config = ("command_line", "packages", "platform")
        with self._explaining():
            return {
                **{name: str(attribute(self._file, name)) for name in root},
                **{name: text(self._file, f"config/{name}") for name in config},
            }

    # --- samples

    def count(self, stream: str) -> int:
        """Number of samples of a stream that are stored."""
        return len(self.stream(stream))

    def stream(self, name: str) -> StreamReader:
        """The stored rows of a stream, column by column; raises `SessionError` if there is none."""
        self.require_open()
        if name not in self._readers:
            fix = did_you_mean(str(name), self._readers)
            raise SessionError(f"no stream {name!r}", place=self.path, fix=fix)
        return self._readers[name]

    def samples(self, *streams: str, recorded: bool = False) -> Iterator[Sample]:
        """The samples of the streams named (all if none is), by monotonic time, a block of frames at a time.

        Their `time_ns` is corrected by the active time map, unless `recorded` asks for it as stored.
        """
        readers = [self.stream(name) for name in streams or self.streams]
        parts = (_with_merge_time(reader.samples(recorded=recorded)) for reader in readers)
        return (sample for _, sample in heapq.merge(*parts, key=itemgetter(0)))

    @property
    def start_ns(self) -> int:
        """UTC of the first sample, corrected by the active time map; 0 where there is none."""
        return min((int(reader.time_ns(0, 1)[0]) for reader in self._nonempty()), default=0)

    @property
    def end_ns(self) -> int:
        """UTC of the last sample, corrected by the active time map; 0 where there is none."""
        return max((int(reader.time_ns(len(reader) - 1)[0]) for reader in self._nonempty()), default=0)

    def _nonempty(self) -> list[StreamReader]:
        self.require_open()
        return [reader for reader in self._readers.values() if len(reader)]

    # --- samples as arrays and tables

    def times_ns(self, stream: str) -> IntArray:
        """UTC of a stream's samples, corrected by the active time map."""
        return self.stream(stream).time_ns()

    def flags(self, stream: str) -> FlagArray:
        """`Quality` of a stream's samples, each compared with its checksum, which reads all that it holds."""
        return self.stream(stream).flags()

    def readings(self, meter: str, *, recorded: bool = False) -> Readings:
        """The readings of a meter as arrays, at corrected times, or with `recorded` at those stored."""
        return self.stream(meter).readings(recorded=recorded)

    def raw(self, camera: str) -> h5py.Dataset:
        """The counts of a camera as stored, (n, rows, cols) uint16, read where they are sliced.

        They are compared with no checksum: `flags` has the frames that do not match theirs.
        """
        return self.stream(camera).counts

    @property
    def damaged(self) -> dict[str, int]:
        """Number of samples, by stream, that did not match their checksum, among those read so far."""
        return {name: len(reader.damaged) for name, reader in self._readers.items() if reader.damaged}

    def columns_are_sealed(self, stream: str) -> bool:
        """True if a stream's columns, all but its frames, are those that were sealed.

        False also of a session whose seal is damaged.
        """
        self.require_open()
        if self.state not in ("sealed", "recovered"):
            return False
        try:
            sealed = self.sealed_objects()
            paths = [f"{stream}/{column.name}" for column in layout.stream_columns(self.streams[stream])]
            return all(sealed.get(path) == self.object_digest(path) for path in paths)
        except (SessionError, OSError, RuntimeError, KeyError):
            return False

    # --- tables: everything but samples

    def events(self, *, recorded: bool = False) -> list[Event]:
        """Events of the recording, in the order they were detected, with marks as corrected since.

        With `recorded` all marks as they were made, and the corrections of marks as events of their own.
        """
        events = [*entry_rows.events_from(self.timed_table("events", recorded=True)), *self._later_events()]
        if recorded:
            return events
        return [mapped_event(self.time_map(), event) for event in corrected_events(events)]

    def marks(self) -> dict[int, Event]:
        """The marks by their numbers, as corrected since; those taken back are omitted."""
        marks = marks_now(self.events(recorded=True))
        return {number: mapped_event(self.time_map(), mark) for number, mark in marks.items()}

    @property
    def has_corrected_marks(self) -> bool:
        """True if marks were taken back or edited, while recording or since."""
        return any("corrects" in event.data for event in self.events(recorded=True))

    def _later_events(self) -> list[Event]:
        """Events added since the session was finished, with times as recorded."""
        if stored.link_of(self._file, layout.LATER_EVENTS) is None:
            return []
        with self._explaining():
            columns = corrections(self.group(layout.LATER_EVENTS), layout.LATER_EVENT_COLUMNS)
        time_ns = self._times.utc_ns(columns["time"], columns["mono_ns"], recorded=True)
        return entry_rows.events_from({**columns, "time_ns": time_ns})

    def health(self, *, recorded: bool = False) -> list[Health]:
        """Health of the recording, once a second."""
        return entry_rows.health_from(self.timed_table("health", recorded=recorded), tuple(self.streams))

    def clock_checks(self) -> list[ClockCheck]:
        """Comparisons of the clocks, none of them applied."""
        return entry_rows.clock_checks_from(self.table("clock"))

    def region_history(self, *, recorded: bool = False) -> list[RegionRecord]:
        """Every outline of every region and since when it holds."""
        return entry_rows.regions_from(self.timed_table("regions", recorded=recorded))

    def region_changes(self) -> list[RegionRecord]:
        """Changes of the regions during the recording, in order."""
        return self._drawn_and_changed()[1]

    def _drawn_and_changed(self) -> tuple[list[RegionRecord], list[RegionRecord]]:
        """The regions as the recording began, and their changes during it."""
        table = self.timed_table("regions")
        recorded_ns = self._times.utc_ns(table["time"], table.get("mono_ns"), recorded=True)
        is_change = recorded_ns > self.identity.start_ns
        history = entry_rows.regions_from(table)
        return list(compress(history, ~is_change)), list(compress(history, is_change))

    def estimates(self, *, recorded: bool = False) -> list[SlopeEstimate]:
        """The slopes as they were estimated while recording, in order of time."""
        return entry_rows.estimates_from(self.timed_table("estimates", recorded=recorded))

    def learnt(self, *, recorded: bool = False) -> dict[int, Learnt]:
        """Parameters learnt while recording, by the UTC nanoseconds of each minute that has it."""
        return entry_rows.learnt_from(self.timed_table("learnt", recorded=recorded), self.header.region_names)

    def irradiance(self) -> dict[str, AnyArray]:
        """Direct irradiance as derived while recording: `time_ns`, `irradiance_w_m2`, `flags`, `model`."""
        table = self.timed_table("irradiance")
        models = np.array([layout.decode_text(model) for model in table["model"]], dtype=object)
        times = {"time_ns": table["time_ns"], "irradiance_w_m2": table["value"]}
        return {**times, "flags": table["flags"], "model": models}

    def time_map(self) -> list[TimeStep]:
        """The active corrections of the clock, written afterwards; usually none."""
        self.require_open()
        return list(self._times.steps)

    @property
    def missing_corrections(self) -> dict[str, int]:
        """Number of rows by group that were added since the seal and are gone."""
        steps, events = len(self.group("time_map")["time"]), len(self._later_events())
        there = {"time_map": steps, layout.LATER_EVENTS: events}
        added = {name: int(self._file.attrs.get(layout.added_rows(name), 0)) for name in there}
        return {name: added[name] - count for name, count in there.items() if added[name] > count}

    def sealed_objects(self) -> dict[str, str]:
        """Digests of the file's objects by their paths, as sealed."""
        with self._explaining():
            texts = (stored.texts_of(self._file, f"integrity/{name}") for name in ("object", "object_sha256"))
            return dict(zip(*texts, strict=True))

    def object_digest(self, path: str) -> str:
        """The digest of an object as it is now; see `fieldkit.sessions.digests`."""
        return object_digest(self._file, path)

    def minutes(self, *, recorded: bool = False) -> list[MinuteRecord]:
        """The estimates made while recording, minute by minute."""
        table, learnt = self.timed_table("irradiance", recorded=recorded), self.learnt(recorded=recorded)
        return entry_rows.minutes_from(table, self.estimates(recorded=recorded), learnt)

    def entries(self) -> list[Entry]:
        """Everything but samples, as recorded: regions, events, clock comparisons, health, minutes."""
        return [entry for read in entry_readers(self) for entry in read()]

    def group(self, name: str) -> h5py.Group:
        """The HDF5 group of a stream or table, as it is."""
        with self._explaining():
            return stored.group_of(self._file, name)

    def datasets(self, name: str) -> dict[str, h5py.Dataset]:
        """The datasets of the group of a stream or table, those of a newer version among them.

        Raises `SessionError` where one of them does not lie in this file.
        """
        group = self.group(name)
        with self._explaining():
            nodes = {name: stored.stored_here(group, name) for name in group}
            return {name: node for name, node in nodes.items() if isinstance(node, h5py.Dataset)}

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        """Errors found while reading, with the session and the next step."""
        try:
            yield
        except SessionError as error:
            raise stored.explain(self.path, error) from error

    def table(self, name: str, *columns: str) -> dict[str, AnyArray]:
        """The columns of a table of entries as stored, or those named; as many rows as all of them have."""
        declared = [column for column in self._columns[name] if not columns or column.name in columns]
        datasets = self._table_datasets(name, declared)
        length = min((dataset.shape[0] for dataset in datasets.values()), default=0)
        if self._salvage:
            length = self._whole(datasets, length)
        with self._explaining():
            return {
                column.name: datasets[column.name][:length]
                if column.name in datasets
                else stored.unknown_rows(self._file, column, length)
                for column in declared
            }

    def _table_datasets(self, name: str, columns: Iterable[layout.Column] = ()) -> dict[str, h5py.Dataset]:
        """The columns of a table that the file has; none where it is of a version without that table."""
        with self._explaining():
            if not stored.was_made(self._file, name):
                return {}
            group = stored.group_of(self._file, name)
            return stored.columns_of(group, columns or self._columns[name], salvage=self._salvage)

    def timed_table(self, name: str, *, recorded: bool = False) -> dict[str, AnyArray]:
        """A table with its times in UTC nanoseconds beside those stored: `time_ns`, `window_start_ns`."""
        table = self.table(name)
        for column in [column.name for column in self._columns[name] if column.is_time]:
            mono_ns = table.get("mono_ns") if column == "time" else None
            table[f"{column}_ns"] = self._times.utc_ns(table[column], mono_ns, recorded=recorded)
        return table

    def _whole(self, columns: Mapping[str, h5py.Dataset], length: int) -> int:
        """Rows up to the first of which something is not in a file that may have lost its end."""
        end = self.path.stat().st_size
        for dataset in columns.values():
            rows = stored.whole_rows(dataset, end)
            length = min(length, int(np.argmin(np.append(rows, -1) == np.arange(len(rows) + 1))))
        return length

    @cached_property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables of entries."""
        return tuple(self._columns)

    @cached_property
    def _columns(self) -> dict[str, Any]:
        return layout.entry_columns(self.header)


class SessionOutline(SessionReader):
    """A session of which only what a list of many shows is read: its header, times, tables.

    Nothing is compared with what was sealed, and samples cannot be read.
    """

    _is_outline = True

    @property
    def written_by(self) -> str:
        """Version of fieldkit that recorded it."""
        return str(attribute(self._file, "fieldkit_version"))


def entry_readers(session: SessionReader) -> tuple[Callable[[], Sequence[Entry]], ...]:
    """What reads the entries of each kind, as recorded."""
    timed = session.region_history, session.events, session.health, session.minutes
    regions, events, health, minutes = (partial(read, recorded=True) for read in timed)
    return regions, events, session.clock_checks, health, minutes


def _with_merge_time(samples: Iterable[Sample]) -> Iterator[tuple[int, Sample]]:
    """Samples with the monotonic times by which streams are merged: of a damaged one, that of the one before.

    Its own may be years away, and all of its stream would wait for the other streams to end.
    """
    merge_ns = 0
    for sample in samples:
        if not sample.quality & Quality.BAD_CRC:
            merge_ns = sample.mono_ns
        yield merge_ns, sample


def open_session(path: str | Path) -> SessionReader:
    """Open a session for reading, also while it is recorded or after a crash.

    Parameters
    ----------
    path : str or Path
        The session file, ``NAME.h5``.

    Returns
    -------
    SessionReader
        Open until it is closed; best used in a ``with`` statement.

    Raises
    ------
    SessionError
        The path holds no session, one of another version (`FormatError`), or one too damaged to read; the
        error's `fix` is the next step.

    Examples
    --------
    >>> with open_session("recordings/20261211T025512Z-three-beds.h5") as session:  # doctest: +SKIP
    ...     frames = session["camera"].kelvin(0, 10)
    ...     lux = session["lux"].to_pandas()
    """
    return open_as(SessionReader, path)


S = TypeVar("S", bound=SessionReader)

BEGUN_WITHIN_S = 10.0
"""From the lock of a new session until its file can be read: a second, more on a busy computer."""


FILE_OBJECT = Path("file object")
"""In place of the folder of a session that was opened from a file object."""


def open_as(kind: type[S], path: str | Path | BinaryFile) -> S:
    """Open a session as an object of a class that extends `SessionReader`; raises as `open_session`.

    A recording begins with its journal: its file is waited for.
    """
    if not isinstance(path, str | Path):
        mended, name = partial(MendedFile, file=path), getattr(path, "path", getattr(path, "name", "session"))
        place = FILE_OBJECT / Path(str(name)).name
        return _open_file(kind, place, lambda: h5py.File(mended(place), "r"))
    path = Path(path)
    while True:
        try:
            return _open_as(kind, path)
        except SessionError:
            if not locked_within(journal_path(path), BEGUN_WITHIN_S):
                raise
        time.sleep(0.02)


def _open_as(kind: type[S], path: Path) -> S:
    # before the file is opened: a writer that releases the lock in between has sealed it
    is_written = is_locked(journal_path(path))
    try:
        is_closed = is_clean(path)
    except SessionError as error:
        fix = Action.RECOVER(path) if journal_path(path).exists() and not is_written else error.fix
        raise SessionError(error.problem, place=error.place, fix=fix) from error
    if is_closed:
        unfinished = "recording" if is_written else "interrupted"  # to compare it may take minutes
        return _open_file(kind, path, lambda: h5py.File(path, "r"), unfinished=unfinished)
    if is_written:
        return _open_file(kind, path, lambda: h5py.File(path, "r", swmr=True), "recording")
    return _open_file(kind, path, lambda: h5py.File(MendedFile(path), "r"), "interrupted")


def open_interrupted(path: Path, *, salvage: bool = False) -> SessionReader:
    """Open a session that is no longer written, whatever state its writer left it in.

    Never in SWMR mode, in which HDF5 would wait for the writer to mend what is torn. With `salvage`
    also where a part of the file is gone.
    """
    return _open_file(
        SessionReader, path, lambda: h5py.File(MendedFile(path), "r"), "interrupted", salvage=salvage
    )


def _open_file(
    kind: type[S], path: Path, opened: Callable[[], h5py.File], state: str | None = None, *,
    unfinished: str = "interrupted", salvage: bool = False,
) -> S:  # fmt: skip
    """A session in a given `state`, or that of the file: complete, or else `unfinished`."""
    file = None
    try:
        file = opened()
        check_format(path, file)
        complete = int(scalar(file, "entry/complete"))
        stored_state = {layout.SEALED: "sealed", layout.RECOVERED: "recovered"}.get(complete, unfinished)
        session = kind(path, file, state or stored_state, salvage=salvage)
    except (SessionError, OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if file is not None:
            file.close()
        raise stored.explain(path, error) from error
    if session.state in ("sealed", "recovered") and kind is not SessionOutline:
        _warn_where_changed(session)
    return session


def _warn_where_changed(session: SessionReader) -> None:
    """Warn where what all numbers depend on is not as it was sealed; `check` looks at all the rest."""
    with contextlib.suppress(SessionError, OSError, RuntimeError, KeyError, ValueError):
        sealed = session.sealed_objects()
        changed = [path for path in _MEANING if session.object_digest(path) != sealed[path]]
        if changed:
            log.warning(_CHANGED, session.path, " and ".join(changed))
