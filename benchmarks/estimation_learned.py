"""The learned estimator in worlds it does not know: errors, regions, silence and cost, beside other models.

`WORLDS` worlds a row (``FIELDKIT_WORLDS`` for another number) of `benchmarks.drawn_worlds`, seeds from
`FIRST_SEED` on, which no setting was chosen with. All rows of one scenario come from the same runs; `paper`
and `full` estimate from the identical minutes. Files of other days are read from a `shared` folder beside the
project; a row says where there is none. Another station's day counts as sunny if nine minutes in ten of the
session have sunshine as WMO-No. 8, volume I, chapter 8, defines it.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.drawn_worlds import (
    AUGUST,
    BROKEN,
    BROKEN_CLOUD,
    CLEAR,
    RANDOM,
    SOUTH,
    World,
    drawn_world,
)
from benchmarks.ok_counts import is_ok_by_old_limit
from benchmarks.result import Result
from benchmarks.sides import seconds
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.slopes import slopes
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import CERTAIN, SOLVED, SlopeEstimate

WORLDS = int(os.environ.get("FIELDKIT_WORLDS", "200"))
FIRST_SEED = 1000
FIRST_MINUTE = 5
"""Silence counts from here on: no estimate is due before."""
OWN_STATION = BROKEN.name[:3]
SUNSHINE_W_M2, SUNNY_SHARE = 120.0, 0.9
BOARDS = "with the shade test, clear, south, known"
TEN_HOURS, THREE_HOURS, LAST = 600, 180, 20


def holds(slope: SlopeEstimate, bed: Region) -> bool:
    """Whether the tilt's interval contains that of the bed; an azimuth has an interval of its own."""
    return slope.tilt_low_deg <= bed.tilt_deg <= slope.tilt_high_deg


def without_wind(history: History) -> History:
    """The same minutes, from a field without an anemometer."""
    return replace(history, wind_m_s=np.full(len(history), np.nan))


@dataclass(frozen=True, slots=True)
class Cell:
    """The estimate after some minutes of a session; goals of its mean error and half-width, degrees."""

    minutes: int
    must_deg: float = float("nan")
    half_deg: float = float("nan")


@dataclass(frozen=True, slots=True)
class Scenario:
    """Sessions of one kind: the options of what draws their worlds, and whether air temperature is logged.

    `measured` changes what the instruments give, such as a log that stops; `sizes` are those of what differs.
    `at_once` estimates from the minutes of each cell at once, in half the time of minute by minute.
    """

    name: str
    cells: tuple[Cell, ...]
    world: dict[str, Any]
    air: bool = True
    with_others: bool = True
    draw: Callable[..., World] = drawn_world
    measured: Callable[[History], History] = without_wind
    sizes: str = ""
    at_once: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """One estimate of one bed against its truth; errors are NaN without a tilt.

    Silent is one whose state rejects the minutes, though it may show a tilt. `scaled_error` is the error of
    tilt over the half of the region on the side of the truth.
    """

    tilt_error_deg: float
    scaled_error: float
    is_silent: bool
    is_inside: bool
    is_certain: bool
    is_ok_by_old_limit: bool
    half_deg: float


@dataclass(slots=True)
class Outcome:
    """Outcome of one world: estimates by minutes for each model, and the share of minutes without one."""

    by_model: dict[str, dict[int, list[Found]]] = field(default_factory=dict)
    silent_share: float = 0.0


