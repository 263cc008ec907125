"""Recordings of the lab streaming layer (XDF), as LabRecorder writes them: each stream is read as a table.

A file is chunks: headers of streams in XML, samples with seconds of their computer's clock, and how far that
was from the recorder's (https://github.com/sccn/xdf/wiki/Specifications). These clocks have no date.
LabRecorder writes the date at which it opened the file, and the earliest sample follows within a second or
two. The raw stamp of a sample stands first in its `raw`.
"""

from __future__ import annotations

import io
import logging
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.samples import Severity
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.logger_clock import Notes, TimedRow, in_clock_order, listed
from fieldkit.sessions.formats.logs import LogColumns, LogOptions, channels_of, recording_of
from fieldkit.sessions.formats.table_units import KNOWN, known_unit
from fieldkit.sessions.formats.tables import Column, Row, Table
from fieldkit.sessions.formats.times import parse_times_ns, plausible_ns
from fieldkit.sessions.layout import RESERVED_NAMES

_MAGIC = b"XDF:"
_LENGTHS = (1, 4, 8)
"""Bytes in which the length of a chunk may be written."""
_UNIX_S = 1e9
"""Stamps from here on are Unix seconds: a clock that counts from a computer's start needs 31 years."""
_LONGEST_NAME = 31
_OF_NO_DAMAGE = "clock-segments differ"  # logged of every stream without clock offsets


class _Stream(NamedTuple):
    """A stream: columns behind that of the stamps (none of text), values, raw stamps, recorder's time."""

    name: str
    columns: list[Column]
    values: list[list[float]]
    raw_s: FloatArray
    stamps_s: FloatArray

    def __str__(self) -> str:
        units = dict.fromkeys(column.unit or "no unit" for column in self.columns)
        return f"{self.name} ({', '.join(units) or 'text'}, {len(self.stamps_s)} samples)"

    @property
    def labels(self) -> list[str]:
        """Names of the channels."""
        return [column.label for column in self.columns]

    @property
    def has_unix_time(self) -> bool:
        """True if the stamps have a date."""
        return len(self.stamps_s) > 0 and bool(self.stamps_s[0] >= _UNIX_S)

    def table(self) -> Table:
        """The samples as rows of text, the raw stamp before the values."""
        rows = [
            Row(number, [*map(repr, (stamp, *values))])
            for number, (stamp, values) in enumerate(zip(self.raw_s.tolist(), self.values, strict=True), 1)
        ]
        return Table([Column("time", "time"), *self.columns], rows, (0,), has_decimal_commas=False)


def read_xdf(path: Path, name: str | None, options: LogOptions) -> ImportedRecording:
    """Read the streams of an XDF file whose channels state a unit: one for each quantity in each of them.

    Of a file that is cut off or damaged the whole chunks are read, and notes name the rest. `name` is that of
    the stream, or of several before their own; by default their own. Of the options count `unit` of channels
    that state none, `columns.values` (labels of channels) to read, `measures`, `keep`, `offset_ns`, and the
    `zone` of the file's date, if that has none. Readings are in order of time, on the recorder's clock by the
    file's clock offsets as pyxdf applies them; jitter is left in the stamps. Raises `ConfigError` if the file
    is not XDF, has no date, or no channel of a known unit.
    """
    streams, header, notes = _loaded(path)
    wanted = [stream for stream in streams if _is_wanted(stream, options)]
    unknown = set(options.columns.values) - set(chain.from_iterable(stream.labels for stream in streams))
    if unknown or not wanted:
        raise _nothing_read(path, streams, unknown)
    zero_ns = _zero_ns(path, header, streams, options, notes)
    excluded = [str(stream) for stream in streams if not _is_wanted(stream, options)]
    if excluded:
        notes.append((Severity.WARNING, f"streams excluded: {listed(excluded)}"))
    named = zip(_names(wanted, name), wanted, strict=True)
    parts = [_part(path, own, stream, zero_ns, options) for own, stream in named]
    return ImportedRecording(
        tuple(chain.from_iterable(part.streams for part in parts)),
        sorted(chain.from_iterable(part.samples for part in parts), key=lambda one: one.time_ns),
        (*notes, *chain.from_iterable(part.notes for part in parts)),
    )


