"""Sessions estimated with every combination of parameters: the runs of a sweep, and what they gave."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

from fieldkit.model.arrays import FloatArray, IntArray, TableArray
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SOLVED, SlopeState
from fieldkit.phrases import counted
from fieldkit.results import batch
from fieldkit.results.batch import Estimate, Progress, no_progress, outcomes_of
from fieldkit.results.json_document import attributes
from fieldkit.results.minutes import Outcome, Run, run_of
from fieldkit.results.result_files import provenance, write_results
from fieldkit.results.sources import Source, log_info, qualified_key

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Sweep:
    """Result of a sweep: a table with a row for each session, set of parameters and region, and the ranking.

    `ranking` is None where no region of known tilt was estimated. `failures` has the sessions that could not
    be estimated, or that are damaged in part, and why. Of its `runs`, `cached` were estimated before.

    Examples
    --------
    >>> sweep = campaign.sweep({"albedo": [0.20, 0.25]})
    >>> sweep.best
    {'surface.albedo': '0.2'}
    >>> sweep.to_frame()[["surface.albedo", "region", "median_tilt_deg"]].round(1).head(3)
       surface.albedo region  median_tilt_deg
    0             0.2    b05              4.8
    1             0.2    b15             14.9
    2             0.2    b25             24.7
    >>> [path.name for path in sweep.write(campaign.directory / "results" / "albedo")]
    ['albedo.csv', 'albedo.parquet', 'albedo.json']
    >>> sweep.ranking_document()["best"]
    {'surface.albedo': '0.2'}
    """

    grid: Grid
    columns: Mapping[str, Sequence[Any]]
    ranking: Ranking | None
    failures: Mapping[Path, FieldkitError]
    sources: tuple[Source, ...] = ()
    runs: int = 0
    cached: int = 0

    @property
    def best(self) -> dict[str, str]:
        """The best set by the key of each parameter; empty without a ranking."""
        if self.ranking is None:
            return {}
        return dict(setting.split("=", 1) for setting in self.grid.sets[self.ranking.best])

    def __repr__(self) -> str:
        best = ", ".join(f"{key} = {value}" for key, value in self.best.items()) or "not ranked"
        sets, of_sessions = counted(len(self.grid.sets), "set"), counted(len(self.sources), "session")
        return f"<Sweep of {sets}, {of_sessions}; best: {best}>"

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))

    def write(self, base: Path) -> list[Path]:
        """Write ``BASE.csv``, ``BASE.parquet`` and their provenance ``BASE.json``; raises `StorageError`."""
        about = {
            **provenance(self.sources, self.failures),
            "parameters": {parameter.key: parameter.values for parameter in self.grid.parameters},
            "ranking": self.ranking_document(),
        }
        return write_results(base, self.columns, about)

    def ranking_document(self) -> dict[str, Any] | None:
        """The ranking as the result file holds it; None without one."""
        if (ranking := self.ranking) is None:
            return None
        effects = {
            effect.key: dict(zip(effect.values, effect.error_deg, strict=True)) for effect in ranking.effects
        }
        return {
            "best": self.best,
            "error_deg": ranking.error_deg[ranking.best],
            **attributes(ranking, "worst_deg", "same_choice", "wide_share", "warnings"),
            "left_out_deg": ranking.cross_validated_deg,
            "sessions": ranking.folds,
            "sessions_without_slopes": ranking.unranked,
            "sensitivity": effects,
        }


def sweep(
    sessions: Iterable[str | Path],
    parameters: Mapping[str, Sequence[Any]] | Grid,
    *,
    present: bool = False,
    executor: Executor | None = None,
    on_progress: Progress = no_progress,
    notify: Callable[[str], None] = log_info,
) -> Sweep:
    """Estimate session files with every combination of parameters; what was estimated before is cached.

    `parameters` are values to try by key of ``fieldkit.toml``, or their grid:
    ``{"albedo": [0.15, 0.20, 0.25], "estimator.model": ["paper", "full"]}``. Besides, with the learned model,
    ``"prior": ["configured", "others"]``: each session with the prior as configured, and with what all other
    sessions taught of sand and light meter. `present` takes the campaign's ``fieldkit.toml`` and regions as
    they are now. `executor` is any of `concurrent.futures`, whose workers estimate; this process unless
    given. `on_progress` is called with the number of finished runs and of all, `notify` receives how many
    there are, before the first.

    Sessions that cannot be estimated are in the `failures` of the sweep. Raises `ConfigError` for a key or
    value that no estimate has, and for the prior from others of a single session.
    """
    grid = parameters if isinstance(parameters, Grid) else grid_of(parameters)
    sources, failures = batch.readable_sources(map(Path, sessions), present=present)
    runs = runs_of(sources, grid, partial(outcomes_of, failures=failures, executor=executor))
    sets, of_sessions = counted(len(grid.sets), "set"), counted(len(sources), "session")
    notify(f"{counted(len(runs), 'run')}: {sets} of parameters, {of_sessions}")
    table = SweepTable(grid, batch.session_names(sources))
    for outcome in outcomes_of(runs, failures, executor, on_progress):
        table.add(outcome)
    return Sweep(grid, table.columns(), table.ranking(), failures, tuple(sources), len(runs), table.cached)


def runs_of(sources: Sequence[Source], grid: Grid, estimate: Estimate) -> list[Run]:
    """Every session with every set, learning from the other sessions first where a set asks for it.

    Raises `ConfigError`, also for a key of no effect.
    """
    runs = [
        run_of(source, _config_settings(settings), number)
        for source in sources
        for number, settings in enumerate(grid.sets)
    ]
    for parameter in grid.varied_parameters if sources else ():
        if parameter.key == PRIOR:
            continue
        tried = [run_of(sources[0], [f"{parameter.key}={value}"]) for value in parameter.values[:2]]
        if tried[0].key == tried[1].key:
            tables = "surface, air, irradiance, estimator, slab, site"
            raise ConfigError(
                "does not enter an estimate", place=parameter.key, fix=f"choose a key of {tables}"
            )
    others = [run for run in runs if f"{PRIOR}={OTHERS}" in grid.sets[run.number]]
    taught = {(run.source.path, run.number): run for run in _taught(others, grid, estimate)} if others else {}
    return [taught.get((run.source.path, run.number), run) for run in runs]


PRIOR, CONFIGURED, OTHERS = "prior", "configured", "others"
"""Values of a set for the prior of the learned model: as configured, or as the other sessions learnt."""


def _config_settings(setting: Sequence[str]) -> list[str]:
    """The ``KEY=VALUE`` of a set that are keys of ``fieldkit.toml``."""
    return [assignment for assignment in setting if not assignment.startswith(f"{PRIOR}=")]


def _taught(runs: Sequence[Run], grid: Grid, estimate: Estimate) -> Iterator[Run]:
    """The runs with what the other sessions taught."""
    for run, prior in prior_of_others(runs, estimate):
        yield run_of(run.source, [*_config_settings(grid.sets[run.number]), *prior], run.number)


def prior_of_others(runs: Sequence[Run], estimate: Estimate) -> Iterator[tuple[Run, list[str]]]:
    """Each run with the ``KEY=VALUE`` that the other sessions of its set taught of sand and light meter.

    Each session is learnt from once for each set of parameters, with its known slopes as references. The one
    that is estimated keeps them as targets, so that its errors are those of unknown slopes. Raises
    `ConfigError` with a single session, and with another model than the learned.
    """
    from fieldkit.estimation.carried import carry_over, keys  # takes a second

    by_others = f"{PRIOR}={OTHERS}"
    if len({run.source.path for run in runs}) < 2:
        raise ConfigError("needs two sessions or more", place=by_others, fix="name the other sessions too")
    if any(run.settings.model != "learned" for run in runs):
        raise ConfigError("needs the learned model", place=by_others, fix='set estimator.model = "learned"')
    outcomes = list(estimate([_learning(run) for run in runs]))
    for run in runs:
        others = [
            (outcome.run.settings, learnt)
            for outcome in outcomes
            if outcome.run.number == run.number and outcome.run.source.path != run.source.path
            if (learnt := outcome.estimates.learnt.final) is not None
        ]
        prior = keys(carry_over(run.settings, others), run.settings)
        yield run, [f"{key}={value!r}" for key, value in prior.items()]


def _learning(run: Run) -> Run:
    """The run with its known slopes as references."""
    from fieldkit.estimation.scale import known_slopes, with_known

    slopes = known_slopes(run.source.regions.latest, (), run.source.path)
    return replace(run, source=replace(run.source, regions=with_known(run.source.regions, slopes)))


# Grids of parameters

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
RANGE = re.compile(rf"({NUMBER}):({NUMBER}):({NUMBER})")
UNSTEPPED = re.compile(rf"{NUMBER}:{NUMBER}")
MOST_VALUES = 10_000


@dataclass(frozen=True)
class Parameter:
    """A key of ``fieldkit.toml`` and the values to try, as they are written."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Grid:
    """Every combination of the parameters' values; `sets` lists them, the last parameter fastest."""

    parameters: tuple[Parameter, ...]

    @property
    def sets(self) -> list[tuple[str, ...]]:
        """Each set of parameters as ``KEY=VALUE``; a grid of none has one, as configured."""
        options = [
            [f"{parameter.key}={value}" for value in parameter.values] for parameter in self.parameters
        ]
        return list(itertools.product(*options))

    @property
    def varied_parameters(self) -> tuple[Parameter, ...]:
        """The parameters of more than one value."""
        return tuple(parameter for parameter in self.parameters if len(parameter.values) > 1)


