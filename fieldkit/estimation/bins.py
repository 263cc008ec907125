"""Minute bins: the statistics kept of the samples, and all that an estimate is made from.

A bin collects samples in any order and closes once. Frames are summed as whole numbers, so the order of
addition cannot change a sum; readings are sorted by time first. Live, replayed and batch bins are therefore
equal to the last bit. Nothing here depends on slopes.

Samples that are not usable (`fieldkit.model.samples.UNUSABLE`) are excluded from the sums; their flags stay
on the bin.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, reduce
from operator import or_
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.following import GroundFollower, RegionFollower
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import AnyArray, BoolArray, FloatArray, IndexArray, IntArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.limits import bounds_of
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import Frame, Quality, Reading, is_usable
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.camera_laws import NO_VALUE, frame_k
from fieldkit.physics.facet import normal
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.physics.trajectory import CameraPath

LAW_STEP_K = 0.01  # finer than the noise of a pixel; whole numbers add up the same in any order


@dataclass(frozen=True, slots=True)
class MinuteBin:
    """One closed minute bin; arrays per region in the order of the regions, NaN without frames.

    The minute is no parameter: the stores of a layer (`fieldkit.physics.layer_modes`), the time constants and
    noises of the learned model and of the disturbances, the shade ledger and all files count in minutes of
    UTC. Another length would be another estimator, to be tested anew; `window_s` chooses how many count.

    Attributes
    ----------
    minute
        Minutes since 1970 UTC. [min]
    time_ns
        Mean UTC time of the frames used, or the middle of the minute. [ns]
    sun
        Unit vector towards the sun at `time_ns`, (3,), east, north, up. [-]
    temperature_k, spread_k
        Surface temperature; its standard deviation over the pixels. [K]
    pixels, frames
        Pixels of each region, and frames used.
    dni_w_m2, dhi_w_m2, longwave_down_w_m2
        Direct normal and diffuse horizontal irradiance, downward longwave; NaN where not measured. [W/m2]
    illuminance_lx
        Mean of the light meter. [lx]
    contact_k
        Mean of every channel of the contact thermometers. [K]
    flags, region_flags
        Quality of the whole bin, and of single regions.
    air_k, wind_m_s
        Air temperature and wind speed; NaN where not measured. [K], [m/s]
    probe_k
        Mean of the contact thermometers in each region, in the order of the regions; NaN without, empty if no
        region has one. [K]
    reflagged
        Minutes and region columns of earlier bins whose `SHADED` flag is reversed from this bin on: shade
        that shows or is marked afterwards.
    shift_px
        By how much the content of the last frame lay off where the regions were drawn. [pixels]
    """

    minute: int
    time_ns: int
    sun: FloatArray
    temperature_k: FloatArray
    spread_k: FloatArray
    pixels: IntArray
    frames: int
    dni_w_m2: float
    illuminance_lx: float = float("nan")
    dhi_w_m2: float = float("nan")
    longwave_down_w_m2: float = float("nan")
    contact_k: tuple[float, ...] = ()
    flags: Quality = Quality.GOOD
    region_flags: tuple[Quality, ...] = ()
    air_k: float = float("nan")
    wind_m_s: float = float("nan")
    probe_k: FloatArray = field(default_factory=lambda: np.empty(0))
    reflagged: tuple[tuple[int, int], ...] = ()
    shift_px: float = 0.0

    @property
    def start_ns(self) -> int:
        """UTC nanoseconds at which the minute begins."""
        return self.minute * MINUTE_NS


def pad(values: AnyArray, columns: int, fill: float = math.nan) -> AnyArray:
    """Values of a bin in so many columns, of which it was made before the last were drawn."""
    return np.append(values, np.full(columns - values.size, fill, values.dtype))


class Sums(NamedTuple):
    """Sum, sum of squares and number of the pixels of each region in one frame."""

    totals: list[int]
    squares: list[int]
    pixels: list[int]


class RegionPixels:
    """Regions flattened once into pixel indices, so that a frame costs one gather."""

    def __init__(self, regions: Sequence[Region], shape: tuple[int, int]) -> None:
        self._hold([_pixels_of(region, shape) for region in regions], shape)

    def shift(self, steps: IntArray, redrawn: Mapping[int, Region] = MappingProxyType({})) -> RegionPixels:
        """The regions moved by whole pixels to the right and down (n, 2); one that leaves the frame is empty.

        They keep their shape and their number of pixels, so regions at rest give the same sums to the bit.
        Those in `redrawn`, by their place, have new corners; one without corners is empty.
        """
        if not (steps.any() or redrawn):
            return self
        other = copy(self)
        masks = [self._shift_mask(*mask_and_step) for mask_and_step in zip(self._masks, steps, strict=True)]
        for place, region in redrawn.items():
            masks[place] = _pixels_of(region, self._shape)
        other._hold(masks, self._shape)
        return other

    def _shift_mask(self, mask: IndexArray, step: IntArray) -> IndexArray:
        rows, cols = np.divmod(mask, self._shape[1])
        rows, cols = rows + step[1], cols + step[0]
        inside = (rows >= 0) & (rows < self._shape[0]) & (cols >= 0) & (cols < self._shape[1])
        return np.asarray(rows * self._shape[1] + cols if inside.all() else mask[:0], np.intp)

    def _hold(self, masks: list[IndexArray], shape: tuple[int, int]) -> None:
        self._masks, self._shape = masks, shape
        self.pixels: IntArray = np.array([mask.size for mask in masks], np.int64)
        self._indices = np.concatenate([*masks, np.array([], np.intp)])  # without regions, too
        # an empty region would make reduceat repeat its neighbour, so only the others are summed
        self._filled = np.flatnonzero(self.pixels)
        self._starts = (np.cumsum(self.pixels) - self.pixels)[self._filled]

    def gather(self, frame: AnyArray) -> AnyArray:
        """The pixels of all regions, one region after the other."""
        return np.asarray(frame.ravel()[self._indices])

    def sums(self, numbers: AnyArray, possible: tuple[float, float] = (-math.inf, math.inf)) -> Sums:
        """Sums over each region of a frame of whole numbers, exact in float64, of the pixels that can be."""
        totals, squares, pixels = np.zeros((3, self.pixels.size))
        if self._filled.size:
            values = self.gather(numbers).astype(np.float64)
            pixels[self._filled] = self.pixels[self._filled]
            can_be = (values >= possible[0]) & (values <= possible[1])
            if not can_be.all():  # a dead pixel would move the mean by kelvins
                pixels[self._filled] = np.add.reduceat(can_be.astype(np.float64), self._starts)
                values[~can_be] = 0.0
            totals[self._filled] = np.add.reduceat(values, self._starts)
            values *= values
            squares[self._filled] = np.add.reduceat(values, self._starts)
        return Sums(*([int(value) for value in sums] for sums in (totals, squares, pixels)))


def _pixels_of(region: Region, shape: tuple[int, int]) -> IndexArray:
    """Flat indices of its pixels, in order; none without corners."""
    if not region.points_px:
        return np.empty(0, np.intp)
    box = region.box(shape)
    rows, cols = np.nonzero(region.mask(shape, box))
    return np.asarray((rows + box[0].start) * shape[1] + cols + box[1].start, np.intp)


class RegionSums:
    """Whole-number sums over the frames of one bin.

    `seen` are the frames in which a region lay, `samples` its pixels in them.
    """

    def __init__(self, regions: int) -> None:
        self.regions = regions
        self.frames: int = 0
        self.offset_ns: int = 0
        self.seen: list[int] = [0] * regions
        self.samples: list[int] = [0] * regions
        self.totals: list[int] = [0] * regions
        self.squares: list[int] = [0] * regions

    def add(self, sums: Sums, offset_ns: int) -> None:
        """Add one frame's sums over the regions, taken `offset_ns` after the minute's start."""
        self.frames += 1
        self.offset_ns += offset_ns
        for index, (total, square, pixels) in enumerate(zip(*sums, strict=True)):
            self.seen[index] += pixels > 0
            self.samples[index] += pixels
            self.totals[index] += total
            self.squares[index] += square


class CameraStream:
    """A camera stream that feeds the bins: its law, its regions by column, its conversion to kelvin.

    Counts of a linear law are summed as they are; other laws give kelvin frame by frame, which are summed in
    whole hundredths, finer than the noise of one pixel.
    """

    def __init__(self, info: StreamInfo, regions: Mapping[int, Region], settings: EstimatorSettings) -> None:
        self.info = info
        self.columns: IntArray = np.array(list(regions), np.int64)
        self.regions: tuple[Region, ...] = tuple(regions.values())
        self.outline: RegionPixels = RegionPixels(self.regions, (info.shape[0], info.shape[1]))
        emissivities = np.array([region.emissivity for region in self.regions], np.float64)
        self._emissivity = np.where(np.isnan(emissivities), settings.surface.emissivity, emissivities)
        self._reflected_k = settings.reflected_temperature_k
        self._is_linear = info.law == "linear"
        self._scale = info.scale if self._is_linear else LAW_STEP_K
        self._offset = info.offset if self._is_linear else 0.0
        bounds = bounds_of(info, settings.limits)
        ends = sorted(
            (float(kelvin) - self._offset) / self._scale for kelvin in (bounds.low[0], bounds.high[0])
        )
        self._possible = (ends[0], ends[1]) if np.isfinite(self._scale) else (-math.inf, math.inf)

    def sums(self, frame: Frame, outline: RegionPixels) -> Sums | None:
        """Sums over the regions of a frame, of those that can be; None if the law gives none of them."""
        if self._is_linear:
            counts: AnyArray = frame.counts
            if (no_value := self.info.settings.get(NO_VALUE)) is not None:
                counts = np.where(counts == no_value, np.nan, counts)
            return outline.sums(counts, self._possible)
        kelvin = frame_k(self.info, frame.counts, frame.metadata_rows, np.float32)
        if not np.isfinite(outline.gather(kelvin)).any():
            return None
        steps = np.rint(np.nan_to_num(kelvin, nan=-1.0) / LAW_STEP_K)  # below any limit
        return outline.sums(steps.astype(np.int64), self._possible)

    def mean_pixels(self, sums: RegionSums) -> IntArray:
        """Pixels of each region in the frames in which it lay, else those of its outline."""
        seen, samples = np.array(sums.seen, np.int64), np.array(sums.samples, np.int64)
        return np.where(seen > 0, samples // np.maximum(seen, 1), self.outline.pixels)

    def means(self, sums: RegionSums) -> tuple[FloatArray, FloatArray]:
        """Surface temperature of each region, and its spread over pixels, kelvin."""
        mean, spread = np.full((2, sums.regions), np.nan)
        for index in np.flatnonzero(sums.samples) if np.isfinite(self._scale) else ():
            total, n = sums.totals[index], sums.samples[index]
            mean[index] = total / n
            # integer numerators: no cancellation in the variance of large counts
            spread[index] = np.sqrt((n * sums.squares[index] - total * total) / (n * n))
        kelvin = surface_temperature_k(mean * self._scale + self._offset, self._emissivity, self._reflected_k)
        return kelvin, spread * abs(self._scale)


class Follower:
    """Places of regions in each frame: those on the ground by the camera's pose, the others by the frames."""

    def __init__(self, path: CameraPath | None = None) -> None:
        self._drawn = RegionFollower()
        self._ground = None if path is None else GroundFollower(path)

    @property
    def shift_px(self) -> float:
        """Shift of the last frame that was followed from the one in which regions were drawn. [pixels]."""
        return max(self._drawn.shift_px, self._ground.shift_px if self._ground is not None else 0.0)

    @property
    def loss(self) -> str:
        """Reason why the last frame was not followed."""
        if self._ground is not None and not self._ground.has_pose:
            return "the trajectory has no pose of this time"
        return "the camera moved too far to be followed"

    def update(self, frame: Frame, camera: CameraStream) -> RegionPixels | None:
        """The pixels of the regions in a frame; None where they cannot be found."""
        columns = camera.columns
        if self._ground is None:
            steps = self._drawn.update(frame.counts, columns)
            return None if steps is None else camera.outline.shift(steps)
        pinned = np.flatnonzero([bool(region.points_m) for region in camera.regions])
        free = np.setdiff1d(np.arange(columns.size), pinned)
        chosen = [camera.regions[place] for place in pinned]
        shifts = self._ground.update(frame.counts, frame.time_ns, chosen, columns[pinned])
        steps = np.zeros((columns.size, 2), np.int64)
        moved = self._drawn.update(frame.counts, columns[free])
        if shifts is None or moved is None:
            return None
        steps[free] = moved
        return camera.outline.shift(steps, dict(zip(pinned.tolist(), shifts, strict=True)))


