"""How far back an estimate should look, and whether a bed that drifts alone is found: measured weather.

Beds and days as in `estimation_outdoors`, with offsets of 0.25 K between regions and clouds
flagged as the estimator's own monitor flags them; every tenth minute from 9:40 to 15 h local.
Twenty minutes, the paper's window, against the default, which looks back as far as one slope
explains the minutes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.estimation_outdoors import (
    BEDS_SOUTH,
    SLAB,
    STILL,
    Bed,
    days,
    field_day,
    holds,
    noisy,
    regions,
)
from benchmarks.result import Result
from fieldkit.estimation.bins import History
from fieldkit.estimation.disturbances import CloudMonitor
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.simulation import Facet
from fieldkit.weather import Weather

SAND = Facet("sand", (), depth_m=0.03)
ANY_SIDE: tuple[Bed, ...] = (
    (7.3, 31.0),
    (12.1, 107.0),
    (15.7, 222.0),
    (19.4, 158.0),
    (23.2, 283.0),
    (28.6, 349.0),
)
PAPER_WINDOW_S = 1200.0
ONSET = 150
RATE_K_PER_H = 2.0
MIXED: tuple[Bed, ...] = ((5.0, 180.0), (15.0, 180.0), (25.0, 180.0), (12.0, 90.0), (20.0, 250.0))


def clouds_flagged(history: History, settle_s: float) -> History:
    """The day with the flags that the light's changes earn its minutes."""
    monitor, settled_ns, flags = CloudMonitor(), -(2**62), history.flags.copy()
    clearness = history.dni_w_m2 + history.dhi_w_m2 / history.sun[:, 2]
    for index, (time_ns, clear) in enumerate(zip(history.time_ns.tolist(), clearness.tolist(), strict=True)):
        change = monitor.update(time_ns, time_ns, clear)
        if change is not None and change.kind == "end":
            settled_ns = time_ns + round(settle_s * 1e9)
        if monitor.cloudy or change is not None or time_ns < settled_ns:
            flags[index] |= int(Quality.CLOUD)
    return replace(history, flags=flags)


def _day(weather: Weather, beds: Sequence[Bed], seed: int) -> History:
    random = np.random.default_rng(seed)
    flagged = clouds_flagged(field_day(weather, beds, SAND, STILL), EstimatorSettings().settle_s)
    return noisy(flagged, random, 0.25 * random.standard_normal(len(beds)))


def _looks(
    history: History, beds: Sequence[Bed], settings: EstimatorSettings, begin: int, every: int
) -> Iterator[tuple[int, Bed, SlopeEstimate]]:
    for last in range(begin, len(history), every):
        solved = slopes(history.until(last + 1), regions(beds), settings)
        yield from ((last, bed, answer) for bed, answer in zip(beds, solved, strict=True))


def windows() -> Iterator[Result]:
    """Mean tilt error and share of solved slopes with 20 minutes and with the default window."""
    for day, weather in days():
        ways: tuple[tuple[Literal["known", "free"], tuple[Bed, ...]], ...] = (
            ("known", BEDS_SOUTH),
            ("free", ANY_SIDE),
        )
        for azimuth, beds in ways:
            for model in ("paper", "full"):
                given = replace(EstimatorSettings(model=model, slab=SLAB), azimuth=azimuth)
                short, short_note = _errors(weather, beds, replace(given, window_s=PAPER_WINDOW_S))
                long, note = _errors(weather, beds, given)
                name = f"{day}, azimuth {azimuth}, {model} model, window by the weather: mean tilt error"
                yield Result(name, long, "°", "reported", f"{note}; 20 min: {short:.2f}°, {short_note}")


def _errors(weather: Weather, beds: Sequence[Bed], settings: EstimatorSettings) -> tuple[float, str]:
    found = [
        (bed, one)
        for seed in range(2)
        for _, bed, one in _looks(_day(weather, beds, seed), beds, settings, 40, 10)
    ]
    known = [(bed, one) for bed, one in found if np.isfinite(one.tilt_deg)]
    solved = [(bed, one) for bed, one in known if one.state in SOLVED]
    held = 100.0 * float(np.mean([holds(one, bed) for bed, one in solved]))
    error = float(np.mean([abs(one.tilt_deg - bed[0]) for bed, one in known]))
    return error, f"{100 * len(solved) / len(found):.0f} % worked out, regions hold {held:.0f} %"


def drifts() -> Iterator[Result]:
    """False alarms of a drift on clear and cloudy days, and how soon 2 K an hour on one bed is reported."""
    for day, weather in days():
        for model in ("paper", "full"):
            settings = EstimatorSettings(model=model, slab=SLAB)
            quiet = _day(weather, MIXED, 0)
            alarms = sum(_is_drift(one) for _, _, one in _looks(quiet, MIXED, settings, 60, 6))
            yield Result(
                f"{day}, {model} model: drifts reported where there are none", float(alarms), "", "0"
            )
            after = [_told_after(quiet, target, settings) for target in range(len(MIXED))]
            delays = [minutes for minutes in after if minutes is not None]
            note = f"{len(delays)} of {len(after)} beds"
            soonest = float(np.mean(delays)) if delays else float("nan")
            yield Result(
                f"{day}, {model} model: one bed drifts by 2 K/h, reported after",
                soonest,
                "min",
                "reported",
                note,
            )


def _told_after(history: History, target: int, settings: EstimatorSettings) -> int | None:
    temperature = history.temperature_k.copy()
    since = np.clip(np.arange(len(history)) - ONSET, 0, 60)
    temperature[:, 1 + target] += RATE_K_PER_H / 60.0 * since
    drifting = replace(history, temperature_k=temperature).until(ONSET + 60)
    looks = _looks(drifting, MIXED, settings, ONSET, 3)
    return next((last - ONSET for last, bed, one in looks if bed == MIXED[target] and _is_drift(one)), None)


def _is_drift(one: SlopeEstimate) -> bool:
    return "alone deviates from its prediction" in one.reason


def run() -> list[Result]:
    """All rows; about a minute."""
    return [*windows(), *drifts()]
