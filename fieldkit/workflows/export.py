"""A session as files for other programs: tables, netCDF, MCAP, images, film."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from fieldkit.model.errors import ConfigError, IncompleteError, StorageError
from fieldkit.sessions.formats import images_out, mcap_out, ros2_out, tables_out
from fieldkit.sessions.reader import SessionReader
from fieldkit.workflows.sources import SessionOrFile, path_of, reading

Kind = Literal["csv", "parquet", "netcdf", "mcap", "ros2", "png", "mp4", "tiff"]
WHOLE_KINDS = ("csv", "parquet", "netcdf")
"""Kinds that always contain every stream, each in a file of its own."""
IMAGE_KINDS = ("png", "mp4", "tiff")


@dataclass(frozen=True)
class Export:
    """Files written from a session into `folder`, and `problems` with samples that are missing or damaged."""

    folder: Path
    files: tuple[Path, ...]
    problems: tuple[str, ...]


def export(
    session: SessionOrFile,
    to: Kind,
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
    to : {"csv", "parquet", "netcdf", "mcap", "ros2", "png", "mp4", "tiff"}
        Tables with one row per sample and units in the header; netCDF, one file per stream; MCAP, one
        file of everything; the same typed for ROS 2; frames as images, as a film, or as 16-bit TIFF of
        0.01 K per count.
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
    if to not in get_args(Kind):
        raise ConfigError(f"{to!r} is not a kind of export", fix=f"use one of {', '.join(get_args(Kind))}")
    if stream is not None and to in WHOLE_KINDS:
        raise ConfigError(
            f"--stream {stream}: --to {to} writes every stream, each into a file of its own",
            fix="omit --stream",
        )
    target = Path(folder) if folder is not None else _default_folder(path_of(session))
    with reading(session) as opened:
        try:
            target.mkdir(parents=True, exist_ok=True)
            files, problems = _written(opened, target, to, stream, every)
        except OSError as error:
            raise StorageError(f"cannot write into {target}: {error.strerror or error}") from error
        return Export(target, tuple(files), (*problems, *_damage(opened, to)))


def _default_folder(session: Path) -> Path:
    parent = session.resolve().parent
    if parent.name == "recordings":
        return parent.parent / "results" / session.stem
    return parent / f"{session.stem}-export"


def _written(
    session: SessionReader, folder: Path, to: Kind, stream: str | None, every: int
) -> tuple[list[Path], list[str]]:
    """The files, and what could not be read for them."""
    of_frames = {
        "mcap": mcap_out.export_mcap,
        "ros2": ros2_out.export_ros2,
        "png": images_out.export_pngs,
        "mp4": images_out.export_mp4,
        "tiff": images_out.export_tiffs,
    }
    try:
        if to in ("csv", "parquet"):
            return tables_out.export_tables(session, folder, to), []
        if to == "netcdf":
            return tables_out.export_netcdf(session, folder), []
        return of_frames[to](session, folder, stream=stream, every=every), []
    except IncompleteError as error:
        return list(error.files), [error.message]


def _damage(session: SessionReader, to: Kind) -> list[str]:
    """What the export found of samples that do not match their checksum."""
    fate = "they are omitted" if to in IMAGE_KINDS else "they are flagged bad_crc"
    return [
        f"{count} of {session.count(name)} samples of {name} do not match their checksum, {fate}"
        for name, count in session.damaged.items()
    ]
