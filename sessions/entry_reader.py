"""The tables of a session: all that is no sample.

Times are as they were recorded; those of events and health follow the time map in force, unless they
are asked for as `recorded`. A table is as long as the shortest of its columns; in a file that lost its
end, as long as its bytes go.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, Health, Quality
from fieldkit.model.slope import SlopeEstimate
from fieldkit.sessions import tables
from fieldkit.sessions.declared import attribute, explained, header_of, scalar
from fieldkit.sessions.digests import object_digest
from fieldkit.sessions.layout import (
    INTEGRITY_COLUMNS,
    TIME_MAP_COLUMNS,
    Column,
    decode_text,
    entry_columns,
    exact_time_ns,
)
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord
from fieldkit.sessions.stored import (
    check_size,
    column_dataset,
    columns_of,
    link_of,
    members,
    stored_here,
    whole_rows,
)
from fieldkit.sessions.time_map import TimeStep, check_rows, mapped_event, mapped_health


class EntryReader:
    """Reads the entries of an open session file; with `salvage` what the file has lost is left out."""

    def __init__(self, path: Path, file: h5py.File, *, salvage: bool = False) -> None:
        self.path = path
        self.header = header_of(file)
        self.anchor_ns = int(scalar(file, "entry/utc_minus_mono_ns"))
        self._file = file
        self._salvage = salvage

    def refresh(self) -> None:
        """See what a living writer has added since."""
        for name, columns in self._columns.items():
            for dataset in columns_of(self.group(name), columns).values():
                dataset.refresh()

    def events(self, *, recorded: bool = False) -> list[Event]:
        """What happened, in the order it was noticed."""
        table = self.table("events")
        steps = [] if recorded else self.time_map()
        return [mapped_event(steps, event) for event in tables.events_from(table, self._exact(table))]

    def health(self, *, recorded: bool = False) -> list[Health]:
        """How the recording was doing, second by second."""
        table = self.table("health")
        steps = [] if recorded else self.time_map()
        streams = tuple(info.name for info in self.header.streams)
        return [mapped_health(steps, one) for one in tables.health_from(table, self._exact(table), streams)]

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
            datasets = columns_of(self.group("time_map"), TIME_MAP_COLUMNS)
            columns = {name: dataset[:] for name, dataset in datasets.items()}
            check_rows(columns)
        newest = columns["version"].max(initial=0)
        rows = zip(*(columns[name] for name in ("version", "mono_ns", "add_ns", "reason")), strict=False)
        return [TimeStep(int(m), int(a), decode_text(r)) for v, m, a, r in rows if v == newest]

    def integrity(self) -> dict[str, NDArray[Any]]:
        """What was written down when the session was sealed, per stream and per table.

        Columns missing from older files are 0.
        """
        columns = (*INTEGRITY_COLUMNS, Column("table_crc32", "<u4"))
        with self._explaining():
            group = self.group("integrity")
            return {
                column.name: column_dataset(group, column)[:]
                if column.name != "columns_crc32" or link_of(group, column.name) is not None
                else column.unknown(len(self.header.streams))
                for column in columns
            }

    def sealed_tables(self) -> dict[str, int]:
        """Checksums of the tables by their names, as sealed."""
        with self._explaining():
            tables = _texts(stored_here(self.group("integrity"), "table"))
        return dict(zip(tables, self.integrity()["table_crc32"].tolist(), strict=True))

    @property
    def format_version(self) -> tuple[int, int]:
        """Of the file's format, major and minor."""
        major, minor = str(attribute(self._file, "fieldkit_format_version")).split(".")[:2]
        return int(major), int(minor)

    def sealed_objects(self) -> dict[str, str]:
        """Digests of the file's objects by their paths, as sealed; none in a file of version 1.0."""
        with self._explaining():
            group = self.group("integrity")
            if group.get("object_sha256", getlink=True) is None:
                return {}
            paths, digests = (_texts(stored_here(group, name)) for name in ("object", "object_sha256"))
            return dict(zip(paths, digests, strict=True))

    def object_digest(self, path: str) -> str:
        """The digest of an object as it is now; see `fieldkit.sessions.digests`."""
        return object_digest(self._file, path)

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
        """Everything that is no sample, as recorded: regions, events, clock comparisons, health, minutes."""
        told, health = self.events(recorded=True), self.health(recorded=True)
        return [*self.region_history(), *told, *self.clock_checks(), *health, *self.minutes()]

    def group(self, name: str) -> h5py.Group:
        """The HDF5 group of a stream or table, as it is."""
        with self._explaining():
            group = stored_here(self._file, name)
            if not isinstance(group, h5py.Group):
                raise SessionError(f"the group {name} is missing")
            return group

    def datasets(self, name: str) -> dict[str, h5py.Dataset]:
        """The datasets of the group of a stream or table, those of a newer version among them.

        Raises `SessionError` where one of them does not lie in this file.
        """
        group = self.group(name)
        with self._explaining():
            return {name: node for name, node in members(group) if isinstance(node, h5py.Dataset)}

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        """What is found wrong while reading names the session, and what to do next."""
        try:
            yield
        except SessionError as error:
            raise explained(self.path, error) from error

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """The columns of a table of entries as stored, as many rows as all of them have.

        Columns missing from files of an older version are their fill value.
        """
        group = self.group(name)
        with self._explaining():
            columns = columns_of(group, self._columns[name], salvage=self._salvage)
        length = min(dataset.shape[0] for dataset in columns.values())
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


def _texts(dataset: h5py.Dataset) -> list[str]:
    """The texts of a dataset; raises `SessionError` where it is none of texts."""
    check_size(dataset)
    if dataset.dtype.kind != "S" or dataset.ndim != 1:
        raise SessionError(f"{dataset.name} holds no texts")
    return [decode_text(text) for text in dataset[:].tolist()]
