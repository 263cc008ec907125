"""Tables of loggers, written into a file and read at once."""

from datetime import UTC
from pathlib import Path
from typing import Any

from fieldkit.model.samples import Reading
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.logs import LogOptions, read_log


def read(folder: Path, text: str | bytes, name: str = "log", **options: Any) -> ImportedRecording:
    """A table as ``log.csv`` of a folder, its times in UTC unless the options have another zone."""
    path = folder / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_log(path, name, LogOptions(**{"zone": UTC, **options}))


def readings(imported: ImportedRecording, stream: str = "") -> list[Reading]:
    """The readings of a stream, by default of all."""
    streams = (stream,) if stream else [info.name for info in imported.streams]
    return [reading for reading in imported.samples if reading.stream in streams]  # type: ignore[misc]


def values(imported: ImportedRecording, stream: str = "") -> list[tuple[float, ...]]:
    """Their values."""
    return [reading.values for reading in readings(imported, stream)]


def notes(imported: ImportedRecording) -> str:
    """The texts of all notes, a line each."""
    return "\n".join(text for _, text in imported.notes)
