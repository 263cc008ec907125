"""Opening a session: sealed, recovered, interrupted, or while it is being recorded.

Nothing is changed and nothing is read before it is asked for; samples come a brick at a
time. Times are as they were recorded, or as the time map in force corrects them; estimates
stay as they were computed.
"""

from __future__ import annotations

import contextlib
import heapq
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Quality, Sample
from fieldkit.model.site import Region, Site
from fieldkit.sessions import analysis
from fieldkit.sessions.analysis import RegionSeries
from fieldkit.sessions.declared import attribute, check_format, explained, scalar
from fieldkit.sessions.entry_reader import EntryReader
from fieldkit.sessions.journal import Identity
from fieldkit.sessions.layout import RECOVERED, SEALED, decode_text, journal_path
from fieldkit.sessions.lock import is_locked
from fieldkit.sessions.stream_reader import Readings, StreamReader
from fieldkit.sessions.superblock import MendedFile, is_clean
from fieldkit.sessions.time_map import mapped, mapped_ns

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


log = logging.getLogger(__name__)

_MEANING = ("config/header", "entry/utc_minus_mono_ns")
_CHANGED = "%s: %s changed after it was sealed; times, places and scales may be wrong: fieldkit check %s"


class Session(EntryReader):
    """One recording. Use as a context manager, or call `close`.

    `state` is "recording" until it is sealed, "interrupted" (its writer ended without: `fieldkit
    recover`), "recovered" or "sealed". With `salvage` what the file has lost is left out of its tables.
    """

    def __init__(self, path: Path, file: h5py.File, state: str, *, salvage: bool = False) -> None:
        super().__init__(path, file, salvage=salvage)
        self.state = state
        self.site: Site = self.header.site
        self.streams: Mapping[str, StreamInfo] = {info.name: info for info in self.header.streams}
        self.session_id = str(attribute(file, "session_id"))
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
        super().refresh()

    def require_finished(self) -> None:
        """Raise `SessionError` where its journal may still hold samples missing from the file."""
        if self.state not in ("sealed", "recovered"):
            fix = "fieldkit stop" if self.state == "recording" else f"fieldkit recover {self.path}"
            raise SessionError(f"{self.path} is {self.state}: its journal may hold more", fix=fix)

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

    def samples(self, *streams: str, recorded: bool = False) -> Iterator[Sample]:
        """The samples of the streams named (all if none is), by monotonic time, a brick at a time.

        Their `time_ns` is as the time map in force corrects it, if there is one and not as `recorded`.
        """
        names = streams or tuple(self.streams)
        if not recorded and (steps := self.time_map()):
            return (mapped(steps, sample) for sample in self._recorded(names))
        return self._recorded(names)

    def _recorded(self, names: tuple[str, ...]) -> Iterator[Sample]:
        streams = (_in_turn(self._reader(name).samples()) for name in names)
        return (sample for _, sample in heapq.merge(*streams, key=itemgetter(0)))

    @property
    def start_ns(self) -> int:
        """UTC of the first sample, corrected by the time map in force; 0 where there is none."""
        return min((int(self._span_ns(reader, 0, 1)[0]) for reader in self._filled()), default=0)

    @property
    def end_ns(self) -> int:
        """UTC of the last sample, corrected by the time map in force; 0 where there is none."""
        return max((int(self._span_ns(reader, len(reader) - 1)[0]) for reader in self._filled()), default=0)

    def _filled(self) -> list[StreamReader]:
        return [reader for reader in self._readers.values() if len(reader)]

    def _span_ns(self, reader: StreamReader, start: int = 0, stop: int | None = None) -> NDArray[np.int64]:
        return mapped_ns(self.time_map(), reader.column("mono_ns", start, stop), reader.time_ns(start, stop))

    def _reader(self, name: str) -> StreamReader:
        if name not in self._readers:
            raise SessionError(
                f"{self.path} has no stream {name!r}", fix=f"it has {', '.join(self._readers)}"
            )
        return self._readers[name]

    # --- samples as arrays and tables

    def times_ns(self, stream: str) -> NDArray[np.int64]:
        """UTC of a stream's samples, corrected by the time map in force."""
        return self._span_ns(self._reader(stream))

    def flags(self, stream: str) -> NDArray[np.uint16]:
        """`Quality` of a stream's samples, each compared with its checksum, which reads all that it holds."""
        return self._reader(stream).flags()

    def readings(self, meter: str, *, recorded: bool = False) -> Readings:
        """The readings of a meter as arrays, at corrected times or, if so wanted, as `recorded`."""
        reader = self._reader(meter)
        found = reader.readings()
        return found if recorded else replace(found, time_ns=self._span_ns(reader))

    def raw(self, camera: str) -> h5py.Dataset:
        """The counts of a camera as stored, (n, rows, cols) uint16, read where they are sliced.

        They are compared with no checksum: `flags` has the frames that do not match theirs.
        """
        return self._reader(camera).counts

    @property
    def damaged(self) -> dict[str, int]:
        """How many samples of which stream did not match their checksum, among those read so far."""
        return {name: len(reader.damaged) for name, reader in self._readers.items() if reader.damaged}

    def columns_are_sealed(self, stream: str) -> bool:
        """Whether a stream's columns, all but its pictures, are those that were sealed.

        False also of a session sealed by a version that kept no checksum of them, or whose seal is damaged.
        """
        if self.state not in ("sealed", "recovered"):
            return False
        try:
            sealed = self.integrity()["columns_crc32"][list(self.streams).index(stream)]
        except SessionError:
            return False
        return bool(sealed) and int(sealed) == self._reader(stream).columns_crc32()

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


