"""Carrying out many runs: what is cached comes first, the rest as workers finish it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fieldkit.config import changed_config
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import FieldkitError
from fieldkit.model.site import Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.workflows.cache import Cache, digest
from fieldkit.workflows.estimates import Estimates
from fieldkit.workflows.executors import Work
from fieldkit.workflows.sources import Source


@dataclass(frozen=True)
class Run:
    """One session with one set of parameters, the `number`-th of a sweep."""

    source: Source
    site: Site
    settings: EstimatorSettings
    number: int = 0

    @cached_property
    def bins_key(self) -> str:
        """What its minutes are made of."""
        return digest(self.source.checksum, self.site, self.source.regions, bin_settings(self.settings))

    @cached_property
    def key(self) -> str:
        """What its slopes are made of."""
        return digest(self.bins_key, self.settings)


@dataclass(frozen=True)
class Outcome:
    """What a run gave, and whether that was known before."""

    run: Run
    estimates: Estimates
    cached: bool = False


@dataclass(frozen=True)
class Failure:
    """Why a run gave nothing."""

    run: Run
    error: FieldkitError


def run_of(source: Source, settings: Sequence[str] = (), number: int = 0) -> Run:
    """A session with ``KEY=VALUE`` over its configuration; raises `ConfigMistakesError`."""
    config = changed_config(source.config, settings)
    return Run(source, config.site, config.estimator_settings(), number)


def bin_settings(settings: EstimatorSettings) -> EstimatorSettings:
    """The settings that enter the minutes themselves, everything else at its default.

    From counts to surface temperature (emissivity, reflected temperature), from light reading
    to direct sun (streams, irradiance model, refraction), and what flags a minute (low sun, settling).
    """
    return EstimatorSettings(
        surface=SurfaceParameters(emissivity=settings.surface.emissivity),
        irradiance=settings.irradiance,
        light_stream=settings.light_stream,
        measures=settings.measures,
        refraction=settings.refraction,
        reflected_temperature_k=settings.reflected_temperature_k,
        low_sun_deg=settings.low_sun_deg,
        settle_s=settings.settle_s,
    )


def carried_out(runs: Iterable[Run], executor: Executor, cache: Cache) -> Iterator[Outcome | Failure]:
    """The outcome of every run, in whatever order they come; each is in the cache before it is told.

    Sessions that cannot be read give failures, and the others go on.
    """
    missing: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        if (entry := cache.load(run.key)) is None:
            missing[run.key].append(run)
        else:
            texts = tuple(str(text) for text in entry["texts"])
            yield Outcome(run, Estimates(entry["rows"], texts, run.source.regions), cached=True)
    firsts = [same[0] for same in missing.values()]
    for outcome in _Carrying(executor, cache).outcomes(firsts) if firsts else ():
        yield from (replace(outcome, run=run) for run in missing[outcome.run.key])


@dataclass(frozen=True)
class _Note:
    """The runs a piece of work concerns, and what its result leads to: outcomes, or none and more work."""

    runs: Sequence[Run]
    follow: Callable[[Any], list[Outcome]]


class _Carrying:
    """Runs handed to an executor: first the minutes of each session, then slopes from the minutes."""

    def __init__(self, executor: Executor, cache: Cache) -> None:
        # the estimator takes a second to import, more than all else where everything is known
        from fieldkit.workflows import work

        self._read_minutes, self._slopes = work.read_minutes, work.estimate
        self._work: Work[_Note] = Work(executor)
        self._cache = cache

    def outcomes(self, runs: Sequence[Run]) -> Iterator[Outcome | Failure]:
        """The outcomes of runs, as they come."""
        for of_source in _grouped(runs, lambda run: str(run.source.path)):
            self._begin(of_source)
        for note, made in self._work.results():
            if isinstance(made, FieldkitError):
                yield from (Failure(run, made) for run in note.runs)
            else:
                yield from note.follow(made)

    def _begin(self, runs: Sequence[Run]) -> None:
        """Estimate what has its minutes in the cache; read the session once for all others."""
        unread: list[list[Run]] = []
        for group in _grouped(runs, lambda run: run.bins_key):
            if (entry := self._cache.load(group[0].bins_key)) is None:
                unread.append(group)
            else:
                self._estimate(History(**entry), group)
        if unread:
            source = runs[0].source
            wanted = [(group[0].site, bin_settings(group[0].settings)) for group in unread]
            note = _Note([run for group in unread for run in group], partial(self._minutes_read, unread))
            self._work.hand_out(note, partial(self._read_minutes, source.path, source.regions, wanted))

    def _minutes_read(self, groups: Sequence[list[Run]], made: Sequence[History]) -> list[Outcome]:
        for group, history in zip(groups, made, strict=True):
            arrays = {column.name: getattr(history, column.name) for column in fields(history)}
            self._cache.store(group[0].bins_key, arrays)
            self._estimate(history, group)
        return []

    def _estimate(self, history: History, group: Sequence[Run]) -> None:
        for run in group:
            note = _Note([run], partial(self._estimated, run))
            self._work.hand_out(note, partial(self._slopes, history, run.source.regions, run.settings))

    def _estimated(self, run: Run, made: Estimates) -> list[Outcome]:
        self._cache.store(run.key, {"rows": made.rows, "texts": np.array(made.texts, np.str_)})
        return [Outcome(run, made)]


def _grouped(runs: Iterable[Run], key: Callable[[Run], str]) -> list[list[Run]]:
    groups: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        groups[key(run)].append(run)
    return list(groups.values())
