"""The formats that a session is exported to, in one table; a writer is imported when it is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fieldkit.sessions.reader import SessionReader


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """One format of export.

    `writer` is ``MODULE:FUNCTION`` of this room: given an open session and a folder it returns the files it
    wrote; `meaning` is what ``fieldkit export --help`` prints of it. `takes` names the options that the
    writer takes as keywords; without ``stream`` it writes every stream, each into a file of its own. Samples
    that do not match their checksum are omitted (`omits_damaged`) or else flagged.
    """

    writer: str
    meaning: str
    takes: frozenset[str] = frozenset()
    omits_damaged: bool = False

    def write(self, session: SessionReader, folder: Path, options: Mapping[str, Any]) -> list[Path]:
        """Write a session into a folder; the files. Raises as the writer does."""
        write: Callable[..., list[Path]] = resolve_name(f"{__package__}.{self.writer}")
        return write(session, folder, **options)


_STREAM = frozenset({"stream", "every"})
_FRAMES = _STREAM | {"between_ns", "on_frame"}
_IMAGES = _FRAMES | {"palette"}


EXPORTS: Mapping[str, ExportFormat] = MappingProxyType(
    {
        "csv": ExportFormat("tables_out:export_csv", "tables, one row a sample, units in the header"),
        "parquet": ExportFormat("tables_out:export_parquet", "the same tables for programs"),
        "netcdf": ExportFormat("netcdf_out:export_netcdf", "netCDF, a group for each stream and table"),
        "mcap": ExportFormat("ros2:export_mcap", "one MCAP file of everything, as ROS 2 messages", _STREAM),
        "ro-crate": ExportFormat(
            "ro_crate_out:export_ro_crate",
            "session and tables with RO-Crate metadata, for archives",
            frozenset({"license", "orcid"}),
        ),
        "png": ExportFormat("images_out:export_pngs", "frames as coloured images", _IMAGES, True),
        "video": ExportFormat(
            "images_out:export_video", "the same as a video, VP9", _IMAGES | {"speed"}, True
        ),
        "frames-csv": ExportFormat(
            "images_out:export_frame_tables", "frames as tables of °C, a file each", _FRAMES, True
        ),
        "tiff": ExportFormat(
            "images_out:export_tiffs", "frames as 16-bit TIFF of 0.01 K per count", _FRAMES, True
        ),
    }
)
"""The formats by name."""