def _part(path: Path, name: str, stream: _Stream, zero_ns: int, options: LogOptions) -> ImportedRecording:
    """One stream; `zero_ns` is the UTC at which the recorder's clock was 0."""
    asked = tuple(one for one in options.columns.values if one in stream.labels)
    table, own = stream.table(), replace(options, columns=LogColumns(values=asked))
    channels, about_channels = channels_of(path, table, own)
    first_ns = options.offset_ns + (0 if stream.has_unix_time else zero_ns)
    rows = [
        TimedRow(row.number, plausible_ns(first_ns + round(stamp_s * 1e9)), row.cells)
        for row, stamp_s in zip(table.rows, stream.stamps_s.tolist(), strict=True)
    ]
    ordered, about_order = in_clock_order(path, rows, options.keep)
    moved_s = float(np.median(stream.stamps_s - stream.raw_s))
    about_clock = (
        Severity.INFO,
        f"{name}: stamps moved by {moved_s:+.4f} s, its clock offset to the recorder",
    )
    return recording_of(name, name, channels, ordered, own, [about_clock, *about_order, *about_channels])


def _is_wanted(stream: _Stream, options: LogOptions) -> bool:
    """True if a stream has samples, and a channel that is asked for, or else whose unit is read."""
    asked = options.columns.values
    units = [column.unit or options.unit for column in stream.columns]
    has_channel = not set(asked).isdisjoint(stream.labels) if asked else any(map(known_unit, units))
    return has_channel and len(stream.stamps_s) > 0


def _nothing_read(path: Path, streams: Sequence[_Stream], unknown: set[str]) -> ConfigError:
    found = "; ".join(map(str, streams)) or "it has no streams"
    if unknown:
        labels = ", ".join(chain.from_iterable(stream.labels for stream in streams))
        return ConfigError(f"{path} has no channel {', '.join(sorted(unknown))}", fix=f"it has: {labels}")
    return ConfigError(
        f"{path}: no channel has samples in a unit that is read: {found}",
        fix=f"--unit of {KNOWN} for channels without one; --column names those to read",
    )


def _names(streams: Sequence[_Stream], given: str | None) -> list[str]:
    """Names in the session: the given one, or letters and digits of their own, each once."""
    if given and len(streams) == 1:
        return [given]
    plain = [re.sub(r"[^\w.-]+", "-", stream.name).strip("-.")[:_LONGEST_NAME] for stream in streams]
    often = Counter([*plain, "", "", *RESERVED_NAMES, *RESERVED_NAMES])
    own = [one if often[one] == 1 else f"{one}-{place}".strip("-") for place, one in enumerate(plain, 1)]
    return [f"{given}-{one}" if given else one for one in own]


def _zero_ns(path: Path, header: Any, streams: Sequence[_Stream], options: LogOptions, notes: Notes) -> int:
    """UTC at which the recorder's clock was 0: the date of the file is that of its earliest stamp."""
    undated = [stream.stamps_s for stream in streams if not stream.has_unix_time]
    first_s = min(chain.from_iterable(map(np.ndarray.tolist, undated)), default=None)
    written = _text(header, "datetime")
    if first_s is None or (options.offset_ns and not written):
        return 0
    if not written:
        raise ConfigError(
            f"{path} does not state when it was recorded",
            fix="--clock-offset of the seconds from 1970 to when its clock was 0, such as +1780000000s: "
            f"those to its first sample, less {first_s:.3f}",
        )
    notes.append((Severity.INFO, f"{path.name}: recorded from {written}, which dates its earliest sample"))
    return parse_times_ns([written], options.zone)[0] - round(float(first_s) * 1e9)


# --- the file


