"""Shadows of a session against the horizons of its regions: minutes in which they contradict each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.finding import Finding
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.facet import FloatArray, normal
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share

COOLING_MINUTES = 10
"""By then a region in the shadow is several kelvin colder."""
LEAST_FALL_K = 1.0
BRIGHT_W_M2 = 200.0
"""Less direct light leaves no shadow that could be missed."""


def horizon_findings(
    minutes: Sequence[Minute], regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[Finding]:
    """Contradictions of the horizons, or, without one, minutes that were shaded; a line for each region."""
    if not minutes:
        return
    sun = normal([one.sun_zenith_deg for one in minutes], [one.sun_azimuth_deg for one in minutes])
    references = [region.name for region in regions if region.kind is RegionKind.REFERENCE]
    # a region in the same shadow as the reference cools with it
    shares = [sunlit_share(settings.horizon_of(name), sun, MINUTE_EDGE_DEG) for name in references]
    compared = np.all(np.array(shares).reshape(-1, len(minutes)) == 1.0, axis=0)
    for region in regions:
        horizon = settings.horizon_of(region.name)
        share = sunlit_share(horizon, sun, MINUTE_EDGE_DEG)
        shaded = _shaded(minutes, region.name) & (share == 1.0)
        if shaded.any() and horizon:
            text = f"shaded although its horizon leaves the sun visible: {_times(minutes, shaded)}"
            yield Finding(
                "warn", region.name, text, "correct its horizon, unless a board or a person was there"
            )
        elif shaded.any():
            fix = "if terrain did it, give a horizon and estimate again; see how-to/shadows"
            yield Finding("warn", region.name, f"shaded: {_times(minutes, shaded)}", fix)
        below = (share == 0.0) & compared & (sun[:, 2] > 0.0)
        sunlit = _sunlit_below(minutes, region.name, references, below)
        if sunlit.any():
            text = f"sunlit although its horizon hides the sun: {_times(minutes, sunlit)}"
            yield Finding("warn", region.name, text, "correct its horizon")


def _shaded(minutes: Sequence[Minute], region: str) -> NDArray[np.bool_]:
    """Minutes (n,) between the events that report the begin and the end of a shadow."""
    found, is_shaded = [], False
    for minute in minutes:
        for event in minute.events:
            if event.data.get("shaded") == region:
                is_shaded = event.data.get("phase") == "begin"
        found.append(is_shaded)
    return np.array(found, np.bool_)


def _sunlit_below(
    minutes: Sequence[Minute], region: str, references: Sequence[str], below: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Minutes (n,) below the horizon in which the region did not become colder against the references."""
    found = np.zeros_like(below)
    if region in references or not references:
        return found
    over_k = np.array([_over_k(minute, region, references) for minute in minutes])
    for first, last in _runs(below):
        later = first + COOLING_MINUTES
        if first < COOLING_MINUTES or later > last or not minutes[later].dni_w_m2 > BRIGHT_W_M2:
            continue
        if over_k[first - COOLING_MINUTES] - over_k[later] < LEAST_FALL_K:
            found[first : last + 1] = True
    return found


def _over_k(minute: Minute, region: str, references: Sequence[str]) -> float:
    kelvin = minute.temperature_k
    return kelvin.get(region, np.nan) - float(np.mean([kelvin.get(name, np.nan) for name in references]))


def _runs(condition: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run in which a condition (n,) holds."""
    edges: FloatArray = np.diff(np.concatenate([[0], condition.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(int(start), int(end)) for start, end in zip(starts, ends, strict=True)]


def _times(minutes: Sequence[Minute], chosen: NDArray[np.bool_]) -> str:
    """``18:20-18:59Z, 20:03-20:05Z``."""
    at = [str(np.datetime64(minute.time_ns // 1_000_000_000, "s"))[11:16] for minute in minutes]
    return ", ".join(f"{at[first]}-{at[last]}Z" for first, last in _runs(chosen))
