"""Frames of TIFF, 16-bit PNG, InfiRay IRG and CSV files, a folder or one alone, times from a table or names.

What a count means is never guessed: it stands in the file, or must be given, or declared unknown. TIFF holds
counts of 16 bits, or other numbers that are temperatures, which become counts of 0.01 K; so do those of CSV.
A pixel without a value is `NO_VALUE`, which stream settings declare.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import tzinfo
from functools import reduce
from operator import or_
from pathlib import Path

import numpy as np

from fieldkit import native_code
from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Text
from fieldkit.model.quantities import TEMPERATURE, Unit, meaning_of
from fieldkit.model.samples import Frame, Quality, Severity
from fieldkit.physics import camera_laws
from fieldkit.sessions.formats import imported
from fieldkit.sessions.formats.frame_tables import is_frame_table, read_frame_tables
from fieldkit.sessions.formats.imported import ImportedRecording, explained, flag_bunched
from fieldkit.sessions.formats.tiff import Page, read_pages
from fieldkit.sessions.formats.times import GIVE_TIMES, given_times_ns, parse_times_ns, plausible_ns
from fieldkit.sessions.layout import FILL_COUNT

_FIRST_SUFFIXES = (".tif", ".tiff", ".irg")  # beside them PNGs and tables are only to look at
SUFFIXES = (*_FIRST_SUFFIXES, ".png")

_KINDS = {".irg": "IRG", ".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF"}

Note = tuple[Severity, str]

_MOST_PIXELS = 1 << 24

_EXPORT_AGAIN = "export it again, or take it out of the folder"

_UNSIGNED, _SIGNED, _FLOAT, _UNDEFINED = 1, 2, 3, 4  # SampleFormat, TIFF 6.0 section 19
_WHOLE = (_UNSIGNED, _SIGNED)

_WORDS = {_SIGNED: "signed ", _FLOAT: "floating-point "}

_NOT_COLOURED = "export the radiometric frames as unsigned 16-bit counts, not coloured or scaled for display"

_UNIT_OF_FLOAT = "if they are temperatures: " + Argument("unit", "C") + ", or K, F"


_SCALE = Argument("kelvin_per_count", 0.01) + " (the maker's number); NaN (none) for frames only"

_IRG_SCALE = Argument("kelvin_per_count", 0.0625) + " (InfiRay C200) or 0.1; NaN (none) for frames only"


@dataclass(frozen=True, slots=True)
class Scale:
    """Kelvin = counts * `kelvin_per_count` + `kelvin_at_zero`; NaN where the temperature is not known."""

    kelvin_per_count: float
    kelvin_at_zero: float = 0.0


_OF_FLOAT = Scale(0.01)
NO_VALUE = FILL_COUNT
_HIGHEST = NO_VALUE - 1


@dataclass(frozen=True, slots=True)
class _Still:
    """A frame: its file, its name in messages, the scale it states, its page of a TIFF, its pixels' unit.

    `table` are the numbers of a CSV. With `unit` the pixels are temperatures, else counts.
    """

    path: Path
    label: str
    scale: Scale | None
    unit: Unit | None = None
    page: Page | None = None
    table: AnyArray | None = None

    @property
    def flags(self) -> Quality:
        """Those that fieldkit wrote with it."""
        names = self.page.tags.flags if self.page and self.page.tags else ()
        flags = [Quality[name.upper()] for name in names if name.upper() in Quality.__members__]
        return reduce(or_, flags, Quality.GOOD)

    def counts(self) -> CountArray:
        """Shape (rows, cols); raises `ConfigError` where it cannot be read."""
        if self.path.suffix.lower() == ".irg":
            return _read_irg(self.path)[0]
        page, pixels = self.page, self.table
        if pixels is None:
            pixels = page.read(self.path) if page else native_code.decode_image(self.path.read_bytes())
        if pixels is None:
            raise ConfigError("cannot be read as a frame", place=self.label, fix=_EXPORT_AGAIN)
        if not (self.unit or pixels.dtype == np.uint16) or pixels.ndim != 2:
            raise ConfigError("not one 16-bit number per pixel", place=self.label, fix=_NOT_COLOURED)
        if self.unit is None:
            return pixels.astype(np.uint16, copy=False)
        counts = counts_of(pixels, (page and page.scale) or (1.0, 0.0), self.unit)
        counts[pixels == (page.no_data if page else math.nan)] = NO_VALUE
        return counts

    @property
    def no_value(self) -> float:
        """The count of a pixel without a value; NaN where each has one."""
        return NO_VALUE if self.unit else self.page.no_data if self.page else math.nan


def image_files(source: Path) -> list[Path]:
    """The frames of a folder, by name; or the one."""
    if not source.is_dir():
        return [source]
    paths = sorted(source.iterdir())
    frames = [path for path in paths if path.suffix.lower() in SUFFIXES]
    first = [path for path in frames if path.suffix.lower() in _FIRST_SUFFIXES]
    return first or frames or [path for path in paths if is_frame_table(path)]


def counts_of(numbers: AnyArray, scale: tuple[float, float], unit: Unit) -> CountArray:
    """Temperatures as counts of 0.01 K; what is none becomes `NO_VALUE`, or the end of the range."""
    with np.errstate(invalid="ignore", over="ignore"):  # signalling NaNs
        values = numbers.astype(np.float64) * scale[0] + scale[1]
        counts = np.rint((values + unit.add) / unit.by / _OF_FLOAT.kelvin_per_count)
    return np.where(counts >= 0.0, np.clip(np.nan_to_num(counts), 0, _HIGHEST), NO_VALUE).astype(np.uint16)


def read_stills(
    source: Path, scale: Scale | None, *, times: Path | None = None, time_format: str | None = None,
    zone: tzinfo | None = None, offset_ns: int = 0, unit: str = "", name: str = "camera",
) -> ImportedRecording:  # fmt: skip
    """Read the frames of a folder, or of a single file, as a camera stream in order of time.

    InfiRay IRG, 16-bit PNG, or TIFF (16-bit counts, 32-bit floating-point temperatures), every page a frame
    but thumbnails and masks. `scale` is what a count means, None for the scale in the files; `unit` (C, K or
    F) is that of floating-point temperatures. `times` is a table of file name and time, a line per frame,
    `time_format` that of the times in the file names without their ending, as for strptime; without either
    the tags of frames that fieldkit exported are used. `zone` is that of times without an offset, `offset_ns`
    is added to all.

    Frames are read when they are needed, and their orientation is not applied. Raises `ConfigError` if scale
    or times are unknown, or a file cannot be read.
    """
    if not (paths := image_files(source)):
        fix = "name the folder that has the .tif, .tiff, .irg or .png files, or FLIR's .jpg, .fff or .seq"
        raise ConfigError("no frames with temperatures", place=source, fix=fix)
    kind = _kind(paths)
    if kind in ("IRG", "PNG") and unit:
        raise _no_unit(source)
    stills, notes = [_Still(path, str(path), None) for path in paths], list[Note]()
    if kind == "TIFF":
        stills, notes = _tiff_stills(paths, unit)
    elif kind == "CSV":
        stills = _table_stills(paths, temperature_unit(unit), scale)
    elif kind == "IRG":
        stills, notes = _irg_stills(paths)
    rows, cols = stills[0].counts().shape
    agreed = _common_scale(stills, scale, kind)
    times_ns = [plausible_ns(at + offset_ns) for at in _times_ns(stills, times, time_format, zone)]
    stamped = sorted(zip(times_ns, stills, strict=True), key=lambda pair: pair[0])
    times_ns.sort()
    no_values = {still.no_value for still in stills if math.isfinite(still.no_value)}
    info = StreamInfo(
        name, "brightness_temperature", "K", (rows, cols), agreed.kelvin_per_count, agreed.kelvin_at_zero,
        rate_hz=imported.usual_rate_hz(times_ns), driver="import",
        settings={camera_laws.NO_VALUE: max(no_values)} if no_values else {},
    )  # fmt: skip
    flagged, bunches = flag_bunched(lambda: _frames(stamped, info), times_ns)
    return ImportedRecording((info,), flagged, (*notes, *bunches))


def _kind(paths: Sequence[Path]) -> str:
    kinds = {_KINDS.get(path.suffix.lower(), "CSV") for path in paths}
    if len(kinds) > 1:
        fix = "import them from folders of their own"
        raise ConfigError("has TIFF and IRG frames", place=paths[0].parent, fix=fix)
    return kinds.pop()


def _irg_stills(paths: Sequence[Path]) -> tuple[list[_Still], list[Note]]:
    _, scales, emissivities = zip(*map(_read_irg, paths), strict=True)
    stills = [_Still(path, str(path), scale) for path, scale in zip(paths, scales, strict=True)]
    set_to = f"the camera's emissivity was {emissivities[0]:g}"
    return stills, [(Severity.WARNING, f"{set_to}; whether the counts allow for it is not known")]


def temperature_unit(written: str) -> Unit | None:
    """The unit of floating-point frames, None if none is given; raises `ConfigError` for another quantity."""
    meaning = meaning_of(written)
    if written and (meaning is None or meaning.quantity.units != TEMPERATURE):
        place, fix = Argument("unit", written), Argument("unit", "C") + ", or K, F"
        raise ConfigError("not a unit of temperature", place=place, fix=fix)
    return meaning.unit if meaning else None


def _table_stills(paths: Sequence[Path], unit: Unit | None, scale: Scale | None) -> list[_Still]:
    """The frames of tables: temperatures in the unit given, or counts where a scale is given."""
    stills = []
    for path in paths:
        for table in read_frame_tables(path):
            is_counts = not (table % 1.0).any() and table.min() >= 0.0 and table.max() <= NO_VALUE
            if unit is None and not (scale and is_counts):
                raise ConfigError("has numbers without a unit", place=path, fix=_UNIT_OF_FLOAT)
            own = _OF_FLOAT if unit else None
            numbers: AnyArray = table if unit else table.astype(np.uint16)
            stills.append(_Still(path, str(path), own, unit, table=numbers))
    return stills


def _tiff_stills(paths: Sequence[Path], unit: str) -> tuple[list[_Still], list[Note]]:
    """The pages that are frames, and notes on those that are not, and on turned ones."""
    pages = {path: _pages(path) for path in paths}
    stills = []
    for path, those in pages.items():
        for number, page in enumerate(those, start=1):
            label = f"page {number} of {len(those)} of {path}" if those[1:] else str(path)
            if page.is_frame:
                _refuse_pixels(label, math.prod(page.shape))
                stills.append(_Still(path, label, *_meaning(page, label, unit), page))
    notes = []
    if skipped := sum(map(len, pages.values())) - len(stills):
        notes.append((Severity.INFO, f"{skipped} pages are thumbnails or masks, not frames: skipped"))
    if turned := sum(still.page is not None and still.page.orientation != 1 for still in stills):
        words = f"the orientation of {turned} frames was not applied: regions are in the sensor's pixels"
        notes.append((Severity.INFO, words))
    return stills, notes


def _pages(path: Path) -> list[Page]:
    with explained(path, "cannot be read as a frame", _EXPORT_AGAIN, OSError, ValueError):
        pages = read_pages(path)
    if not any(page.is_frame for page in pages):
        raise ConfigError(f"none of {len(pages)} pages is a frame", place=path, fix=_EXPORT_AGAIN)
    return pages


def _meaning(page: Page, label: str, unit: str) -> tuple[Scale | None, Unit | None]:
    """The scale that a page states of its counts, or the unit of its temperatures.

    Raises `ConfigError` for all but one number per pixel, and for numbers that nothing explains.
    """
    stated = meaning_of(page.unit)
    own = stated.unit if stated and stated.quantity.units == TEMPERATURE else None
    is_scaled = bool(own or page.scale)
    is_counts = (page.channels, page.bits) == (1, 16) and page.kind in (_UNSIGNED, _UNDEFINED)
    if is_counts and (page.tags or not is_scaled):
        if unit:
            raise _no_unit(label)
        return Scale(page.tags.scale, page.tags.offset) if page.tags else None, None
    option = temperature_unit(unit)
    if own and option and own != option:
        problem = f"states the unit {own.shown}, not {option.shown}"
        raise ConfigError(problem, place=label, fix="omit " + Argument("unit"))
    meant = own or option
    is_number = page.channels == 1 and (page.kind == _FLOAT or (is_scaled and page.kind in _WHOLE))
    if meant and is_counts:
        gain, offset = page.scale or (1.0, 0.0)
        return Scale(gain / meant.by, (offset + meant.add) / meant.by), None
    if meant and is_number:
        return _OF_FLOAT, meant
    one = f"{page.bits}-bit {_WORDS.get(page.kind, '')}numbers"
    numbers = one if page.channels == 1 else f"{page.channels} channels"
    words = "scaled, without a unit" if is_scaled else "not one unsigned 16-bit number per pixel"
    fix: Text = _UNIT_OF_FLOAT if is_number or is_scaled else _NOT_COLOURED
    raise ConfigError(f"has {numbers}, {words}", place=label, fix=fix)


def _no_unit(place: str | Path) -> ConfigError:
    return ConfigError("holds counts, which have no unit", place=place, fix="omit " + Argument("unit"))


def _refuse_pixels(label: str, count: int) -> None:
    if count > _MOST_PIXELS:
        problem = f"claims more than {_MOST_PIXELS // 10**6} million pixels"
        raise ConfigError(problem, place=label, fix="export the frame again")


def _common_scale(stills: Sequence[_Still], given: Scale | None, kind: str) -> Scale:
    """Meaning of a count of all frames, as it is given or as their files state it."""
    stated = {repr(still.scale): still for still in stills}  # NaN, declared unknown, equals itself there
    if given is None and len(stated) > 1:
        one, other, *_ = stated.values()
        problem = f"does not state the same scale as {other.label}"
        raise ConfigError(
            problem, place=one.label, fix="import those of each scale from a folder of their own"
        )
    agreed = given or stills[0].scale
    if agreed is None:
        problem = f"what one count of these {kind} frames means is not known"
        raise ConfigError(problem, place=stills[0].path, fix=_IRG_SCALE if kind == "IRG" else _SCALE)
    for still in stated.values():
        own = still.scale  # which holds, also against temperatures declared unknown
        if own is not None and not math.isnan(own.kelvin_per_count) and agreed != own:
            given_as = f"the options {agreed.kelvin_per_count:g} and {agreed.kelvin_at_zero:g}"
            stated_as = f"{own.kelvin_per_count:g} K per count and {own.kelvin_at_zero:g} K at zero"
            fix = "omit " + Argument("kelvin_per_count") + " and " + Argument("kelvin_at_zero")
            raise ConfigError(f"states {stated_as}, {given_as}", place=still.label, fix=fix)
    return agreed


def _times_ns(
    stills: Sequence[_Still], times: Path | None, time_format: str | None, zone: tzinfo | None
) -> list[int]:
    """Time at which each frame was taken, by the one way that was given, else by its own tags."""
    by_file = given_times_ns(Counter(still.path for still in stills), times, time_format, zone)
    if by_file is not None:
        left = {path: iter(times_ns) for path, times_ns in by_file.items()}
        return [next(left[still.path]) for still in stills]
    own = [still.page.tags.time for still in stills if still.page and still.page.tags]
    if len(own) < len(stills):
        problem = "when these frames were taken is not known"
        raise ConfigError(problem, place=stills[0].path, fix=GIVE_TIMES)
    return parse_times_ns(own, zone)


def _frames(stamped: Sequence[tuple[int, _Still]], info: StreamInfo) -> Iterator[Frame]:
    """The frames, read when they are asked for."""
    empty = np.empty((0, 0), np.uint16)
    for number, (stamp, still) in enumerate(stamped):
        counts = still.counts()
        if counts.shape != info.shape:
            problem = f"has {counts.shape} pixels, the first frame {info.shape}"
            fix = "import frames of different sizes from folders of their own"
            raise ConfigError(problem, place=still.label, fix=fix)
        ends = still.unit and (counts == _HIGHEST).any()
        flags = still.flags | (Quality.SATURATED if ends else Quality.GOOD)
        yield Frame(info.name, stamp, stamp, counts, empty, flags, device_seq=number)


# --- frames ``.irg`` of InfiRay's hand-held cameras and their brandings

# A little-endian header that holds its own length and ends in ``ac ca``; the image, a byte a pixel; the same
# frame as 16-bit temperatures; then what the model adds. Three public readers agree on that
# (jaseg/infiray_irg, jelle737/Vevor-Thermal-Utilities, povlhp/irgdump). On what a count means they agree for
# headers that begin ``ba ab`` or ``b0 0b``: a tenth of a kelvin. Those that begin ``ca ac`` hold sixteenths
# or tenths, by the model, which the file does not name.
_IRG_SCALES = {b"\xba\xab": Scale(0.1), b"\xb0\x0b": Scale(0.1), b"\xca\xac": None}
_END_MARK = b"\xac\xca"
_HEAD = struct.Struct("<2sHIHH")
_EMISSIVITY_AT, _SHORTEST_HEADER = 0x1E, 0x22
_MOST_IRG_PIXELS = 1 << 22


def _read_irg(path: Path) -> tuple[CountArray, Scale | None, float]:
    """Counts (rows, cols), their scale (None where the file lacks it), the emissivity set in the camera.

    Raises `ConfigError` where the file is no such frame, or is cut short.
    """
    with explained(path, "cannot read", "check the path of the folder", OSError), path.open("rb") as file:
        data = file.read(0x10000 + 3 * _MOST_IRG_PIXELS)
    if len(data) < _HEAD.size or data[:2] not in _IRG_SCALES:
        raise _refusal(path, "it does not begin as one")
    magic, length, preview, rows, cols = _HEAD.unpack_from(data)
    if length < _SHORTEST_HEADER or data[length - 2 : length] != _END_MARK:
        raise _refusal(path, "its header does not end as one")
    if not 0 < rows * cols == preview <= _MOST_IRG_PIXELS or len(data) < length + 3 * preview:
        raise _refusal(path, f"{rows} x {cols} pixels are not in it")
    counts = np.frombuffer(data, "<u2", rows * cols, length + preview).reshape(rows, cols)
    (emissivity,) = struct.unpack_from("<I", data, _EMISSIVITY_AT)
    return counts.astype(np.uint16), _IRG_SCALES[magic], emissivity / 1e4


def _refusal(path: Path, why: str) -> ConfigError:
    return ConfigError(
        f"not a known .irg frame: {why}",
        place=path,
        fix="export it from the camera's program as 16-bit TIFF, and import that",
    )
