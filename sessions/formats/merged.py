"""A new session of an old one and a recording that was made beside it; the old one stays as it is."""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import chain, product
from pathlib import Path

import h5py
import numpy as np

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.device import StreamInfo, find_camera
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.limits import bounds_of
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Event, EventKind, Quality, Reading, Sample, Severity, is_damaged, is_usable
from fieldkit.model.site import Region, apart_m
from fieldkit.phrases import counted
from fieldkit.sessions.analysis import region_series
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.formats.imported import (
    ImportedRecording,
    ReadAgain,
    StampedClock,
    free_name,
    write_stamped,
)
from fieldkit.sessions.layout import FORMAT_NAME, SessionHeader
from fieldkit.sessions.reader import SessionReader, attribute
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.time_map import TimeStep, added_ns, mapped_event, recorded_event, recorded_mono_ns


def cut_session(session: SessionReader, imported: ImportedRecording) -> ImportedRecording:
    """Part of a recording that belongs to the session's time, and two intervals more on either side."""
    margin_ns = {info.name: round(2e9 / info.rate_hz) if info.rate_hz else 0 for info in imported.streams}
    first_ns, last_ns = session.start_ns, session.end_ns

    def is_within(sample: Sample) -> bool:
        more_ns = margin_ns[sample.stream]
        return first_ns - more_ns <= sample.time_ns <= last_ns + more_ns

    part = ReadAgain(lambda: filter(is_within, imported.samples))
    if not (excluded := sum(1 for _ in imported.samples) - sum(1 for _ in part)):
        return imported
    text = f"{excluded} samples from before or after the session were excluded"
    return replace(imported, samples=part).noted(text, Severity.INFO)


def merge(session: SessionReader, imported: ImportedRecording, path: Path, source: str) -> SealReport:
    """Write `session` with the streams of `imported` as a new session at `path`, and seal it.

    Raises `ConfigError` where a stream of that name is there, or the times do not meet, `SessionError`
    where the session is not finished: a part of it would be missing from the new one for good.
    """
    session.require_finished()
    if common := {info.name for info in imported.streams} & set(session.streams):
        problem, fix = f"a stream {common.pop()!r} already", "give another " + Argument("name")
        raise ConfigError(problem, place=session.path, fix=fix)
    time_ns = [sample.time_ns for sample in imported.samples]
    if not time_ns or max(time_ns) < session.start_ns or min(time_ns) > session.end_ns:
        fix = "check " + Argument("zone") + " and " + Argument("offset_s") + " of the logger"
        raise ConfigError(f"and {session.path} do not overlap in time", place=source, fix=fix)
    header = replace(session.header, streams=(*session.header.streams, *imported.streams))
    began_ns = session.identity.start_ns
    # the regions drawn before the start are in the header
    entries = (
        entry
        for entry in session.entries()
        if not isinstance(entry, RegionRecord) or entry.time_ns > began_ns
    )
    notes = ((Severity.INFO, f"stream added from {source}"), *imported.notes)
    events = [Event(EventKind.IMPORTED, 0, 0, text, "", severity) for severity, text in notes]
    return write_together(session, header, entries, imported.samples, path, events, session.start_ns)


def write_together(
    session: SessionReader,
    header: SessionHeader,
    entries: Iterable[Entry],
    added: Iterable[Sample],
    path: Path,
    notes: Iterable[Event],
    start_ns: int,
) -> SealReport:
    """Write the samples of a session and those added to it as a new session, and seal it.

    `entries` are as the session's clocks recorded them; `notes` are events of its start, at `start_ns`.
    """
    steps = session.time_map()
    clock = StampedClock(recorded_mono_ns(steps, start_ns, session.anchor_ns), session.anchor_ns)
    now = clock.mono_ns()
    at_start = (replace(note, mono_ns=now, time_ns=clock.to_utc_ns(now)) for note in notes)
    # all by the session's clocks, to which the added ones are moved
    moved = (_move(sample, steps, session.anchor_ns) for sample in added)
    samples = heapq.merge(session.samples(recorded=True), moved, key=lambda sample: sample.mono_ns)
    report = write_stamped(path, header, clock, chain(entries, at_start), samples)
    if steps:
        apply_time_map(path, steps)
    return report