def scenarios() -> Iterator[Scenario]:
    """All rows of days whose files are here."""
    south: dict[str, Any] = {"day": CLEAR, "beds": SOUTH}
    name = "clear, south, known"
    without = (Cell(20, 3.3), Cell(60, 3.0), Cell(180, 2.2))
    yield Scenario(f"{name}, no air temperature", without, south, air=False)
    yield Scenario(name, (Cell(20, 1.7), Cell(60, 1.5), Cell(180, 1.0)), south)
    with_known = {**south, "known_bed": True, "offset_sd_k": 0.1}
    yield Scenario(
        f"{name}, one known bed, offsets 0.1 K", (Cell(20, 1.0), Cell(60, 0.7), Cell(180, 0.5)), with_known
    )
    yield Scenario(BOARDS, (Cell(60),), {**south, "shade_test": True}, with_others=False)
    yield Scenario(
        "the world as configured", (Cell(20, 0.7), Cell(180, 0.5)), {**south, "as_configured": True}
    )
    free = {"day": CLEAR, "beds": RANDOM}
    yield Scenario("clear, random beds, free", (Cell(60, 1.6), Cell(180, 1.2)), free)
    yield Scenario("August by formula, random beds, free", (Cell(180),), {**free, "day": AUGUST})
    ground = {**south, "measured_ground": True}
    yield Scenario(f"{name}, fields as on measured ground", (Cell(20), Cell(180)), ground)
    if BROKEN.exists():
        broken = (Cell(20, 2.0), Cell(60, 0.8), Cell(180, 0.7))
        yield Scenario("broken, south, known", broken, {**south, "day": BROKEN_CLOUD})
        yield Scenario("broken, random beds, free", (Cell(180, 0.5),), {**free, "day": BROKEN_CLOUD})
    for path in other_sunny_days():
        # 1.5 times what is asked of the clear day
        cells = (Cell(20, 2.55), Cell(60, 2.25), Cell(180, 1.5))
        yield Scenario(f"{path.stem}, south, known", cells, {**south, "day": str(path)})


def other_sunny_days() -> list[Path]:
    """Files of sunny days at other stations."""
    files = sorted(BROKEN.parent.glob("*.dat"))
    return [path for path in files if not path.name.startswith(OWN_STATION) and _is_sunny(path)]


def _is_sunny(path: Path) -> bool:
    session = drawn_world(FIRST_SEED, str(path), as_configured=True).history
    return float(np.mean(session.dni_w_m2 > SUNSHINE_W_M2)) >= SUNNY_SHARE


def missing() -> Iterator[Result]:
    """Rows that are not measured because there is no file for them."""
    for name, is_here in (("broken", BROKEN.exists()), ("other stations", bool(other_sunny_days()))):
        if not is_here:
            note = f"no file of such a day in {BROKEN.parent}"
            yield Result(f"{name}, south, known: not measured", float("nan"), "°", "reported", note)


# --- one world


def outcome(scenario: Scenario, seed: int) -> Outcome:
    """Run the models through one world."""
    world = scenario.draw(seed, **scenario.world)
    history = scenario.measured(world.history.until(max(cell.minutes for cell in scenario.cells)))
    if not scenario.air:
        history = replace(history, air_k=np.full(len(history), np.nan))
    settings = replace(world.settings, model="learned")
    if scenario.at_once:
        by_cell = {
            cell.minutes: _against_truths(
                SlopeChain(world.regions, settings).at_once(history.until(cell.minutes)).slopes, world
            )
            for cell in scenario.cells
        }
        return Outcome({"learned": by_cell})
    run = [minute.slopes for minute in SlopeChain(world.regions, settings).series(history)]
    silent = [slope.state not in SOLVED for minute in run[FIRST_MINUTE - 1 :] for slope in minute]
    learned = {cell.minutes: _against_truths(run[cell.minutes - 1], world) for cell in scenario.cells}
    result = Outcome({"learned": learned}, float(np.mean(silent)))
    if scenario.with_others:
        for model in ("paper", "full"):
            result.by_model[model] = {
                cell.minutes: _against_truths(_whole_window(world, history, model, cell.minutes), world)
                for cell in scenario.cells
            }
    return result


def _whole_window(world: World, history: History, model: Any, minutes: int) -> tuple[SlopeEstimate, ...]:
    """Slopes by another model from all of the first minutes."""
    settings = replace(world.settings, model=model, window_s=60.0 * (minutes - 1))
    return slopes(history.until(minutes), world.regions, settings)


