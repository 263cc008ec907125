"""Many sessions, many sets of parameters: which can be estimated, what failed, one table of all."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fieldkit.model.errors import ConfigError, FieldkitError, IntegrityError
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.results.executors import results
from fieldkit.results.minutes import Outcome, Run, estimate_runs, run_of
from fieldkit.results.result_files import provenance, write_results
from fieldkit.results.session_estimates import Estimates, budget_columns
from fieldkit.results.sources import SessionOrFile, Source, path_of, source_of

if TYPE_CHECKING:
    import pandas as pd


Result = TypeVar("Result")
Failures = dict[Path, FieldkitError]
"""Errors of sessions that could not be estimated, or are damaged."""
Progress = Callable[[int, int], None]
"""Called with the number of finished pieces and of all."""


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""


class BySession(dict[Path, Result]):
    """Results of sessions by their files, in the order asked for; `failures` has the errors of the others."""

    def __init__(self, outcomes: Mapping[Path, Any]) -> None:
        errors = {path: error for path, error in outcomes.items() if isinstance(error, FieldkitError)}
        super().__init__({path: result for path, result in outcomes.items() if path not in errors})
        self.failures: Failures = errors


def each(
    function: Callable[..., Result],
    sessions: Iterable[SessionOrFile],
    executor: Executor | None,
    *arguments: Any,
    on_progress: Progress = no_progress,
    **options: Any,
) -> BySession[Result]:
    """Results of a function of a session for several; one named twice counts once."""
    paths = list(dict.fromkeys(map(path_of, sessions)))
    outcomes = {}
    pieces = [(path, partial(function, path.resolve(), *arguments, **options)) for path in paths]
    for path, result in results(executor, pieces):
        outcomes[path] = result
        on_progress(len(outcomes), len(paths))
    return BySession({path: outcomes[path] for path in paths})


Estimate = Callable[[Sequence[Run]], Iterable[Outcome]]
"""Carries out runs."""


def readable_sources(
    paths: Iterable[Path],
    *,
    present: bool = False,
    regions: Sequence[Region] | None = None,
    without_marks: Collection[int | str] = (),
) -> tuple[list[Source], Failures]:
    """Every session that can be estimated, and why the others cannot; a session named twice counts once."""
    sources: list[Source] = []
    failures: Failures = {}
    for path in dict.fromkeys(path.resolve() for path in paths):
        try:
            source = source_of(path, present=present, regions=regions, without_marks=without_marks)
            _require_target(source)
            sources.append(source)
        except FieldkitError as error:
            failures[path] = error
    return sources, failures


def _require_target(source: Source) -> None:
    if not any(region.kind is RegionKind.TARGET for region in source.regions.columns):
        raise ConfigError(
            "no target region to estimate",
            place=source.path,
            fix=Action.ADD_REGION() + " in its campaign, then " + Argument("present", True),
        )


def outcomes_of(
    runs: Sequence[Run],
    failures: Failures,
    executor: Executor | None = None,
    on_progress: Progress = no_progress,
) -> Iterator[Outcome]:
    """The outcomes of runs as they come, cached ones first.

    Sessions that cannot be read, or that are damaged in part, are added to `failures`.
    """
    for done, (run, outcome) in enumerate(estimate_runs(runs, executor), start=1):
        on_progress(done, len(runs))
        error = outcome if isinstance(outcome, FieldkitError) else _damage(outcome)
        if error is not None:
            failures[run.source.path] = error
        if isinstance(outcome, Outcome):
            yield outcome


def _damage(outcome: Outcome) -> IntegrityError | None:
    """The error for a session in which samples do not match their checksums; estimates exclude them."""
    rows = outcome.estimates.rows
    minutes = np.unique(rows["time_ns"][(rows["flags"] & int(Quality.BAD_CRC)) != 0]).size
    if not minutes:
        return None
    path = outcome.run.source.path
    return IntegrityError(
        f"damaged samples in {minutes} minutes; they are excluded", place=path, fix=Action.CHECK(path)
    )


def session_names(sources: Sequence[Source]) -> dict[Path, str]:
    """Name of each session in tables: by its file's stem, or its path where two have the same stem."""
    stems = [source.path.stem for source in sources]
    return {
        source.path: stem if stems.count(stem) == 1 else str(source.path)
        for source, stem in zip(sources, stems, strict=True)
    }


