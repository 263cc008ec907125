"""Single readings that contradict their neighbours: a second line of defence behind `fieldkit.model.limits`.

A value that can be, such as 1600 W/m2 once in a clear hour, may still not have been measured. Two neighbours
that agree with each other and not with the reading between them show it. Clouds, shade and gusts last longer
than one reading, or make the neighbours disagree as well, so they stay.
"""

from __future__ import annotations

import numpy as np

from fieldkit.physics.facet import FloatArray

LEAST_READINGS = 6
"""In a minute: with fewer, a cloud may pass between one reading and the next."""
FACTOR = 8.0
"""Distance from the neighbours, over that of these and of other readings from each other."""

LEAST_K, LEAST_SHARE = 1.0, 0.05
"""Deviation that is always kept: less in one reading of a minute cannot move a slope by 0.1 degrees."""


def without_spikes(values: FloatArray, *, is_temperature: bool) -> FloatArray:
    """The readings of a minute in order of time (n,), NaN where one contradicts both neighbours.

    Readings without a value have no place in the order. Fewer than `LEAST_READINGS` are returned as they are.
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < LEAST_READINGS:
        return values
    v = values[known]
    before = np.concatenate([v[2:3], v[:-1]])  # at the ends of the minute, the two on the other side
    after = np.concatenate([v[1:], v[-3:-2]])
    apart = np.minimum(np.abs(v - before), np.abs(v - after))
    least = LEAST_K if is_temperature else LEAST_SHARE * np.median(np.abs(v))
    agreement = np.maximum(np.abs(before - after), np.median(np.abs(np.diff(v))))
    cleaned = values.copy()
    cleaned[known[apart > np.maximum(FACTOR * agreement, least)]] = np.nan
    return cleaned