def read_grid(settings: Sequence[str]) -> Grid:
    """The grid that ``--set`` asks for; raises `ConfigError`.

    ``LOW:HIGH:STEP`` counts with both ends, in decimal, so that 0.15:0.35:0.05 holds 0.3 and not
    0.30000000000000004. ``A,B,C`` is a list; a list in brackets is one value.
    """
    parameters = [_parse_setting(setting) for setting in settings]
    keys = [parameter.key for parameter in parameters]
    for key in keys:
        if keys.count(key) > 1:
            raise ConfigError("given more than once", place=key, fix=f"write one list: {key}=A,B,C")
    return _grid(parameters)


def grid_of(parameters: Mapping[str, Sequence[Any]]) -> Grid:
    """The grid of Python values by key; raises `ConfigError`."""
    names = {name: name if name == PRIOR else qualified_key(name) for name in parameters}
    return _grid([_parameter(names[name], values) for name, values in parameters.items()])


def _grid(parameters: Sequence[Parameter]) -> Grid:
    for parameter in parameters:
        unknown = set(parameter.values) - {CONFIGURED, OTHERS}
        if parameter.key == PRIOR and unknown:
            raise ConfigError(
                f"a prior is {CONFIGURED} or taken from {OTHERS}",
                place=f"{PRIOR}={sorted(unknown)[0]}",
                fix=f"write {PRIOR}={CONFIGURED},{OTHERS}",
            )
    return Grid(tuple(parameters))


