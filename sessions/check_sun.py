"""The sun as a clock: does the light fit the sun's height at the recorded times and place?

Catches wrong time zones, daylight-saving time and swapped signs of a longitude: errors of
half an hour and more. Model: illuminance = A sin(h) exp(-k / sin h), h the sun's height,
whose two numbers are fitted for each shift tried; clouds only take light away, so the upper
half of the points counts.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.analysis import minute_means
from fieldkit.sessions.findings import Finding
from fieldkit.sessions.reader import Session

SHIFTS_MIN = np.arange(-14 * 60, 14 * 60 + 1, 30)
MIN_SPAN_S = 3600.0
_LIT_LX = 500.0
_BRIGHT_LX = 20_000.0
_LOW = np.sin(np.radians(5.0))

FloatArray = NDArray[np.float64]


def sun_findings(session: Session) -> Iterator[Finding]:
    """Whether the light fits the recorded times, for the first illuminance stream."""
    stream = next((name for name, info in session.streams.items() if info.quantity == "illuminance"), None)
    if stream is None or not session.count(stream):
        return
    time_ns, lux = minute_means(session, stream, recorded=True)
    if not (lux > _LIT_LX).any():
        return
    shift = best_shift_min(time_ns, lux, session.site)
    if shift is None:
        yield Finding("ok", "sun", "too little light or time to compare the clock with the sun")
    elif shift == 0:
        yield Finding("ok", "sun", "the light fits the sun's height at the recorded times")
    else:
        fix = "check the clock, the zone and the site's longitude"
        yield Finding(
            "warn", "sun", f"the light fits the sun best at {shift:+d} min: wrong zone or clock?", fix
        )


def best_shift_min(time_ns: NDArray[np.int64], lux: FloatArray, site: Site) -> int | None:
    """Minutes to add to the times so that the light fits the sun; 0 where they fit, None where unclear.

    Another shift must fit at least three times better than none; the smallest such is told.
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


def _misfit(time_ns: NDArray[np.int64], lux: FloatArray, site: Site, shift_min: int) -> float:
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
