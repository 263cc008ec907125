"""Opening a session: sealed, recovered, interrupted, or while it is being recorded.

Nothing is changed and nothing is read before it is asked for; samples come a brick at a
time. Times are as they were recorded; `clock_checks` and `time_map` tell what is known
about them since.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.clock import ClockCheck
from fieldkit.device import StreamInfo
from fieldkit.errors import SessionError
from fieldkit.samples import Event, Health, Quality, Sample
from fieldkit.sessions import analysis, tables
from fieldkit.sessions.analysis import RegionSeries
from fieldkit.sessions.declared import attribute, check_format, explained, header_of, scalar
from fieldkit.sessions.journal import Identity
from fieldkit.sessions.layout import (
    INTEGRITY_COLUMNS,
    RECOVERED,
    SEALED,
    TIME_MAP_COLUMNS,
    Column,
    decode_text,
    entry_columns,
    exact_time_ns,
    journal_path,
)
from fieldkit.sessions.lock import is_locked
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord
from fieldkit.sessions.stream_reader import StreamReader, column_dataset, stored_here, whole_rows
from fieldkit.sessions.superblock import MendedFile, is_clean
from fieldkit.sessions.time_map import TimeStep, mapped, mapped_ns
from fieldkit.site import Region, Site
from fieldkit.slope import SlopeEstimate

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Session:
    """One recording. Use as a context manager, or call `close`.

    `state` is "recording", "interrupted" (its writer ended without sealing: `fieldkit
    recover`), "recovered" or "sealed". With `salvage` what the file has lost is left out of its tables.
    """

    def __init__(self, path: Path, file: h5py.File, state: str, *, salvage: bool = False) -> None:
        self.path = path
        self.state = state
        self._salvage = salvage
        self._file = file
        self.header = header_of(path, file)
        self.site: Site = self.header.site
        self.streams: Mapping[str, StreamInfo] = {info.name: info for info in self.header.streams}
        self.session_id = str(attribute(file, "session_id"))
        self.anchor_ns = int(scalar(file, "entry/utc_minus_mono_ns"))
        self._readers = {
            name: StreamReader(file, info, self.anchor_ns, salvage=salvage)
            for name, info in self.streams.items()
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if self._file:
            self._file.close()

    def refresh(self) -> None:
        """See what a living writer has added since."""
        for reader in self._readers.values():
            reader.refresh()
        for name, columns in entry_columns(self.header).items():
            for column in columns:
                self.group(name)[column.name].refresh()

    # --- what was declared

    @property
    def identity(self) -> Identity:
        """Whose journal this session's is."""
        start = datetime.fromisoformat(decode_text(scalar(self._file, "entry/start_time")))
        start_us = (start - datetime.fromtimestamp(0, UTC)) // timedelta(microseconds=1)
        return Identity(self.session_id, start_us * 1000, self.anchor_ns, self.header)

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions as they were drawn last."""
        drawn = {record.region.name: record.region for record in self.region_history()}
        return tuple(drawn.values()) or self.header.regions

    @property
    def config_toml(self) -> str:
        """The configuration as it was used."""
        return self.header.config_toml

    @property
    def provenance(self) -> dict[str, str]:
        """What wrote the file: fieldkit, packages, platform, command line."""
        root = ("fieldkit_version", "h5py_version", "hdf5_version", "history")
        config = ("command_line", "packages", "platform")
        return {
            **{name: str(attribute(self._file, name)) for name in root},
            **{name: decode_text(scalar(self._file, f"config/{name}")) for name in config},
        }

    # --- samples

    def count(self, stream: str) -> int:
        """How many samples of a stream are stored."""
        return len(self._reader(stream))

    def stream(self, name: str) -> StreamReader:
        """One stream, for reading columns or single frames; raises `SessionError` if there is none."""
        return self._reader(name)

    def samples(self, *streams: str) -> Iterator[Sample]:
        """The samples of the streams named (all if none is), by monotonic time, a brick at a time.

        Their `time_ns` is as recorded, or as the time map in force corrects it.
        """
        names = streams or tuple(self.streams)
        steps = self.time_map()
        if steps:
            return (mapped(steps, sample) for sample in self._recorded(names))
        return self._recorded(names)

    def _recorded(self, names: tuple[str, ...]) -> Iterator[Sample]:
        return heapq.merge(
            *(self._reader(name).samples() for name in names), key=lambda sample: sample.mono_ns
        )

    @property
    def start_ns(self) -> int:
        """UTC of the first sample; 0 where there is none."""
        return min(
            (int(reader.time_ns(0, 1)[0]) for reader in self._readers.values() if len(reader)), default=0
        )

    @property
    def end_ns(self) -> int:
        """UTC of the last sample; 0 where there is none."""
        readers = [reader for reader in self._readers.values() if len(reader)]
        return max((int(reader.time_ns(len(reader) - 1)[0]) for reader in readers), default=0)

    def _reader(self, name: str) -> StreamReader:
        if name not in self._readers:
            raise SessionError(
                f"{self.path} has no stream {name!r}", fix=f"it has {', '.join(self._readers)}"
            )
        return self._readers[name]

    # --- samples as arrays and tables

    def times_ns(self, stream: str) -> NDArray[np.int64]:
        """UTC of a stream's samples, corrected by the time map in force."""
        reader = self._reader(stream)
        return mapped_ns(self.time_map(), reader.column("mono_ns"), reader.time_ns())

    def raw(self, camera: str) -> h5py.Dataset:
        """The counts of a camera, (n, rows, cols) uint16, read where they are sliced."""
        return self._reader(camera).counts

    def kelvin(self, start: int = 0, stop: int | None = None, **options: Any) -> NDArray[np.float64]:
        """Pictures as brightness temperatures; see `fieldkit.sessions.analysis.kelvin`."""
        return analysis.kelvin(self, start, stop, **options)

    def region_series(self, regions: Sequence[Region] | None = None, **options: Any) -> RegionSeries:
        """Curves of regions; see `fieldkit.sessions.analysis.region_series`."""
        return analysis.region_series(self, regions, **options)

    def to_pandas(self, stream: str) -> pd.DataFrame:
        """A stream as a table by UTC; see `fieldkit.sessions.analysis.to_pandas`."""
        return analysis.to_pandas(self, stream)

    def to_xarray(self, stream: str) -> xr.Dataset:
        """A stream as an xarray dataset; see `fieldkit.sessions.analysis.to_xarray`."""
        return analysis.to_xarray(self, stream)

    # --- entries

    def events(self) -> list[Event]:
        """What happened, in the order it was noticed."""
        table = self.table("events")
        return tables.events_from(table, self._exact(table))

    def health(self) -> list[Health]:
        """How the recording was doing, second by second."""
        table = self.table("health")
        return tables.health_from(table, self._exact(table), tuple(self.streams))

    def clock_checks(self) -> list[ClockCheck]:
        """Comparisons of the clocks, none of them applied."""
        return tables.clock_checks_from(self.table("clock"))

    def region_history(self) -> list[RegionRecord]:
        """Every outline of every region and since when it holds."""
        return tables.regions_from(self.table("regions"))

    def estimates(self) -> list[SlopeEstimate]:
        """The slopes as they were estimated while recording."""
        return tables.estimates_from(self.table("estimates"), self.header.region_names)

    def irradiance(self) -> dict[str, NDArray[Any]]:
        """Direct irradiance as derived while recording: `time_ns`, `irradiance_w_m2`, `flags`, `model`."""
        table = self.table("irradiance")
        models = np.array([decode_text(model) for model in table["model"]], dtype=object)
        time_ns = table["time"] * 1000
        return {
            "time_ns": time_ns,
            "irradiance_w_m2": table["value"],
            "flags": table["flags"],
            "model": models,
        }

    def time_map(self) -> list[TimeStep]:
        """The corrections of the clock in force, written afterwards; usually none."""
        with self._explaining():
            group = self.group("time_map")
            columns = {column.name: column_dataset(group, column)[:] for column in TIME_MAP_COLUMNS}
        newest = columns["version"].max(initial=0)
        rows = zip(*(columns[name] for name in ("version", "mono_ns", "add_ns", "reason")), strict=False)
        return [TimeStep(int(m), int(a), decode_text(r)) for v, m, a, r in rows if v == newest]

    def integrity(self) -> dict[str, NDArray[Any]]:
        """What was written down when the session was sealed, per stream and per table."""
        columns = (*INTEGRITY_COLUMNS, Column("table_crc32", "<u4"))
        with self._explaining():
            group = self.group("integrity")
            return {column.name: column_dataset(group, column)[:] for column in columns}

    def minutes(self) -> list[MinuteRecord]:
        """What the estimator said while recording, minute by minute."""
        table, said = self.table("irradiance"), self.estimates()
        by_time: dict[int, list[SlopeEstimate]] = {}
        for estimate in said:
            by_time.setdefault(estimate.time_ns, []).append(estimate)
        rows = zip(table["time"], table["value"], table["model"], table["flags"], strict=True)
        return [
            MinuteRecord(
                int(time) * 1000, tuple(by_time.get(int(time) * 1000, ())), float(value),
                decode_text(model), Quality(int(flags)),
            )
            for time, value, model, flags in rows
        ]  # fmt: skip

    def entries(self) -> list[Entry]:
        """Everything that is no sample: regions, events, clock comparisons, health, minutes."""
        kinds = (self.region_history, self.events, self.clock_checks, self.health, self.minutes)
        return [entry for kind in kinds for entry in kind()]

    def group(self, name: str) -> h5py.Group:
        """The HDF5 group of a stream or table, as it is."""
        with self._explaining():
            group = stored_here(self._file, name)
            if not isinstance(group, h5py.Group):
                raise SessionError(f"the group {name} is missing")
            return group

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        """What is found wrong while reading names the session, and what to do next."""
        try:
            yield
        except SessionError as error:
            raise explained(self.path, error) from error

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """The columns of a table of entries as stored, as many rows as all of them have.

        What an older version of the format has not is unknown: the fill value.
        """
        group = self.group(name)
        known = [column for column in self._columns[name] if column.name in group]
        with self._explaining():
            columns = {column.name: column_dataset(group, column, salvage=self._salvage) for column in known}
        length = min((dataset.shape[0] for dataset in columns.values()), default=0)
        if self._salvage:
            length = self._whole(name, columns, length)
        return {
            column.name: columns[column.name][:length] if column.name in columns else column.unknown(length)
            for column in self._columns[name]
        }

    def _whole(self, name: str, columns: Mapping[str, h5py.Dataset], length: int) -> int:
        """Rows up to the first of which something is not in a file that may have lost its end."""
        end = self.path.stat().st_size
        for column in self._columns[name]:
            if column.name in columns:
                rows = whole_rows(columns[column.name], column.row_bytes, end)
                length = min(length, int(np.argmin(np.append(rows, -1) == np.arange(len(rows) + 1))))
        return length

    @cached_property
    def _columns(self) -> dict[str, Any]:
        return entry_columns(self.header)

    def _exact(self, table: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
        return exact_time_ns(table["time"], table["mono_ns"], self.anchor_ns)


def open_session(path: str | Path) -> Session:
    """Open a session for reading.

    Raises `SessionError` where the path holds no session, one of a newer version, or one
    too damaged to read; `fix` says what to do.
    """
    path = Path(path)
    if _is_closed(path):
        return _session(path, lambda: h5py.File(path, "r"))
    if is_locked(journal_path(path)):
        return _session(path, lambda: h5py.File(path, "r", swmr=True), "recording")
    return open_interrupted(path)


def _is_closed(path: Path) -> bool:
    try:
        return is_clean(path)
    except SessionError as error:
        waits = journal_path(path).exists() and not is_locked(journal_path(path))
        raise SessionError(error.message, fix=f"fieldkit recover {path}" if waits else error.fix) from error


def open_interrupted(path: Path, *, salvage: bool = False) -> Session:
    """Open a session that nobody writes any more, whatever state its writer left it in.

    Never in SWMR mode, in which HDF5 would wait for the writer to mend what is torn. With `salvage`
    also where a part of the file is gone.
    """
    return _session(path, lambda: h5py.File(MendedFile(path), "r"), "interrupted", salvage=salvage)


def _session(
    path: Path, opened: Callable[[], h5py.File], state: str | None = None, *, salvage: bool = False
) -> Session:
    file = None
    try:
        file = opened()
        check_format(path, file)
        complete = int(scalar(file, "entry/complete"))
        found = {SEALED: "sealed", RECOVERED: "recovered"}.get(complete, "interrupted")
        return Session(path, file, state or found, salvage=salvage)
    except (SessionError, OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if file is not None:
            file.close()
        raise explained(path, error) from error