def _loaded(path: Path) -> tuple[list[_Stream], Any, Notes]:
    """The streams, the file's header, and notes on damage; raises `ConfigError`."""
    try:
        from pyxdf import load_xdf
    except ImportError as error:
        raise ConfigError("XDF needs pyxdf", fix="pip install 'fieldkit[lsl]'") from error
    data = path.read_bytes()
    whole = _whole_part(path, data)
    raw_s: defaultdict[int, list[FloatArray]] = defaultdict(list)

    def keep(values: Any, stamps: FloatArray, info: Any, number: int) -> tuple[Any, Any, Any]:
        raw_s[number].append(stamps)
        return values, stamps, info

    try:
        with _logged() as records:
            found, header = load_xdf(io.BytesIO(whole), on_chunk=keep, dejitter_timestamps=False)
        streams = [_stream(one, raw_s[one["info"]["stream_id"]]) for one in found]
    except Exception as error:  # whatever the library meets in damaged bytes
        fix = "copy it from the recorder again"
        raise ConfigError(f"{path} is damaged: {message_of(error) or repr(error)}", fix=fix) from error
    texts = [text for record in records if not (text := record.getMessage()).endswith(_OF_NO_DAMAGE)]
    if len(whole) < len(data):
        texts.append(f"{len(data) - len(whole)} bytes after the last whole chunk are excluded")
    return (
        streams,
        (header or {}).get("info"),
        [(Severity.WARNING, f"{path.name}: {text}") for text in dict.fromkeys(texts)],
    )


def _whole_part(path: Path, data: bytes) -> bytes:
    """The file up to its last whole chunk: the library fills a sample that is cut off with the one before."""
    if not data.startswith(_MAGIC):
        raise ConfigError(f"{path} is not an XDF file", fix="check that it is the right file, and whole")
    end = len(_MAGIC)
    while end < len(data) and (width := data[end]) in _LENGTHS:
        after = end + 1 + width + int.from_bytes(data[end + 1 : end + 1 + width], "little")
        if after > len(data):
            break
        end = after
    return data[:end]


@contextmanager
def _logged() -> Iterator[list[logging.LogRecord]]:
    """What the library warns of, which would go to the terminal."""
    logger, handler = logging.getLogger("pyxdf"), BufferingHandler(10_000)
    handler.setLevel(logging.WARNING)
    logger.addHandler(handler)
    was, logger.propagate = logger.propagate, False
    try:
        yield handler.buffer
    finally:
        logger.removeHandler(handler)
        logger.propagate = was


def _stream(found: Any, raw_s: Sequence[FloatArray]) -> _Stream:
    info, stamps_s = found["info"], found["time_stamps"]
    if not np.isfinite(stamps_s).all():
        raise ValueError("a stamp is not a number")
    is_text = _text(info, "channel_format") == "string"
    return _Stream(
        _text(info, "name") or f"stream-{info['stream_id']}",
        [] if is_text else _columns(info, int(_text(info, "channel_count"))),
        [] if is_text else found["time_series"].tolist(),
        np.concatenate([*raw_s, np.zeros(0)])[: len(stamps_s)],
        stamps_s,
    )


def _columns(info: Any, count: int) -> list[Column]:
    """Channels by the names and units of ``desc/channels/channel``, or else by number."""
    described = _elements(info, "desc", "channels", "channel")
    described += [None] * (count - len(described))
    columns = []
    for place, one in enumerate(described[:count], 1):
        label, unit = _text(one, "label") or str(place), _text(one, "unit")
        columns.append(Column(f"{label} [{unit}]" if unit else label, label, unit))
    return columns


def _elements(above: Any, *tags: str) -> list[Any]:
    """The elements on a way of tags; pyxdf has them as lists by tag, and texts or None where XML ends."""
    elements = [above]
    for tag in tags:
        elements = [one for outer in elements if isinstance(outer, dict) for one in outer.get(tag, ())]
    return elements


def _text(above: Any, *tags: str) -> str:
    return next((element.strip() for element in _elements(above, *tags) if isinstance(element, str)), "")
