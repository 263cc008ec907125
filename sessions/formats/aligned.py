"""A log whose clock was off, moved onto the curves that a session has of the same quantity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.samples import Reading, Severity, is_usable
from fieldkit.sessions.formats.curve_offset import Alignment, Curve, best_offset
from fieldkit.sessions.formats.imported import Foreign
from fieldkit.sessions.reader import Session

_ZONE_S = 1500.0


def aligned(session: Session, foreign: Foreign) -> Foreign:
    """The log with its times moved onto the session's curves of the same quantity; a remark says how far.

    Raises `NoAnswerError` where no stream of the session determines the offset.
    """
    readings = [sample for sample in foreign.samples if isinstance(sample, Reading)]
    name, found = _best_stream(session, foreign.streams, readings)
    shift_ns = round(found.offset_s * 1e9)
    moved = [one._replace(time_ns=one.time_ns + shift_ns, mono_ns=one.mono_ns + shift_ns) for one in readings]
    said = (
        f"clock offset {found.offset_s:+.1f} s ± {found.uncertainty_s:.1f} s (k=2) found on {name}, "
        f"correlation {found.correlation:.3f}"
    )
    remarks = [*foreign.remarks, (Severity.INFO, said)]
    if abs(found.offset_s) > _ZONE_S:
        remarks.append((Severity.WARNING, "that is no clock's drift: is --zone right, or summer time?"))
    return Foreign(foreign.streams, moved, tuple(remarks), foreign.site)


def _best_stream(
    session: Session, streams: Sequence[StreamInfo], readings: Sequence[Reading]
) -> tuple[str, Alignment]:
    """The curve that determines the offset of the log best, whichever of its streams it is of."""
    start_ns = session.start_ns
    found, refused = [], ""
    for info in streams:
        log = _curve(_points(one for one in readings if one.stream == info.name), start_ns)
        for name, curve in _curves(session, info.quantity, start_ns):
            try:
                found.append((name, best_offset(log, curve)))
            except NoAnswerError as error:
                refused = f"{name}: {error.message}"
    if not found:
        quantities = " or ".join(info.quantity for info in streams)
        raise NoAnswerError(
            f"{session.path} does not tell the log's offset: {refused or f'it has no curve of {quantities}'}",
            fix="say it: --offset +12s, or --offset 0s",
        )
    return min(found, key=lambda one: one[1].uncertainty_s)


def _points(readings: Iterable[Reading]) -> Iterator[tuple[int, float]]:
    """Time and mean over the channels of the readings that have one."""
    for one in readings:
        if is_usable(one.quality) and np.isfinite(one.values).any():
            yield one.time_ns, float(np.nanmean(one.values))


def _curves(session: Session, quantity: str, start_ns: int) -> Iterator[tuple[str, Curve]]:
    """What the session has of a quantity: meters, and for temperatures the regions of its pictures."""
    for name, info in session.streams.items():
        if info.quantity == quantity and not info.is_camera and session.count(name):
            yield name, _stream_curve(session, name, start_ns)
        if info.quantity == "brightness_temperature" and quantity == "temperature" and session.count(name):
            series = session.region_series(stream=name)
            good = is_usable(series.flags)
            for region, kelvin in zip(series.regions, series.mean_k[good].T, strict=True):
                if kelvin.size and np.isfinite(kelvin).all():
                    points = zip(series.time_ns[good].tolist(), kelvin.tolist(), strict=True)
                    yield f"region {region} of {name}", _curve(points, start_ns)


def _stream_curve(session: Session, name: str, start_ns: int) -> Curve:
    readings = session.readings(name)
    known = is_usable(readings.flags) & np.isfinite(readings.values).any(axis=1)
    means = np.nanmean(readings.values[known], axis=1)
    return _curve(zip(readings.time_ns[known].tolist(), means.tolist(), strict=True), start_ns)


def _curve(points: Iterable[tuple[int, float]], start_ns: int) -> Curve:
    """Points in order of time, the first of each moment."""
    ordered = sorted(points)
    times = np.array([(time_ns - start_ns) / 1e9 for time_ns, _ in ordered])
    values = np.array([value for _, value in ordered], np.float64)
    times, first = np.unique(times, return_index=True)
    return Curve(times, values[first])