def _against_truths(estimates: Sequence[SlopeEstimate], world: World) -> list[Found]:
    truths = {region.name: region for region in world.regions}
    return [_against(estimate, truths[estimate.region]) for estimate in estimates]


def _against(estimate: SlopeEstimate, truth: Region) -> Found:
    silent = estimate.state not in SOLVED
    if np.isnan(estimate.tilt_deg):
        return Found(float("nan"), float("inf"), silent, False, False, False, float("nan"))
    error = truth.tilt_deg - estimate.tilt_deg
    half = (
        estimate.tilt_high_deg - estimate.tilt_deg
        if error > 0.0
        else estimate.tilt_deg - estimate.tilt_low_deg
    )
    scaled = abs(error) / max(half, 1e-6)
    is_certain, half = estimate.state in CERTAIN, estimate.tilt_half_width_deg
    return Found(
        abs(error), scaled, silent, holds(estimate, truth), is_certain, is_ok_by_old_limit(estimate), half
    )


# --- all worlds


def processes() -> ProcessPoolExecutor:
    """A process for each processor, of one thread each."""
    # read by the arithmetic libraries when a process imports them
    os.environ.update({"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"})
    return ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn"))


def outcomes(asked: Sequence[Scenario]) -> Iterator[tuple[Scenario, list[Outcome]]]:
    """Every scenario with the outcomes of its worlds."""
    seeds = range(FIRST_SEED, FIRST_SEED + WORLDS)
    with processes() as pool:
        waiting = [(scenario, [pool.submit(outcome, scenario, seed) for seed in seeds]) for scenario in asked]
        for scenario, futures in waiting:
            yield scenario, [future.result() for future in futures]


def rows(scenario: Scenario, worlds: Sequence[Outcome]) -> Iterator[Result]:
    """Error, coverage and silence of one scenario."""
    for cell in scenario.cells:
        name = f"{scenario.name}, {cell.minutes} min"
        found = estimates(worlds, "learned", cell)
        answered = sum(not estimate.is_silent for estimate in found)
        must = "reported" if np.isnan(cell.must_deg) else f"≤ {cell.must_deg:g}"
        error = mean_error_deg(found)
        yield Result(f"{name}: mean tilt error", error, "°", must, _beside(worlds, cell))
        certain = percent([estimate.is_certain for estimate in found])
        certain_before = percent([estimate.is_ok_by_old_limit for estimate in found])
        note = f"{answered} of {len(found)} estimates, {certain:.0f} % ok ({certain_before:.0f} % before)"
        yield Result(f"{name}: regions hold the truth", coverage_percent(found), "%", "85-95", note)
    silent = 100.0 * float(np.mean([world.silent_share for world in worlds]))
    yield Result(f"{scenario.name}: minutes without a slope", silent, "%", "≤ 10")


def estimates(worlds: Sequence[Outcome], model: str, cell: Cell) -> list[Found]:
    """All estimates of a model in some worlds after the minutes of a cell."""
    return [estimate for world in worlds for estimate in world.by_model.get(model, {}).get(cell.minutes, [])]


def percent(values: Sequence[bool]) -> float:
    """Share of what is true, per cent; NaN of nothing."""
    return 100.0 * float(np.mean(values)) if values else float("nan")


def coverage_percent(found: Sequence[Found]) -> float:
    """Share of regions that hold the truth, of estimates that are not silent; NaN without any."""
    return percent([estimate.is_inside for estimate in found if not estimate.is_silent])


def mean_error_deg(found: Sequence[Found]) -> float:
    """Mean error of tilt, degrees; NaN without any tilt."""
    errors = [estimate.tilt_error_deg for estimate in found if not np.isnan(estimate.tilt_error_deg)]
    return float(np.mean(errors)) if errors else float("nan")


