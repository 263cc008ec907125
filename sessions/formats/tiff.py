"""TIFF frames: those of any program's files, and frames written with what a count means and when.

Scale, offset, unit and the marker of pixels without a value stand in GDAL's tags, which geographic programs
read, the time in TIFF's own tag, and all of it with the time to the microsecond and the flags as JSON in the
description. Frames may stand one behind another after a single directory, as ImageJ and tifffile write them.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.installation import install_extra

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

_GDAL_METADATA, _GDAL_NODATA = 42112, 42113


@dataclass(frozen=True, slots=True)
class TiffTags:
    """The tags of a frame.

    Kelvin = counts * `scale` + `offset`, NaN where the temperature is not known. `time` is ISO 8601 with its
    offset; `flags` are names of `Quality`.
    """

    time: str
    scale: float
    offset: float = 0.0
    flags: tuple[str, ...] = ()


def write_tiff(path: Path, counts: CountArray, tags: TiffTags, software: str) -> None:
    """One frame (rows, cols) with its tags; a pixel of 0 has no temperature. Raises `OSError`."""
    from tifffile import imwrite

    texts = [(_GDAL_METADATA, _gdal(tags)), (_GDAL_NODATA, "" if math.isnan(tags.scale) else "0")]
    imwrite(
        path, counts.astype("<u2"), byteorder="<", photometric="minisblack", compression="zlib",
        metadata=None, description=_description(tags), software=software,
        datetime=datetime.fromisoformat(tags.time).replace(tzinfo=None, microsecond=0),
        extratags=[(tag, "s", 0, text, True) for tag, text in texts if text],
    )  # fmt: skip


def _description(tags: TiffTags) -> str:
    meaning = {} if math.isnan(tags.scale) else {"unit": "K", "scale": tags.scale, "offset": tags.offset}
    return json.dumps({"time": tags.time, **meaning, "flags": tags.flags})


def _gdal(tags: TiffTags) -> str:
    if math.isnan(tags.scale):
        return "<GDALMetadata></GDALMetadata>"
    items = (("SCALE", "scale", tags.scale), ("OFFSET", "offset", tags.offset), ("UNITTYPE", "unittype", "K"))
    lines = (f'<Item name="{name}" sample="0" role="{role}">{value}</Item>' for name, role, value in items)
    return f"<GDALMetadata>{''.join(lines)}</GDALMetadata>"


@dataclass(frozen=True, slots=True)
class Page:
    """One frame of a TIFF, as its directory describes it.

    `shape` is (rows, cols); `kind` of its numbers 1 for unsigned, 2 signed, 3 floating-point (SampleFormat);
    `is_frame` holds of all but smaller copies and masks of other pages; `tags` are what `write_tiff` wrote.
    Where GDAL's tags state it, a value in `unit` is a number x `scale[0]` + `scale[1]`, and `no_data` the
    number of pixels without one.
    """

    shape: tuple[int, int]
    channels: int
    bits: int
    kind: int
    orientation: int
    is_frame: bool
    tags: TiffTags | None
    scale: tuple[float, float] | None
    unit: str
    no_data: float
    _directory_at: int
    _behind: int | None = None
    """Which of several frames after one directory, from 0."""

    def read(self, path: Path) -> AnyArray | None:
        """The image as it is stored, (rows, cols); None where it does not decode.

        Raises `OSError`, and `ConfigError` for a compression that needs a further package.
        """
        try:
            with _open(path, "") as file:
                return self._pixels(path, file)
        except ConfigError:
            raise
        except ValueError:
            return None

    def _pixels(self, path: Path, file: TiffFile) -> AnyArray | None:
        from tifffile import COMPRESSION, TiffPage

        file.filehandle.seek(self._directory_at)
        page = TiffPage(file, 0)
        if self._behind is not None:
            at = page.dataoffsets[0] + self._behind * page.nbytes
            numbers = np.dtype(f"{file.byteorder}{np.dtype(page.dtype).char}")
            pixels = np.fromfile(path, numbers, math.prod(self.shape), offset=at)
            return pixels.reshape(self.shape).astype(page.dtype)
        try:
            return page.asarray(maxworkers=1)
        except (ImportError, ValueError) as error:
            if isinstance(error, ValueError) and "imagecodecs" not in str(error):
                return None
            problem = f"compressed as {COMPRESSION(page.compression).name}"
            raise ConfigError(problem, place=path, fix=install_extra("files")) from error


def read_pages(path: Path) -> list[Page]:
    """The frames of a TIFF or BigTIFF, in order; raises `OSError`, or `ValueError` where it is damaged."""
    with _open(path, "TiffPages") as file:
        pages: dict[int, TiffPage] = {}
        for page in file.pages:
            if page.offset in pages:
                raise ValueError("its directories form a circle")
            pages[page.offset] = page.aspage()
        if len(pages) < len(file.pages):
            raise ValueError(f"its directory {len(pages) + 1} is damaged")
        counts = dict.fromkeys(pages, 1)
        if file.is_shaped or file.is_imagej or file.is_stk:
            alone = [series for series in file.series if len(series.pages) == 1]
            counts |= {one.keyframe.offset: math.prod(one.shape) // one.keyframe.size for one in alone}
        return [frame for at, page in pages.items() for frame in _frames(path, page, counts[at])]


@contextmanager
def _open(path: Path, about: str) -> Iterator[TiffFile]:
    """The file; raises `ValueError` also where tifffile only logs an error `about` something."""
    from tifffile import TiffFile

    complaints, log = _Complaints(about), logging.getLogger("tifffile")
    log.addFilter(complaints)
    try:
        with TiffFile(path, _multifile=False) as file:
            yield file
    except (OSError, ValueError, ConfigError):
        raise
    except Exception as error:  # of damaged directories
        raise ValueError(f"its directories are damaged ({message_of(error)})") from error
    finally:
        log.removeFilter(complaints)
    if complaints.has_error:
        raise ValueError("its directories are damaged")


class _Complaints(logging.Filter):
    """Lets no record pass, and remembers errors; its warnings are about tags that nobody reads."""

    has_error = False

    def filter(self, record: logging.LogRecord) -> bool:
        self.has_error |= record.levelno >= logging.ERROR and self.name in record.getMessage()
        return False


def _frames(path: Path, page: TiffPage, count: int) -> Iterator[Page]:
    """The frames of a directory; raises `ValueError` where the file ends before the last of several."""
    there = (path.stat().st_size - page.dataoffsets[0]) // max(page.nbytes, 1) if count > 1 else count
    if there < count or (count > 1 and page.compression != 1):
        raise ValueError(f"it states {count} frames after one directory and holds {there}")
    scale, unit = _gdal_scale(page)
    for number in range(count):
        yield Page(
            shape=(int(page.imagelength), int(page.imagewidth)),  # a damaged tag may hold several
            channels=int(page.samplesperpixel),
            bits=int(page.bitspersample),
            kind=int(page.sampleformat),
            orientation=int(page.tags.valueof("Orientation", 1)),
            is_frame=not page.is_reduced and not page.is_mask,
            tags=_tags(page.description),
            scale=scale,
            unit=unit,
            no_data=_no_data(page),
            _directory_at=page.offset,
            _behind=number if count > 1 else None,
        )


def _gdal_scale(page: TiffPage) -> tuple[tuple[float, float] | None, str]:
    """Scale with offset, and unit of the first band, as GDAL's items state them."""
    try:
        items = ElementTree.fromstring(page.tags.valueof(_GDAL_METADATA, "<GDALMetadata/>"))
        of_band = {item.get("role"): item.text or "" for item in items if item.get("sample", "0") == "0"}
        scale = float(of_band.get("scale", 1.0)), float(of_band.get("offset", 0.0))
    except (ElementTree.ParseError, TypeError, ValueError):
        return None, ""
    return (scale if {"scale", "offset"} & of_band.keys() else None), of_band.get("unittype", "")


def _no_data(page: TiffPage) -> float:
    try:
        return float(page.tags.valueof(_GDAL_NODATA, "nan").strip("\0 "))
    except (AttributeError, ValueError):
        return math.nan


def _tags(description: str) -> TiffTags | None:
    """Content that `write_tiff` wrote; another program may have written anything there."""
    try:
        plain = json.loads(description)
        scale, offset = float(plain.get("scale", math.nan)), float(plain.get("offset", 0.0))
        return TiffTags(str(plain["time"]), scale, offset, tuple(map(str, plain["flags"])))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
