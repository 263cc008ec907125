"""Checking a session: nothing is changed, everything that can be known from the file is looked at.

Damage and lost samples are failures; what happened in the field (clouds, lost cables,
stepped clocks) is a warning; the rest is reported as it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fieldkit.model.arrays import FlagArray, FloatArray, IntArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.durations import precise_duration, rounded_duration
from fieldkit.model.errors import SessionError, message_of
from fieldkit.model.finding import Finding
from fieldkit.model.next_step import Action
from fieldkit.model.samples import NO_COUNTER, EventKind, Quality, Severity
from fieldkit.model.site import RegionKind, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.phrases import Words, counted
from fieldkit.physics.camera_laws import frame_k
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.analysis import means_by_minute
from fieldkit.sessions.finished_file import STEP_NS, TOLERANCE_NS, propose_time_map, stepped_ns
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.radiation_check import radiation_findings
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.sessions.stream_reader import StreamReader
from fieldkit.sessions.time_map import TimeStep

_COPY = "take another copy of the session; its numbers may not mean what they did"

_ok, _warn, _fail = (partial(Finding, level) for level in ("ok", "warn", "fail"))

_QUIET = {EventKind.START, EventKind.STOP, EventKind.CLOCK_CHECK, EventKind.REGION}


def check(path: str | Path) -> list[Finding]:
    """All findings on a session file; never raises for what is in it."""
    path = Path(path)
    try:
        session = open_session(path)
    except SessionError as error:
        return [_fail("file", error.statement, error.fix or "")]
    with session:
        findings: list[Finding] = []
        streams = [partial(stream_findings, name=name) for name in session.streams]
        parts: list[Callable[[SessionReader], Iterable[Finding]]] = [
            _state, integrity_findings, _entries, *streams, _events, clock_findings, sun_findings,
            radiation_findings, _regions,
        ]  # fmt: skip
        for check_part in parts:
            try:
                findings.extend(check_part(session))
            except Exception as error:  # whatever is in the file, the other checks go on
                damage = Words("issue.damaged", error=message_of(error))
                findings.append(_fail("file", damage, Action.RECOVER(path)))
        return list(dict.fromkeys(findings))  # the same damage may stop several checks


def _state(session: SessionReader) -> Iterator[Finding]:
    fix = Action.RECOVER(session.path)
    match session.state:
        case "sealed":
            yield _ok("state", "sealed: every sample was compared with the journal")
        case "recovered":
            yield _warn("state", Words("issue.recovered"))
        case "recording":
            yield _warn("state", Words("issue.recording"))
        case _ if journal_path(session.path).exists():
            yield _fail("state", Words("issue.interrupted"), fix)
        case _:
            yield _fail("state", Words("issue.journal_gone"), fix)


def integrity_findings(session: SessionReader) -> Iterator[Finding]:
    """Everything that gives the numbers their meaning, against the digests taken when it was sealed."""
    if session.state not in ("sealed", "recovered"):
        return
    sealed = session.sealed_objects()
    reasons = {path: _fault_of(session, path, digest) for path, digest in sealed.items()}
    for path, reason in reasons.items():
        if reason:
            yield _fail(path, reason, _COPY)
    if not any(reasons.values()):
        yield _ok("header", f"{len(sealed)} objects are as they were sealed")
    for name, count in session.missing_corrections.items():
        yield _fail(name, Words("issue.corrections", count=count), _COPY)


def _fault_of(session: SessionReader, path: str, digest: str) -> str:
    """Mistakes of an object, in words."""
    try:
        return "" if session.object_digest(path) == digest else Words("issue.changed")
    except Exception as error:  # whatever HDF5 makes of damaged bytes
        return Words("issue.unreadable", error=message_of(error))


def _entries(session: SessionReader) -> list[Finding]:
    """Findings on tables that cannot be read; their meaning is judged by others."""
    session.entries()
    return []


def _events(session: SessionReader) -> Iterator[Finding]:
    """Findings noticed while recording, one line for each kind of event and stream."""
    events = [event for event in session.events() if event.kind not in _QUIET]
    for (kind, stream), count in Counter((event.kind, event.stream) for event in events).items():
        these = [event for event in events if (event.kind, event.stream) == (kind, stream)]
        first = max(these, key=lambda event: event.severity)
        serious = first.severity >= Severity.WARNING
        at = np.datetime64(first.time_ns // 1_000_000_000, "s")
        name = kind.name.lower() + (f" {stream}" if stream else "")
        key = "issue.events" if count > 1 else "issue.event"
        text = Words(key, time=f"{at}Z", event=first.text, more=count - 1, happened=first.document())
        yield Finding("warn" if serious else "ok", name, text)


def _regions(session: SessionReader) -> Iterator[Finding]:
    if not any(info.is_camera for info in session.streams.values()):
        return
    kinds = Counter(region.kind for region in session.regions)
    references, targets = kinds[RegionKind.REFERENCE], kinds[RegionKind.TARGET]
    if not references:
        fix = "draw regions in fieldkit.toml (fieldkit roi add) and estimate again"
        yield _warn("regions", Words("issue.no_reference", targets=targets), fix)
    else:
        yield _ok("regions", f"references: {references}, targets: {targets}")


# --- one stream: checksums, numbers, order, gaps, rate, units, flags

REPORTED_ELSEWHERE = (
    Quality.BAD_CRC | Quality.LOW_SUN | Quality.SHADED | Quality.UNRESOLVED | Quality.IMPLAUSIBLE
)
"""Flags that have a finding of their own, or are no fault."""

_LIMITS = "wrong scale or unit? what this site can have: [limits] in fieldkit.toml"

_HARMLESS = (Quality.SHUTTER, Quality.DUPLICATE)

_BUNCHED_SHARE = 0.02

_EVERY_NTH = 32


def stream_findings(session: SessionReader, name: str) -> Iterator[Finding]:
    """Findings on one stream; reads all of its samples once."""
    reader = session.stream(name)
    if not len(reader):
        yield _warn(name, Words("issue.no_samples"), "was it plugged in?")
        return
    bad, lowest, highest = _contents(reader)
    if bad:
        fix = "use a copy made earlier, if it has them; they are excluded from every estimate"
        yield _fail(name, Words("issue.checksum", bad=len(bad), count=len(reader), first=bad[0]), fix)
    else:
        yield _ok(name, f"{counted(len(reader), 'sample')}, every checksum matches")
    yield from _numbers(name, reader)
    yield from _times(name, reader)
    yield from _units(reader, lowest, highest)
    yield from _emissivity(reader.info)
    yield from _flags(name, reader.column("flags"))


def _emissivity(info: StreamInfo) -> Iterator[Finding]:
    """Slopes take the emissivity of a region into account; what a camera has taken out would count twice."""
    applied = info.settings.get("emissivity", 1.0)
    if info.is_camera and applied != 1.0:
        text = Words("issue.emissivity_applied", emissivity=f"{applied:g}")
        yield _warn(info.name, text, "set it to 1 in the camera; each region is corrected")


def _contents(reader: StreamReader) -> tuple[list[int], float, float]:
    """Numbers of the samples that do not match, and the least and greatest value, in the stream's unit."""
    seq = reader.column("seq")
    if reader.info.is_camera:
        flags, values = _middles_k(reader, seq)
    else:
        readings = reader.readings(recorded=True)
        flags, values = readings.flags, readings.values
    is_bad = (flags & Quality.BAD_CRC) != 0
    values = values[~is_bad]
    finite = values[np.isfinite(values)]
    return seq[is_bad].tolist(), float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf))


