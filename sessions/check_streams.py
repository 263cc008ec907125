"""Checking one stream: checksums, numbers, order, gaps, rate, units, flags."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import NO_COUNTER, Frame, Quality
from fieldkit.physics.camera_laws import frame_k
from fieldkit.sessions.findings import Finding
from fieldkit.sessions.reader import Session
from fieldkit.sessions.stream_reader import StreamReader

_PLAUSIBLE = {"K": (200.0, 700.0), "lx": (0.0, 200_000.0), "W m-2": (-50.0, 1600.0)}
_REPORTED_ELSEWHERE = Quality.BAD_CRC | Quality.LOW_SUN | Quality.SHADED | Quality.UNRESOLVED
_HARMLESS = (Quality.SHUTTER, Quality.DUPLICATE)
_BUNCHED_SHARE = 0.02
_LOOK_EVERY = 32


def stream_findings(session: Session, name: str) -> Iterator[Finding]:
    """What there is to say about one stream; reads all of its samples once."""
    reader = session.stream(name)
    if not len(reader):
        yield Finding("warn", name, "no samples", "was it plugged in?")
        return
    bad, lowest, highest = _contents(reader)
    if bad:
        runs = f"first number {bad[0]}"
        fix = "these samples are left out of every estimate; a copy made earlier may have them"
        yield Finding(
            "fail", name, f"{len(bad)} of {len(reader)} samples do not match their checksum, {runs}", fix
        )
    else:
        yield Finding("ok", name, f"{len(reader)} samples, every checksum matches")
    yield from _numbers(name, reader)
    yield from _times(name, reader)
    yield from _units(reader.info, lowest, highest)
    yield from _emissivity(reader.info)
    yield from _flags(name, reader.column("flags"))


def _emissivity(info: StreamInfo) -> Iterator[Finding]:
    """Slopes take the emissivity of a bed into account; what a camera has taken out would count twice."""
    applied = info.settings.get("emissivity", 1.0)
    if info.is_camera and applied != 1.0:
        text = f"the camera has corrected for an emissivity of {applied:g} itself"
        yield Finding("warn", info.name, text, "set it to 1 in the camera; fieldkit corrects for each region")


def _contents(reader: StreamReader) -> tuple[list[int], float, float]:
    """Numbers of the samples that do not match, and the least and greatest value, in the stream's unit."""
    info, bad, lowest, highest = reader.info, [], np.inf, -np.inf
    for sample in reader.samples():
        if sample.quality & Quality.BAD_CRC:
            bad.append(sample.seq)
            continue
        if isinstance(sample, Frame):
            if sample.seq % _LOOK_EVERY:
                continue
            values = _middle_k(sample, info)
        else:
            values = np.array(sample.values)
        values = values[np.isfinite(values)]
        if values.size:
            lowest, highest = min(lowest, float(values.min())), max(highest, float(values.max()))
    return bad, lowest, highest


def _middle_k(frame: Frame, info: StreamInfo) -> NDArray[np.float64]:
    """The middle of a frame by the camera's law; NaN where the law has no answer."""
    middle = np.array([np.median(frame.counts)]).astype(np.uint16)
    return frame_k(info, middle, frame.metadata_rows)


def _numbers(name: str, reader: StreamReader) -> Iterator[Finding]:
    seq = reader.column("seq")
    missing = int(seq[-1]) + 1 - len(seq)
    if missing:
        yield Finding("fail", name, f"{missing} samples are missing from the file (numbers 0 to {seq[-1]})")
    if lost := _lost_before(reader):
        text = f"{lost} samples were lost before they came here, by the device's counter"
        yield Finding("warn", name, text)


def _lost_before(reader: StreamReader) -> int:
    """Samples lost between device and computer: only where a flag says so, for bursts skip on purpose."""
    device_seq = reader.column("device_seq")
    flagged = (reader.column("flags") & int(Quality.DROPPED_BEFORE)) != 0
    known = device_seq != NO_COUNTER
    steps, flagged = np.diff(device_seq[known]), flagged[known][1:]
    if not steps.size or (usual := int(np.median(steps))) <= 0:
        return 0
    return int(np.sum(np.maximum(1, steps[flagged] // usual - 1)))


def _times(name: str, reader: StreamReader) -> Iterator[Finding]:
    """Order, rate and gaps, by the monotonic clock."""
    mono_ns = reader.column("mono_ns")
    if len(mono_ns) < 3:
        return
    intervals = np.diff(mono_ns) / 1e9
    if (intervals < 0).any():
        yield Finding("fail", name, f"{int((intervals < 0).sum())} samples stand before the one before them")
    median = float(np.median(intervals))
    if median <= 0:
        return
    limit = max(
        1.0, 3.0 * float(np.quantile(intervals, 0.9))
    )  # bursts have two intervals: the long one is usual
    gaps = intervals[intervals > limit]
    if gaps.size:
        text = f"{gaps.size} gaps, the longest {gaps.max():.1f} s, together {gaps.sum():.0f} s"
        yield Finding("warn", name, text)
    yield from _rate(name, reader.info, intervals, median)


def _rate(name: str, info: StreamInfo, intervals: NDArray[np.float64], median: float) -> Iterator[Finding]:
    text = f"one sample each {median:.3g} s"
    if info.rate_hz <= 0:
        yield Finding("ok", name, text)
        return
    nominal = 1.0 / info.rate_hz
    bunched = float(np.mean(intervals < 0.3 * nominal))
    if bunched > _BUNCHED_SHARE:
        share = f"{100 * bunched:.0f} % of the samples came in bunches"
        yield Finding("warn", name, f"{share}: their stamps are arrivals, not measurements")
    off = not 0.8 < median / nominal < 1.25 and median < 5.0  # slower is sparse sampling, asked for
    declared = f"{text}, declared {info.rate_hz:g} Hz"
    yield Finding("warn" if off else "ok", name, declared)


def _units(info: StreamInfo, lowest: float, highest: float) -> Iterator[Finding]:
    low, high = _PLAUSIBLE.get(info.unit, (-np.inf, np.inf))
    if not np.isfinite([lowest, highest]).all():
        yield Finding(
            "warn", info.name, f"no values in {info.unit}: the scale is not known, or nothing was measured"
        )
    elif lowest < low or highest > high:
        text = f"values from {lowest:.4g} to {highest:.4g} {info.unit} are not plausible"
        yield Finding(
            "warn", info.name, text, "wrong scale or unit? see the stream's declaration: fieldkit show"
        )


def _flags(name: str, flags: NDArray[np.uint16]) -> Iterator[Finding]:
    for flag in Quality:
        count = int(np.count_nonzero(flags & flag.value))
        if count and not flag & _REPORTED_ELSEWHERE:
            word = str(flag.name).lower().replace("_", " ")
            yield Finding("ok" if flag in _HARMLESS else "warn", name, f"{count} samples flagged {word}")
