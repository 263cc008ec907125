"""Another session as a source: what a second recorder took beside the first joins it, on the first's clock.

The offset between both clocks is measured where both saw the same: changes of the light, a meter that both
read, marks that begin with "sync". Slow changes are removed before: two light meters that do not lie alike
see the noon of a clear day minutes apart.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import h5py
import numpy as np

from fieldkit.model.device import StreamInfo, find_camera
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Event, EventKind, Quality, Sample, Severity, is_damaged
from fieldkit.model.site import Region, apart_m
from fieldkit.sessions.formats import merged
from fieldkit.sessions.formats.imported import ImportedRecording, ReadAgain, free_name
from fieldkit.sessions.formats.merged import Alignment, TimeSeries
from fieldkit.sessions.layout import FORMAT_NAME
from fieldkit.sessions.reader import SessionReader, attribute
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.time_map import TimeStep, mapped_event, recorded_event, recorded_mono_ns

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
    omitted = f"; {damaged} samples that do not match their checksums are omitted" if damaged else ""
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
    return merged.write_together(session, header, entries, recording.samples, path, notes, start_ns)


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


# --- the offset between the clocks


def clock_difference(session: SessionReader, other: SessionReader) -> Alignment:
    """The offset of the clock of `other`, by what both saw; raises `NoAnswerError` where that gives none."""
    fix = merged.GIVE_OFFSET + ', or mark "sync" on both at one moment'
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
                _quick(merged.stream_series(reader, info.name, session.start_ns))
                for reader, info in ((other, their), (session, own))
            )
            with suppress(NoAnswerError):
                yield replace(merged.best_offset(*series), source=f"by {own.name} and {their.name}")


def _see_the_same(own: StreamInfo, their: StreamInfo) -> bool:
    """True for meters of the same light, and for one meter that both read."""
    if own.is_camera or (own.quantity, own.measures) != (their.quantity, their.measures):
        return False
    return own.quantity in LIGHT or "" != own.serial_number == their.serial_number


def _quick(series: TimeSeries) -> TimeSeries:
    """The series without its slow changes."""
    means = merged.binned(series, SLOW_S)
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