def _middles_k(reader: StreamReader, seq: IntArray) -> tuple[FlagArray, FloatArray]:
    """Flags of all frames, and the middle of every n-th by the camera's law; NaN where that has no answer."""
    flags, middle_k = np.zeros(len(reader), np.uint32), np.full(len(reader), np.nan)
    for block in reader.frame_blocks():
        flags[block.start : block.start + len(block.flags)] = block.flags
        for row in np.flatnonzero(seq[block.start : block.start + len(block.flags)] % _EVERY_NTH == 0):
            middle = np.array([np.median(block.counts[row])]).astype(np.uint16)
            (middle_k[block.start + row],) = frame_k(reader.info, middle, block.metadata_rows[row])
    return flags, middle_k


def _numbers(name: str, reader: StreamReader) -> Iterator[Finding]:
    seq, device_seq = reader.column("seq"), reader.column("device_seq")
    if missing := int(seq[-1]) + 1 - len(seq):
        yield _fail(name, Words("issue.missing", count=missing, last=int(seq[-1])))
    # lost between device and computer: only where flagged, because bursts skip on purpose
    flagged = (reader.column("flags") & int(Quality.DROPPED_BEFORE)) != 0
    is_counted = device_seq != NO_COUNTER
    steps, flagged = np.diff(device_seq[is_counted]), flagged[is_counted][1:]
    usual = int(np.median(steps)) if steps.size else 0
    if usual > 0 and (lost := int(np.sum(np.maximum(1, steps[flagged] // usual - 1)))):
        yield _warn(name, Words("issue.lost", count=lost))


def _times(name: str, reader: StreamReader) -> Iterator[Finding]:
    """Order, rate and gaps, by the monotonic clock."""
    mono_ns = reader.column("mono_ns")
    if len(mono_ns) < 3:
        return
    intervals = np.diff(mono_ns) / 1e9
    if (intervals < 0).any():
        yield _fail(name, Words("issue.order", count=int((intervals < 0).sum())))
    median = float(np.median(intervals))
    if median <= 0:
        return
    # bursts have two intervals: the long one is usual
    limit = max(1.0, 3.0 * float(np.quantile(intervals, 0.9)))
    gaps = intervals[intervals > limit]
    if gaps.size:
        longest, together = precise_duration(gaps.max()), rounded_duration(gaps.sum())
        yield _warn(name, Words("issue.gaps", count=gaps.size, longest=longest, together=together))
    yield from _rate(name, reader.info, intervals, median)


def _rate(name: str, info: StreamInfo, intervals: FloatArray, median: float) -> Iterator[Finding]:
    interval = f"{median:.3g}"
    if info.rate_hz <= 0:
        yield _ok(name, f"one sample every {interval} s")
        return
    nominal = 1.0 / info.rate_hz
    bunched = float(np.mean(intervals < 0.3 * nominal))
    if bunched > _BUNCHED_SHARE:
        yield _warn(name, Words("issue.bunched", percent=round(100 * bunched)))
    off = not 0.8 < median / nominal < 1.25 and median < 5.0  # slower is sparse sampling, asked for
    text = Words("issue.rate", interval=interval, declared=f"{info.rate_hz:g}")
    yield Finding("warn" if off else "ok", name, text)


def _units(reader: StreamReader, lowest: float, highest: float) -> Iterator[Finding]:
    """Values that are not there, and those that cannot be: of a camera by the middle of its frames."""
    info, excesses = reader.info, reader.excesses()
    if not (excesses or np.isfinite([lowest, highest]).all()):
        yield _warn(info.name, Words("issue.no_values", unit=info.unit))
    elif info.is_camera and reader.bounds.is_exceeded(np.array([[lowest], [highest]])).any():
        values = {"low": f"{lowest:.4g}", "high": f"{highest:.4g}", "unit": info.unit}
        yield _warn(info.name, Words("issue.implausible", **values), _LIMITS)
    for excess in excesses:
        at = np.datetime64(int(reader.time_ns(excess.first, excess.first + 1)[0]) // 1_000_000_000, "s")
        yield _warn(info.name, excess.words(f"{at}Z"), _LIMITS)


def _flags(name: str, flags: FlagArray) -> Iterator[Finding]:
    for flag in Quality:
        count = int(np.count_nonzero(flags & flag.value))
        if count and not flag & REPORTED_ELSEWHERE:
            text = Words(f"issue.flagged.{str(flag.name).lower()}", count=count)
            yield Finding("ok" if flag in _HARMLESS else "warn", name, text)


# --- clocks


def clock_findings(session: SessionReader) -> Iterator[Finding]:
    """Steps and drift of the system clock against the monotonic one, sleep, and the active time map."""
    checks, in_force = session.clock_checks(), session.time_map()
    if checks:
        proposed = propose_time_map(session)
        for step in stepped_ns(checks, session.anchor_ns):
            yield _warn("clock", Words("issue.stepped", seconds=f"{step / 1e9:+.3f}"))
        yield _last_comparison(session, checks, proposed, in_force)
        yield from _sleep(checks, in_force == proposed)
    else:
        yield _ok("clock", "the clocks were not compared while recording")
    if in_force:
        text = "; ".join(f"{step.add_ns / 1e9:+.3f} s ({step.reason})" for step in in_force)
        yield _ok("clock", f"a time map is active: {text}")


def _last_comparison(
    session: SessionReader, checks: Sequence[ClockCheck], proposed: list[TimeStep], in_force: list[TimeStep]
) -> Finding:
    """Offset of the system clock from the recorded times, when it was seen, and the fix if it is open."""
    last = checks[-1]
    ends_ns = [session.stream(name).column("mono_ns").max(initial=last.mono_ns) for name in session.streams]
    before_s = (max(ends_ns) - last.mono_ns) / 1e9
    away_ns = last.utc_minus_mono_ns - session.anchor_ns
    is_open = bool(proposed or abs(away_ns) >= TOLERANCE_NS) and not in_force
    before, seconds = rounded_duration(before_s), f"{away_ns / 1e9:+.3f}"
    text = Words("issue.clock", count=len(checks), before=before, seconds=seconds)
    fix = Action.CORRECT_CLOCK(session.path) if is_open and proposed else ""
    return Finding("warn" if is_open else "ok", "clock", text, fix)


def _sleep(checks: Sequence[ClockCheck], is_corrected: bool) -> Iterator[Finding]:
    slept_ns = checks[-1].suspended_ns - checks[0].suspended_ns
    if slept_ns <= STEP_NS:
        return
    slept = rounded_duration(slept_ns / 1e9)
    if is_corrected:
        yield _ok("clock", f"the computer slept for {slept}, which the active time map adds to later times")
    else:
        yield _warn("clock", Words("issue.slept", slept=slept))


# --- the sun as a clock

# Catches wrong time zones, daylight-saving time and swapped signs of a longitude: errors of half an hour and
# more. Model: illuminance = A sin(h) exp(-k / sin h), h the sun's elevation, whose two numbers are fitted for
# each shift tried; clouds only take light away, so the upper half of the points counts.
SHIFTS_MIN = np.arange(-14 * 60, 14 * 60 + 1, 30)
MIN_SPAN_S = 3600.0
_LIT_LX = 500.0
_BRIGHT_LX = 20_000.0
_LOW = np.sin(np.radians(5.0))


def sun_findings(session: SessionReader) -> Iterator[Finding]:
    """True if the light fits the times as corrected, for the first illuminance stream."""
    stream = next((name for name, info in session.streams.items() if info.quantity == "illuminance"), None)
    if stream is None or not session.count(stream):
        return
    reader = session.stream(stream)
    # the limits by the height of the sun rest on the times that are judged here
    time_ns, lux = means_by_minute(replace(reader.readings(recorded=True), time_ns=reader.time_ns()))
    if not (lux > _LIT_LX).any():
        return
    if (shift := best_shift_min(time_ns, lux, session.site)) is None:
        yield _ok("sun", "too little light or time to compare the clock with the sun")
    elif shift == 0:
        which = "corrected" if session.time_map() else "recorded"
        yield _ok("sun", f"the light fits the sun's height at the {which} times")
    else:
        fix = "check the clock, the zone and the site's longitude"
        yield _warn("sun", Words("issue.sun", shift=f"{shift:+d}"), fix)


def best_shift_min(time_ns: IntArray, lux: FloatArray, site: Site) -> int | None:
    """Minutes to add to the times so that the light fits the sun; 0 where they fit, None where unclear.

    Another shift must fit at least three times better than none; the smallest such is returned.
    """
    lit = lux > _LIT_LX
    if not lit.any() or np.ptp(time_ns[lit]) < MIN_SPAN_S * 1e9:
        return None
    misfits = np.array([_misfit(time_ns[lit], lux[lit], site, int(shift)) for shift in SHIFTS_MIN])
    now = float(misfits[SHIFTS_MIN == 0][0])
    best = float(misfits.min())
    if not np.isfinite(best):
        return None
    if now <= max(3.0 * best, 0.05):
        return 0
    good = SHIFTS_MIN[misfits <= 1.2 * best]
    return int(good[np.argmin(np.abs(good))])


def _misfit(time_ns: IntArray, lux: FloatArray, site: Site, shift_min: int) -> float:
    """Mean absolute misfit of log illuminance to the model; infinite if bright light had no sun."""
    height = sun_vectors(time_ns + shift_min * MINUTE_NS, site)[:, 2]
    if (height[lux > _BRIGHT_LX] < _LOW).any() or (height < -_LOW).any():
        return float("inf")
    up = height > _LOW
    if np.count_nonzero(up) < max(10, 0.5 * height.size):
        return float("inf")
    y, x = np.log(lux[up] / height[up]), 1.0 / height[up]
    keep = np.ones(y.size, np.bool_)
    for _ in range(2):  # the second time without the minutes that clouds darkened
        k = float(np.clip(-np.polyfit(x[keep], y[keep], 1)[0], 0.0, 0.6)) if np.ptp(x[keep]) > 1e-3 else 0.2
        rest = y + k * x
        rest -= np.median(rest[keep])
        keep = rest > -0.1
        if np.count_nonzero(keep) < 10:
            return float(np.mean(np.abs(rest)))
    return float(np.mean(np.abs(rest[keep])) / np.mean(keep))