def _in_turn(samples: Iterable[Sample]) -> Iterator[tuple[int, Sample]]:
    """Samples with the monotonic times by which streams are merged: of a damaged one, that of the one before.

    Its own may be years away, and all of its stream would wait for the other streams to end.
    """
    turn_ns = 0
    for sample in samples:
        if not sample.quality & Quality.BAD_CRC:
            turn_ns = sample.mono_ns
        yield turn_ns, sample


def open_session(path: str | Path) -> Session:
    """Open a session for reading.

    Raises `SessionError` where the path holds no session, one of a newer version, or one
    too damaged to read; `fix` says what to do.
    """
    path = Path(path)
    is_written = is_locked(journal_path(path))  # asked first: who lets go after that has sealed it
    if _is_closed(path):
        unfinished = "recording" if is_written else "interrupted"  # to compare it may take minutes
        return _session(path, lambda: h5py.File(path, "r"), unfinished=unfinished)
    if is_written:
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
    path: Path, opened: Callable[[], h5py.File], state: str | None = None, *,
    unfinished: str = "interrupted", salvage: bool = False,
) -> Session:  # fmt: skip
    """A session in a given `state`, or as the file says it is: complete, or else `unfinished`."""
    file = None
    try:
        file = opened()
        check_format(path, file)
        complete = int(scalar(file, "entry/complete"))
        found = {SEALED: "sealed", RECOVERED: "recovered"}.get(complete, unfinished)
        session = Session(path, file, state or found, salvage=salvage)
    except (SessionError, OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if file is not None:
            file.close()
        raise explained(path, error) from error
    if session.state in ("sealed", "recovered"):
        _warn_where_changed(session)
    return session


def _warn_where_changed(session: Session) -> None:
    """Warn where what all numbers depend on is not as it was sealed; `check` looks at all the rest."""
    with contextlib.suppress(SessionError, OSError, RuntimeError, KeyError, ValueError):
        sealed = session.sealed_objects()
        known = [path for path in _MEANING if path in sealed]
        changed = [path for path in known if session.object_digest(path) != sealed[path]]
        if changed:
            log.warning(_CHANGED, session.path, " and ".join(changed), session.path)