def _beside(worlds: Sequence[Outcome], cell: Cell) -> str:
    """Mean errors of the other models, and how often they are silent."""
    parts = [
        f"{model} {mean_error_deg(found):.2f}° ({percent([other.is_silent for other in found]):.0f} % silent)"
        for model in ("paper", "full")
        if (found := estimates(worlds, model, cell))
    ]
    return ", ".join([*parts, f"{len(worlds)} worlds from seed {FIRST_SEED}"])


def accuracy() -> list[Result]:
    """Every scenario, and what the boards bring."""
    results: list[Result] = []
    errors: dict[str, float] = {}
    for scenario, worlds in outcomes(list(scenarios())):
        results += rows(scenario, worlds)
        errors[scenario.name] = mean_error_deg(estimates(worlds, "learned", Cell(60)))
    share = errors[BOARDS] / errors["clear, south, known"]
    return [*results, Result("shade test: error over that without, 60 min", share, "", "≤ 0.6"), *missing()]


# --- cost


def with_targets(world: World, count: int) -> World:
    """The same world with its beds repeated, each with noise of its own."""
    targets = [i for i, region in enumerate(world.regions) if region.kind is RegionKind.TARGET]
    columns = [i for i in range(len(world.regions)) if i not in targets]
    columns += [targets[i % len(targets)] for i in range(count)]
    temperature = world.history.temperature_k[:, columns]
    noise = world.settings.noise_k * np.random.default_rng(count).standard_normal(temperature.shape)
    history = replace(
        world.history,
        temperature_k=temperature + noise,
        region_flags=world.history.region_flags[:, columns],
        probe_k=world.history.probe_k[:, columns],
    )
    regions = tuple(replace(world.regions[i], name=f"{place}") for place, i in enumerate(columns))
    return replace(world, history=history, regions=regions)


def minute_costs(world: World) -> tuple[FloatArray, list[int]]:
    """Seconds of each minute, and the size of the chain after three and ten hours, bytes."""
    chain = SlopeChain(world.regions, replace(world.settings, model="learned"))
    took, sizes = [], []
    for last in range(1, len(world.history) + 1):
        history = world.history.until(last)
        took.append(seconds(partial(chain.at, history)))
        if last in (THREE_HOURS, TEN_HOURS):
            sizes.append(len(pickle.dumps(chain)))
    return np.array(took), sizes


def cost() -> list[Result]:
    """A minute of three and of thirty regions, and ten hours."""
    short = drawn_world(FIRST_SEED, CLEAR, RANDOM)
    three, _ = minute_costs(short)
    thirty, _ = minute_costs(with_targets(short, 30))
    ten, sizes = minute_costs(drawn_world(FIRST_SEED, AUGUST, RANDOM, start_h=7.0, minutes=TEN_HOURS))
    late, early = _p50(ten), _p50(ten[:THREE_HOURS])
    whole = float(ten.mean() / ten[:THREE_HOURS].mean())
    megabytes = f"{1e-6 * sizes[0]:.1f} and {1e-6 * sizes[1]:.1f} MB"
    return [
        Result("minute of three beds after 3 h (p50)", 1e3 * _p50(three), "ms", "≤ 25", _redraws(three)),
        Result(
            "minute of thirty regions after 3 h (p50)", 1e3 * _p50(thirty), "ms", "≤ 60", _redraws(thirty)
        ),
        Result("minute after 10 h over one after 3 h (p50)", late / early, "", "about 1"),
        Result("10 h over 3 h, a minute with redraws", whole, "", "about 1", _redraws(ten)),
        Result("state kept after 10 h over that after 3 h", sizes[1] / sizes[0], "", "about 1", megabytes),
    ]


def _p50(took: FloatArray) -> float:
    return float(np.median(took[-LAST:]))


def _redraws(took: FloatArray) -> str:
    return f"mean with redraws {1e3 * took.mean():.0f} ms, slowest minute {1e3 * took.max():.0f} ms"


def run() -> list[Result]:
    """All rows; ``FIELDKIT_WORLDS=10`` takes minutes, the default hours."""
    return [*cost(), *accuracy()]