def _move(sample: Sample, steps: list[TimeStep], anchor_ns: int) -> Sample:
    """A sample whose time the session's time map will make what it was."""
    mono_ns = recorded_mono_ns(steps, sample.time_ns, anchor_ns)
    return sample._replace(mono_ns=mono_ns, time_ns=sample.time_ns - added_ns(steps, mono_ns))


# --- a log whose clock was off, moved onto the time series that a session has of the same quantity

_ZONE_S = 1500.0
GIVE_OFFSET = "give it, such as " + Argument("offset_s", 12)


def align(session: SessionReader, imported: ImportedRecording) -> ImportedRecording:
    """The log with its times moved onto the session's series of the same quantity; a note gives the offset.

    Raises `NoAnswerError` where no stream of the session determines the offset.
    """
    readings = [sample for sample in imported.samples if isinstance(sample, Reading)]
    alignment = _best_alignment(session, imported.streams, readings)
    shift_ns = alignment.offset_ns
    shifted = [
        reading._replace(time_ns=reading.time_ns + shift_ns, mono_ns=reading.mono_ns + shift_ns)
        for reading in readings
    ]
    aligned = replace(imported, samples=shifted).noted(str(alignment), Severity.INFO)
    is_drift = abs(alignment.offset_s) <= _ZONE_S
    text = "too much for a clock's drift: check its zone and summer time"
    return aligned if is_drift else aligned.noted(text)


def _best_alignment(
    session: SessionReader, streams: Sequence[StreamInfo], readings: Sequence[Reading]
) -> Alignment:
    """The time series that determines the offset of the log best, whichever of its streams it is of."""
    start_ns = session.start_ns
    alignments, why = [], ""
    for info in streams:
        own = [reading for reading in readings if reading.stream == info.name]
        values = np.array([reading.values for reading in own], np.float64).reshape(-1, *info.shape)
        usable = bounds_of(info).usable(values, np.array([reading.quality for reading in own], np.int64))
        log = _time_series([reading.time_ns for reading in own], usable, start_ns)
        for name, series in _all_series(session, info.quantity, start_ns):
            try:
                alignments.append(replace(best_offset(log, series), source=f"found on {name}"))
            except NoAnswerError as error:
                why = f"{name}: {error.message}"
    if not alignments:
        quantities = " or ".join(info.quantity for info in streams)
        problem = f"does not determine the log's offset: {why or f'it has no time series of {quantities}'}"
        raise NoAnswerError(problem, place=session.path, fix=GIVE_OFFSET)
    return min(alignments, key=lambda alignment: alignment.uncertainty_s)


def _all_series(session: SessionReader, quantity: str, start_ns: int) -> Iterator[tuple[str, TimeSeries]]:
    """The session's time series of a quantity: meters, and for temperatures the regions of its frames."""
    for name, info in session.streams.items():
        if info.quantity == quantity and not info.is_camera and session.count(name):
            yield name, stream_series(session, name, start_ns)
        if info.quantity == "brightness_temperature" and quantity == "temperature" and session.count(name):
            series = region_series(session, stream=name)
            good = is_usable(series.flags)
            for number, region in enumerate(series.regions):
                kelvin = series.mean_k[good, number, np.newaxis]
                if kelvin.size and np.isfinite(kelvin).all():
                    yield f"region {region} of {name}", _time_series(series.time_ns[good], kelvin, start_ns)


def stream_series(session: SessionReader, name: str, start_ns: int) -> TimeSeries:
    """The usable means over the channels of a meter, in seconds since a moment."""
    readings = session.readings(name)
    good = is_usable(readings.flags)
    return _time_series(readings.time_ns[good], readings.values[good], start_ns)