def _parameter(key: str, values: Sequence[Any]) -> Parameter:
    """A key and its values as ``fieldkit.toml`` would have them."""
    if isinstance(values, str) or not hasattr(values, "__len__") or not len(values):
        raise ConfigError(
            f"{values!r} is not a list of values", place=key, fix="write it as [0.15, 0.20, 0.25]"
        )
    plain = [value.item() if hasattr(value, "item") else value for value in values]  # of a numpy array
    texts = [value if isinstance(value, str) else tomlkit.item(value).as_string() for value in plain]
    return Parameter(key, tuple(dict.fromkeys(texts)))


def _parse_setting(setting: str) -> Parameter:
    key, equals, text = (part.strip() for part in setting.partition("="))
    if not equals or not key or not text:
        raise ConfigError("no value", place=setting, fix="write it as surface.albedo=0.15:0.35:0.05")
    if text.startswith("["):
        return Parameter(key, (text,))
    values: list[str] = []
    for piece in text.split(","):
        match = RANGE.fullmatch(piece.strip())
        if not match and UNSTEPPED.fullmatch(piece.strip()):
            raise ConfigError("a range without its step", place=setting, fix=f"{key}={piece.strip()}:STEP")
        values.extend(_stepped_values(setting, *map(Decimal, match.groups())) if match else [piece.strip()])
    return Parameter(key, tuple(dict.fromkeys(values)))


def _stepped_values(setting: str, low: Decimal, high: Decimal, step: Decimal) -> list[str]:
    if step <= 0 or high < low or (high - low) / step > MOST_VALUES:
        raise ConfigError(
            f"{low} to {high} in steps of {step} is not a valid range",
            place=setting,
            fix="use LOW:HIGH:STEP with STEP above 0",
        )
    return [format(low + count * step, "f") for count in range(int((high - low) / step) + 1)]


# Ranking. A set's error is the mean over sessions of the mean over regions of the median absolute tilt
# error, so a long session weighs no more than a short one. A set that estimates much less often than the
# others is not ranked: it would win by excluding the difficult minutes.

OVERFIT_RATIO = 1.2
"""Cross-validated error over the best set's error, above which the choice is called overfitted."""