class CameraBin:
    """The frames of one camera in a bin while they arrive, in any order."""

    def __init__(self, minute: int, camera: CameraStream) -> None:
        self.camera = camera
        self.sums: RegionSums = RegionSums(camera.columns.size)
        self.flags: Quality = Quality.GOOD
        self.last_frame: Frame | None = None
        self.loss: str = ""
        self.shift_px: float = 0.0
        self._start_ns = minute * MINUTE_NS

    def add_frame(self, frame: Frame, follower: Follower | None = None) -> None:
        """Sum a frame over the regions where they lie in it, unless its flags or its law exclude it.

        One in which they cannot be found is flagged and not summed.
        """
        self.flags |= frame.quality
        if not is_usable(frame.quality):
            return
        outline: RegionPixels | None = self.camera.outline
        if follower is not None:
            outline = follower.update(frame, self.camera)
            # frames may come out of order; the last one in time says where the camera looks now
            if self.last_frame is None or frame.time_ns > self.last_frame.time_ns:
                self.last_frame, self.shift_px = frame, follower.shift_px
                self.loss = follower.loss if outline is None else ""
        if outline is None:
            self.flags |= Quality.MOVED
        elif (sums := self.camera.sums(frame, outline)) is not None:
            self.sums.add(sums, frame.time_ns - self._start_ns)

    @property
    def not_whole(self) -> set[int]:
        """Columns of regions that did not lie wholly in each of the frames used."""
        seen = zip(self.camera.columns.tolist(), self.sums.seen, strict=True)
        return {column for column, frames in seen if frames < self.sums.frames}