def _time_series(time_ns: Sequence[int] | IntArray, values: FloatArray, start_ns: int) -> TimeSeries:
    """Means over the channels where there are any, in order of time, the least of each moment."""
    has_value = np.isfinite(values).any(axis=1)
    means, stamps_ns = np.nanmean(values[has_value], axis=1), np.array(time_ns, np.int64)[has_value]
    order = np.lexsort((means, stamps_ns))
    times, first = np.unique((stamps_ns[order] - start_ns) / 1e9, return_index=True)
    return TimeSeries(times, means[order][first])


# --- the offset between two clocks that recorded the same time series

# For each offset tried the reference is fitted by ``a + b * log(time - offset)``, b > 0, because two sensors
# seldom agree in level and gain. The offset is where that fits best, if it does so distinctly better than
# anywhere else; its uncertainty follows from excluding one interval after the other.
LONGEST_OFFSET_S = 15 * 3600.0  # wrong zones; date lines are not mistaken for clocks
_LEAST_FIT = 0.7  # of the variance
_DISTINCT = 2.0  # anywhere else, at least so much more must be left over
_LEFT_OVER = 0.005  # no two sensors agree better
_OF_A_STEP = 0.05  # between two readings the log is a straight line
_LEAST_POINTS, _COARSE_POINTS, _MOST_POINTS = 20, 400, 20_000
_MOST_PEAKS, _FINE_OFFSETS, _BLOCKS, _REACH = 8, 81, 10, 3.0
_LEAST_COARSE_S, _MOST_UNCERTAIN_S = 1.0, 60.0
_FIX = "use a longer interval with clouds or a shadow, or give " + Argument("offset_s", 12)