@dataclass(frozen=True)
class EstimatedSessions:
    """Estimates of several sessions by their names in tables; `failures` by path."""

    sources: tuple[Source, ...]
    estimates: Mapping[str, Estimates]
    failures: Failures
    settings: tuple[str, ...]
    present: bool
    without_marks: tuple[str, ...] = ()

    @property
    def paths(self) -> dict[str, Path]:
        """The file of each session by its name."""
        return {name: path for path, name in session_names(self.sources).items()}

    @property
    def about(self) -> dict[str, Any]:
        """What the slopes depend on: code, sessions by content, settings, marks without effect."""
        return {
            **provenance(self.sources, self.failures),
            "settings": list(self.settings),
            "campaign": self.present,
            "without_marks": list(self.without_marks),
        }

    def columns(self) -> dict[str, list[Any]]:
        """The tables of all sessions below each other, the session's name in front."""
        return _below({name: estimates.columns() for name, estimates in self.estimates.items()})

    def learnt_columns(self) -> dict[str, list[Any]]:
        """The same of what the data taught; empty with other models than the learned."""
        learnt_parameters = {name: estimates.learnt for name, estimates in self.estimates.items()}
        return _below({name: learnt.columns() for name, learnt in learnt_parameters.items() if len(learnt)})

    def budget_columns(self) -> dict[str, list[Any]]:
        """The same of the uncertainty budgets of the final slopes; empty from the weather alone."""
        slope_budgets = {name: estimates.budgets for name, estimates in self.estimates.items()}
        return _below({name: budget_columns(budgets) for name, budgets in slope_budgets.items() if budgets})

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def write(self, base: Path) -> list[Path]:
        """Write ``BASE.csv``, ``BASE.parquet`` and their provenance ``BASE.json``; raises `StorageError`.

        What the data taught, if anything, is in ``BASE-learnt.csv``, the uncertainty budgets of the slopes
        in ``BASE-budget.csv``.
        """
        beside = {"learnt": self.learnt_columns(), "budget": self.budget_columns()}
        tables = {name: table for name, table in beside.items() if table}
        return write_results(base, self.columns(), self.about, tables)


def _below(tables: Mapping[str, Mapping[str, list[Any]]]) -> dict[str, list[Any]]:
    """Tables with the same columns below each other, the name of each in its rows' first column."""
    columns: dict[str, list[Any]] = {}
    for name, table in tables.items():
        rows = len(next(iter(table.values())))
        for column, values in {"session": [name] * rows, **table}.items():
            columns.setdefault(column, []).extend(values)
    return columns


def estimate_sessions(
    paths: Iterable[Path],
    settings: Sequence[str] = (),
    *,
    present: bool = False,
    regions: Sequence[Region] | None = None,
    without_marks: Collection[int | str] = (),
    executor: Executor | None = None,
    on_progress: Progress = no_progress,
) -> EstimatedSessions:
    """Estimate the slopes of sessions, with ``KEY=VALUE`` `settings` over their configurations.

    `present` takes the campaign's ``fieldkit.toml`` and regions as they are now; marks with a number or text
    of `without_marks` have no effect. A session that cannot be estimated is in `failures`, and the others go
    on. Raises `ConfigError` for settings that are wrong.
    """
    sources, failures = readable_sources(paths, present=present, regions=regions, without_marks=without_marks)
    runs = [run_of(source, settings) for source in sources]
    estimates = {
        run.run.source.path: run.estimates for run in outcomes_of(runs, failures, executor, on_progress)
    }
    estimated_sources = tuple(source for source in sources if source.path in estimates)
    names = session_names(estimated_sources)
    by_name = {names[source.path]: estimates[source.path] for source in estimated_sources}
    return EstimatedSessions(
        estimated_sources, by_name, failures, tuple(settings), present, tuple(map(str, without_marks))
    )
