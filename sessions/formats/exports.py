"""The formats that a session is exported to, in one table; a writer is imported when it is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """One format of export.

    Attributes
    ----------
    writer
        ``MODULE:FUNCTION`` of this room: given an open session and a folder it returns the files it wrote.
    meaning
        What is written, as ``fieldkit export --help`` prints it.
    is_whole
        Whether it has every stream, each in a file of its own; other writers take `stream` and `every`.
    omits_damaged
        Whether samples that do not match their checksum are omitted; else they are flagged.
    """

    writer: str
    meaning: str
    is_whole: bool = False
    omits_damaged: bool = False

    def write(self, session: SessionReader, folder: Path, *, stream: str | None, every: int) -> list[Path]:
        """Write a session into a folder; the files. Raises as the writer does."""
        write: Callable[..., list[Path]] = resolve_name(f"{__package__}.{self.writer}")
        return write(session, folder) if self.is_whole else write(session, folder, stream=stream, every=every)


EXPORTS: Mapping[str, ExportFormat] = MappingProxyType(
    {
        "csv": ExportFormat("tables_out:export_csv", "tables, one row a sample, units in the header", True),
        "parquet": ExportFormat("tables_out:export_parquet", "the same tables for programs", True),
        "netcdf": ExportFormat("tables_out:export_netcdf", "netCDF, one file a stream", True),
        "mcap": ExportFormat("mcap_out:export_mcap", "one MCAP file of everything, for its viewers"),
        "ros2": ExportFormat("ros2_out:export_ros2", "an MCAP file with ROS 2's own message types"),
        "ro-crate": ExportFormat(
            "ro_crate_out:export_ro_crate", "tables with RO-Crate metadata, for archives", True
        ),
        "png": ExportFormat("images_out:export_pngs", "frames as coloured images", omits_damaged=True),
        "video": ExportFormat("images_out:export_video", "the same as a video, VP9", omits_damaged=True),
        "tiff": ExportFormat(
            "images_out:export_tiffs", "frames as 16-bit TIFF of 0.01 K per count", omits_damaged=True
        ),
    }
)
"""The formats by name."""