LEAST_SOLVED = 0.9
"""Share of the most slopes that any set solves, below which a set is not ranked."""


@dataclass(frozen=True)
class Effect:
    """Error as a function of one parameter: its mean over all ranked sets of each value, degrees."""

    key: str
    values: tuple[str, ...]
    error_deg: tuple[float, ...]

    @property
    def span_deg(self) -> float:
        """Effect of the choice of this parameter."""
        return float(np.nanmax(self.error_deg) - np.nanmin(self.error_deg))

    @property
    def best_at_edge(self) -> bool:
        """True if the best value is the first or last of three or more."""
        return len(self.values) > 2 and int(np.nanargmin(self.error_deg)) in (0, len(self.values) - 1)


@dataclass(frozen=True)
class Ranking:
    """The best set, and how far it can be trusted.

    `error_deg` is that of every set (NaN: not ranked), `worst_deg` the largest single error of the best.
    `cross_validated_deg` is the mean error of sessions under the parameters chosen from the other
    sessions (NaN with fewer than two), `same_choice` in how many of `folds` that choice was the best set
    itself. `wide_share` of the best set's slopes are wide. `unranked` are the sessions in
    which no ranked set has an error.
    """

    best: int
    error_deg: FloatArray
    worst_deg: float
    cross_validated_deg: float
    same_choice: int
    folds: int
    effects: tuple[Effect, ...]
    wide_share: float
    unranked: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to adopt the best set."""
        error_deg, held_out = float(self.error_deg[self.best]), self.cross_validated_deg
        warnings = []
        if self.folds < 2:
            warnings.append("one session cannot distinguish a good parameter from chance; sweep over several")
        elif np.isnan(held_out):
            warnings.append(
                "not cross-validated: no session has a slope with the parameters chosen from the others"
            )
        elif held_out > OVERFIT_RATIO * error_deg:
            warnings.append(
                f"overfitting: with parameters chosen from the others a session has {held_out:.2f}°, "
                f"not {error_deg:.2f}°; it stays the same in {self.same_choice} of {self.folds} trials"
            )
        elif self.same_choice < self.folds:
            changed = self.folds - self.same_choice
            warnings.append(
                f"the choice is not stable: in {changed} of {self.folds} trials without one session another "
                f"set is chosen, and it is about as good ({held_out:.2f}°, the best set {error_deg:.2f}°)"
            )
        if self.unranked:
            warnings.append(
                f"not ranked, without a slope of a region of known tilt: {', '.join(self.unranked)}"
            )
        if self.wide_share > 0.0:
            warnings.append(
                f"{self.wide_share:.0%} of the best set's slopes are wide: their likelihood "
                "regions are wide however small the errors came out"
            )
        warnings.extend(
            f"{effect.key}: the best value is at the edge of those tried; widen the range"
            for effect in self.effects
            if effect.best_at_edge and effect.span_deg > 0.05
        )
        return tuple(warnings)


def rank(
    error_deg: FloatArray,
    worst_deg: FloatArray,
    solved: IntArray,
    wide: IntArray,
    grid: Grid,
    names: Sequence[str],
) -> Ranking | None:
    """Rank sets (rows) by their errors in sessions (columns), degrees, NaN where nothing is known.

    `worst_deg` and `solved` are the largest error and the number of solved slopes, of the same shape,
    `wide` how many of these are; the rows are the sets of `grid`, `names` the sessions. None if no
    set has an error.
    """
    sparse = solved.sum(axis=1) < LEAST_SOLVED * solved.sum(axis=1).max(initial=0)
    judged = np.where(sparse[:, np.newaxis], np.nan, error_deg)
    sessions = np.flatnonzero(np.isfinite(judged).any(axis=0))
    unranked = tuple(name for place, name in enumerate(names) if place not in sessions)
    if not sessions.size:
        return None
    judged = judged[:, sessions]
    error = _mean(judged)
    best = int(np.nanargmin(error))
    left_out, same = np.nan, 0
    if sessions.size > 1:
        choices = [int(np.nanargmin(_mean(np.delete(judged, out, axis=1)))) for out in range(sessions.size)]
        left_out = float(_mean(np.array([judged[choice, out] for out, choice in enumerate(choices)])))
        same = choices.count(best)
    return Ranking(
        best=best,
        error_deg=error,
        worst_deg=float(np.nanmax(worst_deg[best, sessions])),
        cross_validated_deg=left_out,
        same_choice=same,
        folds=sessions.size,
        effects=tuple(_effect(parameter, grid.sets, error) for parameter in grid.varied_parameters),
        wide_share=float(wide[best].sum() / solved[best].sum()),
        unranked=unranked,
    )


def _mean(error_deg: FloatArray) -> FloatArray:
    """Mean over the sessions in which a set has an error; NaN if it has none."""
    has_error = np.isfinite(error_deg)
    total, count = np.where(has_error, error_deg, 0.0).sum(axis=-1), has_error.sum(axis=-1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan), np.float64)


def _effect(parameter: Parameter, sets: Sequence[tuple[str, ...]], error_deg: FloatArray) -> Effect:
    settings = [f"{parameter.key}={value}" for value in parameter.values]
    means = (_mean(error_deg[[setting in chosen for chosen in sets]]) for setting in settings)
    return Effect(parameter.key, parameter.values, tuple(float(mean) for mean in means))


class SweepTable:
    """Rows of a sweep, ordered by session, set and region however the runs came in.

    `cached` counts the runs that were estimated before.
    """

    def __init__(self, grid: Grid, names: Mapping[Path, str]) -> None:
        self._grid, self._names = grid, dict(names)
        self._rows: dict[tuple[int, int], list[dict[str, Any]]] = {}
        self.cached: int = 0
        self._places = {path: place for place, path in enumerate(self._names)}

    def add(self, outcome: Outcome) -> None:
        """Add the estimates of one run."""
        run, estimates = outcome.run, outcome.estimates
        self.cached += outcome.cached
        targets = [region for region in estimates.regions if region.kind is RegionKind.TARGET]
        place = self._places[run.source.path]
        self._rows[place, run.number] = [
            _region_row(region, estimates.of_region(region)) for region in targets
        ]

    def columns(self) -> dict[str, list[Any]]:
        """The tidy table; keys of parameters as in ``fieldkit.toml``, angles in degrees."""
        names = list(self._names.values())
        rows = [
            {"session": names[place], "set": number, **self._values(number), **region}
            for (place, number), regions in sorted(self._rows.items())
            for region in regions
        ]
        return {column: [row[column] for row in rows] for column in (rows[0] if rows else ())}

    def ranking(self) -> Ranking | None:
        """The sets by their errors; None if no region of known tilt was solved."""
        shape = len(self._grid.sets), len(self._names)
        error, worst = np.full((2, *shape), np.nan)
        solved, wide = np.zeros((2, *shape), np.int64)
        for (place, number), regions in self._rows.items():
            known_rows = [row for row in regions if np.isfinite(row["median_abs_error_deg"])]
            solved[number, place] = sum(row["answered"] for row in known_rows)
            wide[number, place] = sum(row["wide"] for row in known_rows)
            if known_rows:
                error[number, place] = np.mean([row["median_abs_error_deg"] for row in known_rows])
                worst[number, place] = max(row["worst_abs_error_deg"] for row in known_rows)
        return rank(error, worst, solved, wide, self._grid, tuple(self._names.values()))

    def _values(self, number: int) -> dict[str, Any]:
        """The parameters of a set: numbers where all values of the key are, else as written."""
        texts = (setting.split("=", 1)[1] for setting in self._grid.sets[number])
        return {
            parameter.key: float(value) if all(map(_is_number, parameter.values)) else value
            for parameter, value in zip(self._grid.parameters, texts, strict=True)
        }


def _region_row(region: Region, rows: TableArray) -> dict[str, Any]:
    answered = rows[np.isin(rows["state"], [int(state) for state in SOLVED])]
    tilt, error = answered["tilt_deg"], np.abs(answered["tilt_deg"] - region.tilt_deg)
    is_known = error.size > 0 and np.isfinite(region.tilt_deg)
    return {
        "region": region.name,
        "true_tilt_deg": region.tilt_deg,
        "minutes": int(rows.size),
        "answered": int(answered.size),
        "wide": int(np.count_nonzero(rows["state"] == SlopeState.WIDE)),
        "median_tilt_deg": float(np.median(tilt)) if tilt.size else float("nan"),
        "mean_error_deg": float(np.mean(tilt) - region.tilt_deg) if is_known else float("nan"),
        "mean_abs_error_deg": float(np.mean(error)) if is_known else float("nan"),
        "median_abs_error_deg": float(np.median(error)) if is_known else float("nan"),
        "worst_abs_error_deg": float(np.max(error)) if is_known else float("nan"),
    }


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
