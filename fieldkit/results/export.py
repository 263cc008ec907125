"""A session as files for other programs: tables, netCDF, MCAP, images, film."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fieldkit.model.errors import ConfigError, IncompleteError, StorageError
from fieldkit.results.sources import SessionOrFile, path_of, reading
from fieldkit.sessions.formats.exports import EXPORTS, ExportFormat
from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True)
class Export:
    """Files written from a session into `folder`, and `problems` with samples that are missing or damaged."""

    folder: Path
    files: tuple[Path, ...]
    problems: tuple[str, ...]


def export(
    session: SessionOrFile,
    to: str,
    folder: str | Path | None = None,
    *,
    stream: str | None = None,
    every: int = 1,
) -> Export:
    """Write a session for other programs.

    Parameters
    ----------
    session : Session or path
        The session to export, or its file.
    to : str
        A format by its name in `fieldkit.sessions.formats.exports.EXPORTS`, such as ``"csv"``.
    folder : path, optional
        Where to write; by default ``results/NAME`` of the campaign, or a folder beside the session.
    stream : str, optional
        Which camera, if there are several; for MCAP, the only stream to write.
    every : int
        Write only every n-th frame.

    Raises
    ------
    ConfigError
        If `stream` is given for a kind that contains every stream, or there is no such kind.
    StorageError
        If the files cannot be written.

    Examples
    --------
    >>> exported = fieldkit.export(session, "csv")
    >>> [path.name for path in exported.files][:2]
    ['20160101T190001Z-noon-camera-regions.csv', '20160101T190001Z-noon-lux.csv']
    """
    if to not in EXPORTS:
        raise ConfigError(f"{to!r} is not a kind of export", fix=f"use one of {', '.join(EXPORTS)}")
    chosen = EXPORTS[to]
    if stream is not None and chosen.is_whole:
        raise ConfigError(
            f"--stream {stream}: --to {to} writes every stream, each into a file of its own",
            fix="omit --stream",
        )
    target = Path(folder) if folder is not None else _default_folder(path_of(session))
    with reading(session) as opened:
        try:
            target.mkdir(parents=True, exist_ok=True)
            files, problems = _written(opened, target, chosen, stream, every)
        except OSError as error:
            raise StorageError(f"cannot write into {target}: {error.strerror or error}") from error
        return Export(target, tuple(files), (*problems, *_damage(opened, chosen)))


def _default_folder(session: Path) -> Path:
    parent = session.resolve().parent
    if parent.name == "recordings":
        return parent.parent / "results" / session.stem
    return parent / f"{session.stem}-export"


def _written(
    session: SessionReader, folder: Path, chosen: ExportFormat, stream: str | None, every: int
) -> tuple[list[Path], list[str]]:
    """The files, and what could not be read for them."""
    try:
        return chosen.write(session, folder, stream=stream, every=every), []
    except IncompleteError as error:
        return list(error.files), [error.message]


def _damage(session: SessionReader, chosen: ExportFormat) -> list[str]:
    """Damage that the export found: samples that do not match their checksum."""
    fate = "they are omitted" if chosen.omits_damaged else "they are flagged bad_crc"
    return [
        f"{count} of {session.count(name)} samples of {name} do not match their checksum, {fate}"
        for name, count in session.damaged.items()
    ]
