"""The learned estimator row by row: benign worlds, unlike beds, other skies, missing instruments.

Worlds of `benchmarks.drawn_worlds` and `benchmarks.harsh_worlds`, ``FIELDKIT_WORLDS`` a row, each on the
next of its days. A 90 % region that is neither too narrow nor too wide holds the truth in 90 % of the beds,
and is `CALIBRATED` times the mean error wide to each side. Beds of a world fail together: the interval of a
coverage is that of a bootstrap over worlds (B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap,
Chapman and Hall, 1993, section 8.6). The wind is not logged. Minutes are taken at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.drawn_worlds import (
    AUGUST,
    BROKEN,
    BROKEN_CLOUD,
    CLEAR,
    DECEMBER,
    FEBRUARY,
    RANDOM,
    World,
    drawn_world,
)
from benchmarks.estimation_learned import (
    Cell,
    Found,
    Outcome,
    Scenario,
    coverage_percent,
    estimates,
    mean_error_deg,
    outcomes,
    percent,
    without_wind,
)
from benchmarks.harsh_worlds import HARMLESS, HARSH, PEREZ, Harm, harsh_world
from benchmarks.result import Result
from fieldkit.estimation.bins import History
from fieldkit.estimation.surface_kinds import SAME

CALIBRATED = 2.06
"""Half a 90 % interval over the mean error of a normal distribution: 1.645 / sqrt(2 / pi)."""
BOOTSTRAPS = 2000
STOPS_MIN = 10
DAYS = (CLEAR, DECEMBER, FEBRUARY)
"""Clear winter days by the seed: a measured one, and two by formula at the same place."""
HOURS = (12.0, 11.0, 13.0)
"""Beginnings of sessions under broken cloud by the seed, mean solar time: other clouds of one day. [h]"""
BEFORE_SUNRISE_H = 6.75
"""Mean solar time from 24 to 39 min before the sunrise of `DAYS`. [h]"""


@dataclass(frozen=True, slots=True)
class Row:
    """A row after some minutes: mean error, half-width and coverage of the beds of some worlds.

    `held_percent` with the ends of its 95 % interval; `over_calibrated` is the half-width over that which the
    errors ask for; `ok` and `ok_before` count beds by the rule of today and by max(1.5 degrees, a tenth).
    """

    name: str
    minutes: int
    worlds: int
    beds: int
    error_deg: float
    held_percent: float
    held_within: tuple[float, float]
    half_deg: float
    over_calibrated: float
    ok: int
    ok_held_percent: float
    ok_before: int


def on_days(draw: Callable[..., World], seed: int, *, days: Sequence[str] = DAYS, **options: Any) -> World:
    """The world of a seed on the day that is its turn."""
    return draw(seed, days[seed % len(days)], **options)


def at_hours(draw: Callable[..., World], seed: int, **options: Any) -> World:
    """The world of a seed under broken cloud, begun at the hour that is its turn."""
    return draw(seed, BROKEN_CLOUD, start_h=HOURS[seed % len(HOURS)], **options)


def of_one_heap(draw: Callable[..., World], seed: int, **options: Any) -> World:
    """A world whose beds are stated to be alike, as those of `drawn_world` are."""
    world = draw(seed, **options)
    alike = replace(world.settings, same=True, prior=replace(world.settings.prior, **SAME))
    return replace(world, settings=alike)


def scenarios() -> Iterator[Scenario]:
    """All rows of days whose files are here."""
    clear, broken = partial(on_days, drawn_world), partial(at_hours, drawn_world)
    yield _row(
        "clear, known, air", clear, Cell(20, 1.2, half_deg=3.1), Cell(60, 1.2, half_deg=3.1), _long(0.9, 2.3)
    )
    if BROKEN.exists():
        yield _row("broken", broken, Cell(60, 0.7, half_deg=1.8), _long(0.5, 1.2))
        yield _row("broken, random, free", partial(broken, beds=RANDOM), _long(0.8, 2.0))
        yield _row("broken, one heap stated", partial(of_one_heap, broken), _long(0.5, 1.0))
    yield _row("clear, one heap stated", partial(of_one_heap, clear), _long(0.9, 1.9))
    with_bed = partial(of_one_heap, partial(clear, known_bed=True))
    yield _row("clear, one known bed, one heap", with_bed, Cell(60, 0.7), _long(0.6))
    january, august = (partial(on_days, drawn_world, days=(day,)) for day in (CLEAR, AUGUST))
    yield _row("no air, longwave logged, January", january, Cell(60, 2.4), _long(2.1), measured=without_air)
    yield _row("nothing but light logged, January", january, _long(2.5), measured=light_alone)
    yield _row("nothing but light logged, August", august, _long(2.5), measured=light_alone)
    yield _row("air log stops after 10 min", clear, _long(2.1), measured=air_stops)
    yield _row(
        "sunrise", partial(clear, start_h=BEFORE_SUNRISE_H), _long(), sizes=f"begun at {BEFORE_SUNRISE_H} h"
    )
    for veil, must in ((0.3, 2.2), (0.15, 1.5)):
        yield _harsh(f"thin high cloud, {veil:.0%}", _long(must), replace(HARMLESS, veil=veil))
    for minutes in (20.0, 40.0, 80.0):
        drying = replace(HARMLESS, drying_min=minutes)
        yield _harsh(f"one bed dries, {minutes:.0f} min", _long(2.0), drying)
    yield _harsh("reference off by 2°", _long(), replace(HARMLESS, level_deg=2.0))
    warm = replace(HARMLESS, common_k=0.5, warm_up_k=0.25, vignetting_k=0.15)
    yield _harsh("camera in the sun", _long(), warm)
    yield _harsh("lasting exchange of its own", _long(), replace(HARMLESS, exchange_slow=0.10))
    yield _harsh("albedo of its own, south", _long(), replace(HARMLESS, albedo_sd=0.05))
    yield _harsh("albedo of its own, free", _long(), replace(HARMLESS, albedo_sd=0.05), beds=RANDOM)
    yield _harsh("exchange of its own for minutes", _long(1.9), replace(HARMLESS, exchange_fast=0.05))
    yield _harsh("people", _long(2.5), replace(HARMLESS, shadows_per_h=2.0))
    yield _harsh("shutter", _long(1.7), replace(HARMLESS, shutter_k=0.08))
    yield _harsh("wall", _long(), replace(HARMLESS, wall_deg=20.0))
    yield _harsh("everything at once, clear", _long(1.3), HARSH)
    if BROKEN.exists():
        of_broken = partial(harsh_world, day=BROKEN_CLOUD)
        yield _row(
            "Perez sky, broken", partial(of_broken, harm=PEREZ_SKY), _long(0.6), sizes=PEREZ_SKY.sizes()
        )
        yield _row(
            "everything at once, broken", partial(of_broken, harm=HARSH), _long(0.9), sizes=HARSH.sizes()
        )


PEREZ_SKY = replace(HARMLESS, skies=(PEREZ,))


def _long(must_deg: float = float("nan"), half_deg: float = float("nan")) -> Cell:
    return Cell(180, must_deg, half_deg=half_deg)


def _row(
    name: str,
    draw: Callable[..., World],
    *cells: Cell,
    measured: Callable[[History], History] = without_wind,
    sizes: str = "",
) -> Scenario:
    return Scenario(
        name, cells, {}, with_others=False, draw=draw, measured=measured, sizes=sizes, at_once=True
    )


def _harsh(name: str, cell: Cell, harm: Harm, **options: Any) -> Scenario:
    return _row(name, partial(on_days, harsh_world, harm=harm, **options), cell, sizes=harm.sizes())


def without_air(history: History) -> History:
    """The minutes of a field without an air thermometer."""
    return without_wind(replace(history, air_k=np.full(len(history), np.nan)))


def light_alone(history: History) -> History:
    """The minutes of a field with a camera and a light meter only."""
    unknown = np.full(len(history), np.nan)
    return without_air(replace(history, longwave_down_w_m2=unknown, dhi_w_m2=unknown))


def air_stops(history: History) -> History:
    """The minutes of a field whose air thermometer stops."""
    air_k = history.air_k.copy()
    air_k[STOPS_MIN:] = np.nan
    return without_wind(replace(history, air_k=air_k))


def row_of(scenario: Scenario, cell: Cell, worlds: Sequence[Outcome]) -> Row:
    """The row of a cell."""
    beds = estimates(worlds, "learned", cell)
    by_world = [estimates([world], "learned", cell) for world in worlds]
    certain = [bed for bed in beds if bed.is_certain]
    error, half = mean_error_deg(beds), float(np.nanmean([bed.half_deg for bed in beds]))
    return Row(
        scenario.name,
        cell.minutes,
        len(worlds),
        len(beds),
        error,
        coverage_percent(beds),
        bootstrap(by_world),
        half,
        half / (CALIBRATED * error),
        len(certain),
        percent([bed.is_inside for bed in certain]),
        sum(bed.is_ok_by_old_limit for bed in beds),
    )


def bootstrap(by_world: Sequence[Sequence[Found]]) -> tuple[float, float]:
    """95 % interval of a coverage in per cent, by worlds drawn anew."""
    solved = [[bed.is_inside for bed in beds if not bed.is_silent] for beds in by_world]
    counts = np.array([[sum(insides), len(insides)] for insides in solved])
    drawn = np.random.default_rng(1).integers(len(counts), size=(BOOTSTRAPS, len(counts)))
    held, given = counts[drawn].sum(axis=1).T
    low, high = np.quantile(100.0 * held / np.maximum(given, 1), (0.025, 0.975))
    return float(low), float(high)


def run() -> list[Result]:
    """All rows; ``FIELDKIT_WORLDS=12`` takes an hour of processor time."""
    results: list[Result] = []
    for scenario, worlds in outcomes(list(scenarios())):
        for cell in scenario.cells:
            row, name = row_of(scenario, cell, worlds), f"{scenario.name}, {cell.minutes} min"
            low, high = row.held_within
            ok = f"{row.ok} of {row.beds} ok ({row.ok_held_percent:.0f} % held), {row.ok_before} before"
            about = f"{row.worlds} worlds, 95 %: {low:.0f}-{high:.0f} %; {ok}; {scenario.sizes}"
            results.append(Result(f"{name}: mean tilt error", row.error_deg, "°", _most(cell.must_deg)))
            results.append(Result(f"{name}: regions hold the truth", row.held_percent, "%", "85-97", about))
            wide = f"{row.over_calibrated:.2f} times what the errors ask for"
            results.append(Result(f"{name}: half-width", row.half_deg, "°", _most(cell.half_deg), wide))
    return results


def _most(goal: float) -> str:
    return "reported" if np.isnan(goal) else f"≤ {goal:g}"