@dataclass(frozen=True, slots=True)
class TimeSeries:
    """A measured quantity over time, in order: seconds since any moment, values in any unit."""

    time_s: FloatArray
    value: FloatArray

    @property
    def step_s(self) -> float:
        """The usual interval."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True, slots=True)
class Alignment:
    """Offset to add to a log's times: seconds, their expanded uncertainty (k=2), the correlation there.

    `source` is what it was found on. What is not known is NaN: of an offset that was stated, the uncertainty.
    """

    offset_s: float
    uncertainty_s: float
    correlation: float
    source: str = ""

    @property
    def offset_ns(self) -> int:
        """The offset in nanoseconds."""
        return round(self.offset_s * 1e9)

    def __str__(self) -> str:
        uncertainty = "" if math.isnan(self.uncertainty_s) else f" ± {self.uncertainty_s:.1f} s (k=2)"
        correlation = "" if math.isnan(self.correlation) else f", correlation {self.correlation:.3f}"
        return f"clock offset {self.offset_s:+.1f} s{uncertainty} {self.source}{correlation}"


def best_offset(log: TimeSeries, reference: TimeSeries) -> Alignment:
    """The offset at which a log's time series matches the reference's.

    Raises `NoAnswerError` where too little overlaps, nothing fits, or more than one offset does.
    """
    span = float(np.ptp(reference.time_s)) if reference.time_s.size else 0.0
    if min(log.time_s.size, reference.time_s.size) < _LEAST_POINTS:
        problem = f"an offset needs {_LEAST_POINTS} points of both time series at least"
        raise NoAnswerError(problem, fix=GIVE_OFFSET)
    finest = 2.0 * max(log.step_s, reference.step_s, span / _MOST_POINTS)
    coarse = max(finest, span / _COARSE_POINTS, _LEAST_COARSE_S)
    first, last = _earliest(log, reference) // coarse, -_earliest(reference, log) // coarse
    offsets = coarse * np.arange(first, last + 1)
    peaks = _peaks(_fits(log, binned(reference, coarse), offsets, coarse))
    means = binned(reference, finest)
    tops = [_top(log, means, float(offsets[place]), coarse, finest) for place in peaks]
    offset, fit = _distinct(sorted(tops, key=lambda top: -top[1]), _REACH * coarse)
    uncertainty = 2.0 * max(_standard_error(log, means, offset, coarse, finest), finest * _OF_A_STEP)
    if uncertainty > _MOST_UNCERTAIN_S:
        best = f"{offset:+.0f} s fits best, to {uncertainty:.0f} s only"
        raise NoAnswerError(f"the offset is not distinct: {best}", fix=_FIX)
    return Alignment(offset, uncertainty, float(np.sqrt(fit)))


def _earliest(log: TimeSeries, reference: TimeSeries) -> float:
    """The lowest offset worth trying, at which the log's end meets the reference's beginning."""
    return max(-LONGEST_OFFSET_S, float(reference.time_s[0] - log.time_s[-1]))


def _peaks(fits: FloatArray) -> list[int]:
    """The highest places that are higher than their neighbours."""
    fits = np.pad(fits, 1)  # a top at an end is one
    inner = np.flatnonzero((fits[1:-1] > 0) & (fits[1:-1] >= fits[:-2]) & (fits[1:-1] >= fits[2:]))
    return [int(place) for place in inner[np.argsort(-fits[inner + 1])][:_MOST_PEAKS]]


def _distinct(tops: Sequence[tuple[float, float]], reach: float) -> tuple[float, float]:
    """The best of (offset, fit), best first; raises `NoAnswerError` where it is none, or not the only one.

    Tops within `reach` of it are the same hill's.
    """
    best, best_fit = tops[0] if tops else (0.0, 0.0)
    if best_fit < _LEAST_FIT:
        problem = f"the two time series match nowhere: at best {best_fit:.0%} of the variance"
        fix = "check that they are of the same thing, or give " + Argument("offset_s", 12)
        raise NoAnswerError(problem, fix=fix)
    left_over = max(1 - best_fit, _LEFT_OVER)
    for offset, fit in tops[1:]:
        if abs(offset - best) > reach and 1 - fit < _DISTINCT * left_over:
            both = f"{best:+.0f} s fits, and {offset:+.0f} s does as well"
            raise NoAnswerError(f"the offset is not distinct: {both}", fix=_FIX)
    return tops[0]


def _top(log: TimeSeries, means: TimeSeries, near: float, coarse: float, step: float) -> tuple[float, float]:
    """Offset and fit at the top around a coarse one: of a parabola through the upper third of the hill.

    Single fits go up and down with the noise of the few readings between which a series is interpolated.
    """
    reach = _REACH * coarse
    for _ in range(2):
        offsets = near + np.linspace(-reach, reach, _FINE_OFFSETS)
        fits = _fits(log, means, offsets, step)
        upper = fits >= fits.max() - np.ptp(fits) / 3
        near = float(offsets[upper].mean())
        reach = max(float(np.ptp(offsets[upper])), 2.0 * float(offsets[1] - offsets[0]))
    bend, lean, _ = np.polyfit(offsets[upper] - near, fits[upper], 2)
    aside = -lean / (2.0 * bend) if bend < 0 else 0.0
    return near + float(np.clip(aside, -reach, reach)), float(fits.max())


def _standard_error(log: TimeSeries, means: TimeSeries, offset: float, coarse: float, step: float) -> float:
    """Standard error of the offset by a delete-one-block jackknife over the series, seconds."""
    offsets = []
    for block in np.array_split(np.arange(means.value.size), _BLOCKS):
        without = means.value.copy()
        without[block] = np.nan
        offsets.append(_top(log, replace(means, value=without), offset, coarse, step)[0])
    return float(np.sqrt((_BLOCKS - 1) * np.var(offsets)))


def _fits(log: TimeSeries, means: TimeSeries, offsets: FloatArray, step: float) -> FloatArray:
    """Share of the reference's variance that the log explains at each offset; 0 where it cannot."""
    least = max(_LEAST_POINTS // 2, int(0.5 * min(np.isfinite(means.value).sum(), np.ptp(log.time_s) / step)))
    shifted = (_shift(log, means.time_s, float(offset), step) for offset in offsets)
    return np.array([_fit(x, means.value, least) for x in shifted])


def _fit(x: FloatArray, y: FloatArray, least: int) -> float:
    has_value = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(has_value) < least:
        return 0.0
    x, y = x[has_value] - x[has_value].mean(), y[has_value] - y[has_value].mean()
    scale = float(np.sum(x * x) * np.sum(y * y))
    correlation = float(np.sum(x * y)) / np.sqrt(scale) if scale > 0 else 0.0
    return max(correlation, 0.0) ** 2


def binned(series: TimeSeries, step: float) -> TimeSeries:
    """The means of bins of `step` seconds, of time and value, NaN where nothing was measured."""
    place = np.floor((series.time_s - series.time_s[0]) / step).astype(np.int64)
    counts = np.bincount(place)
    with np.errstate(invalid="ignore"):
        return TimeSeries(*(np.bincount(place, values) / counts for values in (series.time_s, series.value)))


def _shift(log: TimeSeries, grid: FloatArray, offset: float, step: float) -> FloatArray:
    """The log at the moments of the grid, its times moved by `offset`; smoothed to the bins' width."""
    value = log.value
    width = 2 * (round(step / log.step_s) // 2) + 1  # odd, so that nothing moves
    if 1 < width <= value.size:
        value = np.convolve(np.pad(value, width // 2, "edge"), np.ones(width) / width, "valid")
    return np.interp(grid - offset, log.time_s, value, np.nan, np.nan)


# --- another session as a source: what a second recorder took beside the first, on the first's clock

SAME_PLACE_M = 2000.0
"""Within it sun and clouds are the same."""
BY_HAND_S = 1.4
"""Expanded uncertainty of two keys that are pressed at one moment, each within half a second (k=2)."""
SLOW_S = 600.0
LIGHT = ("illuminance", "irradiance")


def is_session(path: Path) -> bool:
    """True for a session of any version; other files of HDF5, such as netCDF, do not say that they are."""
    if not (path.is_file() and h5py.is_hdf5(path)):
        return False
    with suppress(OSError, RuntimeError, KeyError, ValueError), h5py.File(path, "r") as file:
        return attribute(file, "fieldkit_format") == FORMAT_NAME
    return path.suffix == ".h5"  # damaged: opening it tells how


def require_joinable(session: SessionReader, other: SessionReader) -> None:
    """Raise `ConfigError` where one holds a part of the other or they are of two places, `SessionError`."""
    for opened in (session, other):
        opened.require_finished()
    problem = ""
    if _parts(session) & _parts(other):
        problem = f"is a part of {session.path}, or holds one"
    elif session.site.body != other.site.body or apart_m(session.site, other.site) > SAME_PLACE_M:
        problem = f"is of another site than {session.path}"
    if problem:
        raise ConfigError(problem, place=other.path, fix="give what a second recorder took at the same site")


def _parts(session: SessionReader) -> set[str]:
    """The session and those of which it was made."""
    events = session.events(recorded=True)
    return {session.session_id}.union(*(event.data.get("parts", ()) for event in events))


def recording_of(
    session: SessionReader, other: SessionReader, clock: Alignment, name: str | None
) -> ImportedRecording:
    """What `other` took, on the clock of `session`, its streams under names that `session` does not have.

    `name` is that of its stream, or stands in front of each. Raises `ConfigError` where they do not meet.
    """
    if other.end_ns + clock.offset_ns < session.start_ns or other.start_ns + clock.offset_ns > session.end_ns:
        fix = "check " + Argument("offset_s")
        raise ConfigError(f"and {session.path} do not overlap in time", place=other.path, fix=fix)
    prefix = "" if name is None else f"{name}-"
    usual = {stream: f"{prefix}{stream}" for stream in other.streams}
    if name and len(usual) == 1:
        usual = dict.fromkeys(usual, name)
    names = _free_names(usual, session.streams)

    def samples() -> Iterator[Sample]:
        for sample in other.samples():
            if Quality.BAD_CRC not in sample.quality:
                time_ns = sample.time_ns + clock.offset_ns
                yield sample._replace(stream=names[sample.stream], time_ns=time_ns)

    damaged = sum(int(np.count_nonzero(is_damaged(other.flags(stream)))) for stream in names)
    omitted = f"; {counted(damaged, 'sample')} with a wrong checksum omitted" if damaged else ""
    text = f"{', '.join(names.values())} joined from {other.path.name}: {clock}{omitted}"
    streams = tuple(replace(info, name=names[info.name]) for info in other.streams.values())
    return ImportedRecording(streams, ReadAgain(samples), ((Severity.INFO, text),))


def _free_names(names: Mapping[str, str], taken: Collection[str]) -> dict[str, str]:
    """The name that each gets: its usual one, or the first free one of those with a number."""
    free: dict[str, str] = {}
    for name, usual in names.items():
        others = {*names.values()} - {usual}
        free[name] = free_name(usual, {*taken, *others, *free.values()}, "{}-{}")
    return free


@dataclass(frozen=True, slots=True)
class _Part:
    """One of two sessions that become one: the names that its streams and regions get there."""

    reader: SessionReader
    streams: Mapping[str, str]
    regions: Mapping[str, str]
    first_camera: str

    def placed(self, regions: Iterable[Region]) -> Iterator[Region]:
        """Regions in the cameras of this session; none of those whose camera recorded nothing."""
        own = tuple(self.reader.streams.values())
        for region in regions:
            if camera := find_camera(own, region.camera):
                name = self.streams[camera.name]
                placed = "" if name == self.first_camera else name
                yield replace(region, name=self.regions[region.name], camera=placed)


def join(
    session: SessionReader, other: SessionReader, recording: ImportedRecording, clock: Alignment, path: Path
) -> SealReport:
    """Write `session` with the `recording_of` another as a new session at `path`, and seal it.

    Regions of `other` whose names `session` has get others; each lies in the camera of its own session, and
    one without a camera has none. Slopes of the recordings are omitted: each knew a part.
    """
    streams = (*session.streams.values(), *recording.streams)
    first = camera.name if (camera := find_camera(streams)) else ""
    same = {region.name: region.name for region in session.regions}
    own = _Part(session, {name: name for name in session.streams}, same, first)
    taken = [region.name for region in own.placed(session.regions)]
    regions = _free_names({region.name: region.name for region in other.regions}, taken)
    names = dict(zip(other.streams, (info.name for info in recording.streams), strict=True))
    their = _Part(other, names, regions, first)
    header = replace(
        session.header,
        streams=streams,
        regions=(*own.placed(session.header.regions), *their.placed(other.header.regions)),
        config_toml=session.config_toml or other.config_toml,
    )
    (_, text), *others = recording.notes
    data = {"parts": sorted(_parts(session) | _parts(other)), **asdict(clock)}
    notes = [Event(EventKind.IMPORTED, 0, 0, text, recording.streams[0].name, data=data)]
    notes += [Event(EventKind.IMPORTED, 0, 0, note, "", severity) for severity, note in others]
    entries = (*_own_entries(own), *_their_entries(their, session, clock))
    start_ns = min(session.start_ns, other.start_ns + clock.offset_ns)
    return write_together(session, header, entries, recording.samples, path, notes, start_ns)


def _own_entries(part: _Part) -> Iterator[Entry]:
    for entry in part.reader.entries():
        if isinstance(entry, RegionRecord):
            is_change = entry.time_ns > part.reader.identity.start_ns
            yield from (replace(entry, region=region) for region in part.placed([entry.region] * is_change))
        elif not isinstance(entry, MinuteRecord):
            yield entry


def _their_entries(part: _Part, session: SessionReader, clock: Alignment) -> Iterator[Entry]:
    """Marks, other events and changes of regions, as the clock of `session` would have recorded them."""
    steps, anchor_ns = session.time_map(), session.anchor_ns
    for event in part.reader.events():
        event = mapped_event([TimeStep(-(2**63), clock.offset_ns, "")], event)
        tested = event.data.get("shade_test")
        data = {**event.data, "shade_test": part.regions.get(tested, tested)} if tested else event.data
        event = replace(event, stream=part.streams.get(event.stream, event.stream), data=data)
        yield recorded_event(steps, event, anchor_ns)
    for record in part.reader.region_changes():
        mono_ns = recorded_mono_ns(steps, record.time_ns + clock.offset_ns, anchor_ns)
        for region in part.placed([record.region]):
            yield replace(record, region=region, time_ns=mono_ns + anchor_ns)


# --- the offset between the clocks of two recorders

# Measured where both saw the same: changes of the light, a meter that both read, marks that begin with
# "sync". Slow changes are removed before: two light meters that do not lie alike see the noon of a clear day
# minutes apart.


def clock_difference(session: SessionReader, other: SessionReader) -> Alignment:
    """The offset of the clock of `other`, by what both saw; raises `NoAnswerError` where that gives none."""
    fix = GIVE_OFFSET + ', or mark "sync" on both at one moment'
    alignments = [*_by_readings(session, other), *_by_marks(session, other)]
    if not alignments:
        what = f"nothing that {session.path.name} saw as well gives the offset of its clock"
        raise NoAnswerError(what, place=other.path, fix=fix)
    best = min(alignments, key=lambda alignment: alignment.uncertainty_s)
    for alignment in alignments:
        within_s = 2.0 * (alignment.uncertainty_s + best.uncertainty_s)
        if abs(alignment.offset_s - best.offset_s) > within_s:
            raise NoAnswerError(f"two offsets of its clock: {best}; {alignment}", place=other.path, fix=fix)
    return best


def _by_readings(session: SessionReader, other: SessionReader) -> Iterator[Alignment]:
    for own, their in product(session.streams.values(), other.streams.values()):
        if _see_the_same(own, their) and session.count(own.name) and other.count(their.name):
            series = (
                _quick(stream_series(reader, info.name, session.start_ns))
                for reader, info in ((other, their), (session, own))
            )
            with suppress(NoAnswerError):
                yield replace(best_offset(*series), source=f"by {own.name} and {their.name}")


def _see_the_same(own: StreamInfo, their: StreamInfo) -> bool:
    """True for meters of the same light, and for one meter that both read."""
    if own.is_camera or (own.quantity, own.measures) != (their.quantity, their.measures):
        return False
    return own.quantity in LIGHT or "" != own.serial_number == their.serial_number


def _quick(series: TimeSeries) -> TimeSeries:
    """The series without its slow changes."""
    means = binned(series, SLOW_S)
    has_value = np.isfinite(means.value)
    slow = np.interp(series.time_s, means.time_s[has_value], means.value[has_value])
    return replace(series, value=series.value - slow)


def _by_marks(session: SessionReader, other: SessionReader) -> Iterator[Alignment]:
    """By marks that begin with "sync": those of the same text belong together, in their order."""
    own, their = _sync_marks(session), _sync_marks(other)
    offsets_s = [
        (own_ns - their_ns) / 1e9
        for text in own
        for own_ns, their_ns in zip(own[text], their.get(text, ()), strict=False)
    ]
    if offsets_s:
        uncertainty_s = max(BY_HAND_S, float(np.ptp(offsets_s))) / math.sqrt(len(offsets_s))
        yield Alignment(float(np.mean(offsets_s)), uncertainty_s, math.nan, f"by {len(offsets_s)} sync marks")


def _sync_marks(session: SessionReader) -> dict[str, list[int]]:
    times: dict[str, list[int]] = {}
    for mark in session.marks().values():
        if (text := mark.text.strip().casefold()).startswith("sync"):
            times.setdefault(text, []).append(mark.time_ns)
    return times
