"""Sun vectors for every second of a day: the spline against astropy asked directly."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.result import Result
from fieldkit.model.site import Site
from fieldkit.physics.facet import FloatArray, angle_between_deg
from fieldkit.physics.sun import astropy_vectors, sun_vectors

SITE = Site(35.558675, 139.395232, 9.0)
START_S = 1_504_051_200  # 2017-08-30T00:00Z
STAMPS = 86_400


def _seconds(work: Callable[[], FloatArray], repeats: int) -> tuple[float, FloatArray]:
    best, found = np.inf, np.empty(0)
    for _ in range(repeats):
        started = time.perf_counter()
        found = work()
        best = min(best, time.perf_counter() - started)
    return float(best), found


def run() -> list[Result]:
    seconds = START_S + np.arange(STAMPS, dtype=np.int64)
    time_ns = seconds * 1_000_000_000
    sun_vectors(time_ns[:1], SITE)  # warm: the day's grid is computed once
    warm_s, splined = _seconds(lambda: sun_vectors(time_ns, SITE), 5)
    direct_s, direct = _seconds(lambda: astropy_vectors(seconds.astype(np.float64), SITE), 1)
    arcseconds = 3600.0 * float(np.max(angle_between_deg(splined, direct)))
    return [
        Result("86 400 sun vectors, astropy direct over spline (warm)", direct_s / warm_s, "x", ">= 80",
               f"{direct_s:.2f} s against {1e3 * warm_s:.1f} ms"),
        Result("largest difference between the two", arcseconds, "arcsec", "<= 0.01"),
    ]  # fmt: skip