class OpenBin:
    """One bin while its samples arrive, in any order; `columns` are the regions that hold in its minute."""

    def __init__(self, minute: int, columns: IntArray, cameras: Iterable[CameraStream] = ()) -> None:
        self.minute = minute
        self.columns = columns
        self.cameras: dict[str, CameraBin] = {
            camera.info.name: CameraBin(minute, camera) for camera in cameras
        }
        self.readings: dict[str, list[Reading]] = defaultdict(list)

    @property
    def flags(self) -> Quality:
        """Flags of all frames."""
        return Quality(reduce(or_, (frames.flags for frames in self.cameras.values()), 0))

    @property
    def lost(self) -> set[int]:
        """Columns of the regions whose camera moved too far to be followed."""
        moved = (frames for frames in self.cameras.values() if frames.flags & Quality.MOVED)
        return {int(column) for frames in moved for column in frames.camera.columns}

    @property
    def frames(self) -> int:
        """Number of the frames used."""
        return sum(frames.sums.frames for frames in self.cameras.values())

    @property
    def last_frame(self) -> Frame | None:
        """The last frame that was followed."""
        followed = [frames.last_frame for frames in self.cameras.values() if frames.last_frame is not None]
        return max(followed, key=lambda frame: frame.time_ns, default=None)

    @property
    def loss(self) -> str:
        """Reason why a camera's last frame was not followed."""
        return next((frames.loss for frames in self.cameras.values() if frames.loss), "")

    @property
    def shift_px(self) -> float:
        """Largest shift of a camera's last frame. [pixels]."""
        return max((frames.shift_px for frames in self.cameras.values()), default=0.0)

    @property
    def not_whole(self) -> set[int]:
        """Columns of regions that did not lie wholly in each of the frames used."""
        return set().union(*(frames.not_whole for frames in self.cameras.values()))

    def add_reading(self, reading: Reading) -> None:
        """Keep a reading until the minute closes."""
        self.readings[reading.stream].append(reading)

    @property
    def time_ns(self) -> int:
        """Mean time of the frames used, else of the last one that was lost, else the middle of the minute."""
        if self.loss and self.last_frame is not None and not self.frames:
            return self.last_frame.time_ns
        start, offset_ns = self.minute * MINUTE_NS, sum(part.sums.offset_ns for part in self.cameras.values())
        return start + (offset_ns // self.frames if self.frames else MINUTE_NS // 2)

    def sorted_readings(self, stream: str) -> list[Reading]:
        """Readings of one stream by time, equal times by value: independent of the order of arrival."""
        return sorted(self.readings.get(stream, []), key=lambda r: (r.time_ns, r.values, r.quality))


@dataclass(frozen=True)
class RegionColumns:
    """The regions as columns of a history: which are references, which are targets."""

    regions: tuple[Region, ...]

    @cached_property
    def references(self) -> IntArray:
        """Columns of the references."""
        return self._columns(RegionKind.REFERENCE)

    @cached_property
    def targets(self) -> IntArray:
        """Columns of the targets."""
        return self._columns(RegionKind.TARGET)

    @cached_property
    def reference_normals(self) -> FloatArray:
        """Unit normals of the references, (r, 3); one without a tilt is level."""
        references = [self.regions[column] for column in self.references]
        angles = [(reference.tilt_deg, reference.azimuth_deg) for reference in references]
        return normal(*np.nan_to_num(np.reshape(angles, (-1, 2)).T))

    def _columns(self, kind: RegionKind) -> IntArray:
        return np.array([i for i, region in enumerate(self.regions) if region.kind == kind], np.int64)


# columns of a history by type: a bin is a row
_WHOLE = ("minute", "time_ns", "flags")
_REAL = ("dni_w_m2", "dhi_w_m2", "longwave_down_w_m2", "air_k", "wind_m_s", "shift_px")


@dataclass(frozen=True, slots=True)
class History:
    """Bins side by side: arrays over minutes (n,), minutes and regions (n, regions), suns (n, 3).

    What a set-up need not measure is NaN where it is not given; without flags all is good. `region_flags` are
    as the bins closed; shade that was found, marked or dismissed afterwards is entered in `shade_ledger`
    (k, 3): the minute in which that became known, minute and column of the `SHADED` flag that it reverses.
    """

    minute: IntArray
    time_ns: IntArray
    sun: FloatArray
    temperature_k: FloatArray
    dni_w_m2: FloatArray
    dhi_w_m2: FloatArray = field(default_factory=lambda: np.empty(0))
    longwave_down_w_m2: FloatArray = field(default_factory=lambda: np.empty(0))
    flags: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    region_flags: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    air_k: FloatArray = field(default_factory=lambda: np.empty(0))
    wind_m_s: FloatArray = field(default_factory=lambda: np.empty(0))
    probe_k: FloatArray = field(default_factory=lambda: np.empty(0))
    shift_px: FloatArray = field(default_factory=lambda: np.empty(0))
    shade_ledger: IntArray = field(default_factory=lambda: np.empty((0, 3), np.int64))

    def __post_init__(self) -> None:
        shapes = dict.fromkeys((*_REAL, "flags"), self.dni_w_m2.shape)
        shapes |= dict.fromkeys(("probe_k", "region_flags"), self.temperature_k.shape)
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                object.__setattr__(self, name, np.full(shape, 0 if "flags" in name else np.nan))

    @classmethod
    def of(cls, bins: Sequence[MinuteBin], columns: int = 0) -> History:
        """Stack bins in order of time, in `columns` or as many as they have.

        A region that was drawn later is without frames before.
        """
        regions = max((b.temperature_k.size for b in bins), default=columns)
        by_minute: dict[str, AnyArray] = {
            name: np.array([getattr(b, name) for b in bins], kind)
            for kind, names in ((np.int64, _WHOLE), (np.float64, _REAL))
            for name in names
        }
        entries = [(b.minute, *cell) for b in bins for cell in b.reflagged]
        flags = [pad(np.array(b.region_flags, np.int64), regions, 0) for b in bins]
        shape = (len(bins), regions)
        return cls(
            **by_minute,
            sun=np.array([b.sun for b in bins], np.float64).reshape(-1, 3),
            temperature_k=np.array([pad(b.temperature_k, regions) for b in bins], float).reshape(shape),
            region_flags=np.array(flags, np.int64).reshape(shape),
            probe_k=np.array([pad(b.probe_k, regions) for b in bins], float).reshape(shape),
            shade_ledger=np.array(entries, np.int64).reshape(-1, 3),
        )

    def __len__(self) -> int:
        return self.minute.size

    def plus(self, entry: MinuteBin) -> History:
        """The same with one bin more, which may have regions that were drawn since."""
        parts = self, History.of([entry])
        columns = [part.temperature_k.shape[1] for part in parts]
        return join(
            [part.spread(range(count), max(columns)) for part, count in zip(parts, columns, strict=True)]
        )

    def arrays(self) -> dict[str, AnyArray]:
        """Every array by its name; ``History(**arrays)`` is the same history."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def at(self, rows: slice | IntArray) -> History:
        """Some of the rows, given by index."""
        by_row = {name: values for name, values in self.arrays().items() if name != "shade_ledger"}
        return replace(self, **{name: values[rows] for name, values in by_row.items()})

    def since(self, first: int) -> History:
        """The rows from index `first` on."""
        return self.at(slice(first, None))

    def until(self, last: int) -> History:
        """The rows before index `last`."""
        return self.at(slice(last))

    def only(self, columns: IntArray) -> History:
        """Some of the regions, given as columns."""
        if np.array_equal(columns, np.arange(self.temperature_k.shape[1])):
            return self  # the usual case, at every minute: nothing is copied
        chosen = {
            name: getattr(self, name)[:, columns] for name in ("temperature_k", "region_flags", "probe_k")
        }
        places = {int(column): place for place, column in enumerate(columns)}
        ledger = [(*cell, places[at]) for *cell, at in self.shade_ledger.tolist() if at in places]
        return replace(self, **chosen, shade_ledger=np.array(ledger, np.int64).reshape(-1, 3))

    def at_last(self, schedule: RegionSchedule) -> tuple[History, tuple[Region, ...]]:
        """The bins of the regions that hold in the last minute, and these."""
        last = int(self.minute[-1]) if len(self) else 0
        return self.only(schedule.at(last)), schedule.regions_at(last)

    def averaged(self, minutes: int, holds: BoolArray) -> tuple[History, BoolArray]:
        """Means over groups of `minutes`, without the group of the last minute, which is still open.

        Temperatures, sun and weather; and for each mean whether a condition, `holds` (n,), is met throughout.
        """
        group = self.minute // minutes
        past = self.at(np.flatnonzero(group < group.max(initial=0)))
        first = np.unique(group[: len(past)], return_index=True)[1]
        means = {name: group_means(getattr(past, name), first) for name in ("sun", "temperature_k", *_REAL)}
        since_ns = group_means((past.time_ns - self.time_ns[0]).astype(np.float64), first)
        moments = {"minute": past.minute[first], "time_ns": self.time_ns[0] + since_ns.astype(np.int64)}
        is_met = group_means(holds[: len(past)].astype(np.float64), first) == 1.0
        return History(**moments, **means), is_met  # type: ignore[arg-type]

    def spread(self, places: Sequence[int], regions: int) -> History:
        """The same with its columns at some places among `regions`; the others are without frames."""
        by_region = {
            name: np.full((len(self), regions), empty, getattr(self, name).dtype)
            for name, empty in (("temperature_k", np.nan), ("probe_k", np.nan), ("region_flags", 0))
        }
        for name, values in by_region.items():
            values[:, list(places)] = getattr(self, name)
        ledger = self.shade_ledger.copy()
        ledger[:, 2] = np.array(places, np.int64)[ledger[:, 2]]
        return replace(self, **by_region, shade_ledger=ledger)

    def is_shaded(self) -> BoolArray:
        """Regions that alone are in the shade (n, regions), as known at the last minute."""
        shaded: BoolArray = (self.region_flags & int(Quality.SHADED)) != 0
        is_past = self.shade_ledger[:, 0] <= self.minute.max(initial=0)
        _, minute, column = self.shade_ledger[is_past].T
        rows, entries = np.nonzero(self.minute[:, np.newaxis] == minute)
        # a flag may be reversed twice: shade that was found, and dismissed by a mark
        np.logical_xor.at(shaded, (rows, column[entries]), True)
        return shaded

    def in_place(self) -> History:
        """Without temperatures of regions in minutes in which their camera was lost for a while."""
        # a region alone is flagged also where it left the frame: it then keeps the frames in which it lay
        is_lost = (self.flags[:, np.newaxis] & self.region_flags & int(Quality.MOVED)) != 0
        if not is_lost.any():
            return self
        return replace(self, temperature_k=np.where(is_lost, np.nan, self.temperature_k))

    def last_flags(self, column: int) -> Quality:
        """Flags of a region at the last minute: the minute's, without a movement of another camera."""
        flags = Quality(int(self.flags[-1])) & ~Quality.MOVED
        return flags | Quality(int(self.region_flags[-1, column]))


def join(parts: Sequence[History]) -> History:
    """Histories of the same columns as one, in the order given."""
    arrays = [part.arrays() for part in parts]
    return History(**{name: np.concatenate([array[name] for array in arrays]) for name in arrays[0]})


def group_means(values: FloatArray, start: IndexArray) -> FloatArray:
    """Means of the groups of rows (n,) or (n, m) that begin at `start` (k,), without NaN."""
    if not start.size:
        return values[:0]
    is_finite = np.isfinite(values)
    total = np.add.reduceat(np.where(is_finite, values, 0.0), start, axis=0)
    count = np.add.reduceat(is_finite.astype(np.int64), start, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
