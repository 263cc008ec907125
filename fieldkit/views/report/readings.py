"""The values of a figure over time, minute by minute, for who points at it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from fieldkit.model.site import Site
from fieldkit.views import formatting
from fieldkit.views.html import Reading
from fieldkit.views.plotting import OverTime
from fieldkit.views.report.series import Series

MOST = 200
"""Readings of a figure: three hours minute by minute; longer sessions show every second minute, or third."""


def readings(
    drawn: OverTime, columns: Series, site: Site, values: Callable[[int], Iterable[str]]
) -> list[Reading]:
    """The readings of a figure; `values` gives the lines of words for a minute's index."""
    step = math.ceil(columns.time_ns.size / MOST)
    middle = 100.0 * drawn.share_of_width[::step]
    width = float(np.min(np.diff(middle), initial=2.0))
    return [
        Reading(
            round(left - width / 2, 2),
            round(width, 2),
            "\n".join([formatting.clock_time(int(columns.time_ns[minute]), site), *values(minute)]),
        )
        for left, minute in zip(middle.tolist(), range(0, columns.time_ns.size, step), strict=True)
    ]
