"""Many sessions, many sets of parameters: each combination is a run, estimated once and cached.

Cached runs come first, the others as workers finish them. A session is read once for all its runs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.config import changed_config
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import ConfigError, FieldkitError, IntegrityError
from fieldkit.model.samples import Quality
from fieldkit.model.site import RegionKind, Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.workflows.cache import Cache, digest
from fieldkit.workflows.executors import THIS_PROCESS, Work, Workers, local
from fieldkit.workflows.learnt_series import LearntSeries
from fieldkit.workflows.provenance import provenance
from fieldkit.workflows.result_files import write_results
from fieldkit.workflows.session_estimates import Estimates
from fieldkit.workflows.sources import Source, source_of

if TYPE_CHECKING:
    import pandas as pd


Failures = dict[Path, FieldkitError]
"""Why sessions could not be estimated, or what is damaged in them."""
Progress = Callable[[int, int], None]
"""Called with the number of finished pieces and of all."""


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class Run:
    """One session with one set of parameters, the `number`-th of a sweep."""

    source: Source
    site: Site
    settings: EstimatorSettings
    number: int = 0

    @cached_property
    def bins_key(self) -> str:
        """Digest of everything that its minute bins depend on."""
        return digest(self.source.checksum, self.site, self.source.regions, bin_settings(self.settings))

    @cached_property
    def key(self) -> str:
        """Digest of everything that its slopes depend on."""
        return digest(self.bins_key, self.settings)


@dataclass(frozen=True)
class Outcome:
    """The estimates of a run, and whether they came from the cache."""

    run: Run
    estimates: Estimates
    cached: bool = False


Estimate = Callable[[Sequence[Run]], Iterable[Outcome]]
"""Carries out runs."""


@dataclass(frozen=True)
class Failure:
    """Why a run has no estimates."""

    run: Run
    error: FieldkitError


def run_of(source: Source, settings: Sequence[str] = (), number: int = 0) -> Run:
    """A session with ``KEY=VALUE`` over its configuration; raises `ConfigMistakesError`."""
    config = changed_config(source.config, settings)
    return Run(source, config.site, config.estimator_settings(), number)


def bin_settings(settings: EstimatorSettings) -> EstimatorSettings:
    """The settings that the minute bins depend on, everything else at its default.

    From counts to surface temperature (emissivity, reflected temperature), from light readings
    to DNI (streams, irradiance model, refraction), probes, what flags a minute (low sun, settling,
    horizons), and the camera's pose.
    """
    return EstimatorSettings(
        surface=SurfaceParameters(emissivity=settings.surface.emissivity),
        irradiance=settings.irradiance,
        light_stream=settings.light_stream,
        measures=settings.measures,
        probes=settings.probes,
        horizon=settings.horizon,
        horizons=settings.horizons,
        refraction=settings.refraction,
        reflected_temperature_k=settings.reflected_temperature_k,
        low_sun_deg=settings.low_sun_deg,
        settle_s=settings.settle_s,
        camera_path=settings.camera_path,
    )


def readable_sources(paths: Iterable[Path], *, present: bool = False) -> tuple[list[Source], Failures]:
    """Every session that can be estimated, and why the others cannot; a session named twice counts once."""
    sources: list[Source] = []
    failures: Failures = {}
    for path in dict.fromkeys(path.resolve() for path in paths):
        try:
            source = source_of(path, present=present)
            _require_target(source)
            sources.append(source)
        except FieldkitError as error:
            failures[path] = error
    return sources, failures


def _require_target(source: Source) -> None:
    if not any(region.kind is RegionKind.TARGET for region in source.regions.columns):
        raise ConfigError(
            f"{source.path} has no target region to estimate",
            fix="fieldkit roi add in its campaign, then once more with --campaign",
        )


def estimated(
    runs: Sequence[Run],
    failures: Failures,
    workers: Workers = THIS_PROCESS,
    on_progress: Progress = no_progress,
) -> Iterator[Outcome]:
    """The outcomes of runs as they come, cached ones first.

    Sessions that cannot be read, or that are damaged in part, are added to `failures`.
    """
    with workers.executor(len(runs)) as executor:
        for done, outcome in enumerate(carried_out(runs, executor, Cache()), start=1):
            on_progress(done, len(runs))
            if isinstance(outcome, Failure):
                failures[outcome.run.source.path] = outcome.error
                continue
            if (damage := _damage(outcome)) is not None:
                failures[outcome.run.source.path] = damage
            yield outcome


def _damage(outcome: Outcome) -> IntegrityError | None:
    """The error for a session in which samples do not match their checksums; estimates exclude them."""
    rows = outcome.estimates.rows
    minutes = np.unique(rows["time_ns"][(rows["flags"] & int(Quality.BAD_CRC)) != 0]).size
    if not minutes:
        return None
    path = outcome.run.source.path
    return IntegrityError(
        f"{path} has damaged samples in {minutes} minutes; they are excluded", fix=f"fieldkit check {path}"
    )


def estimate_run(run: Run, cache: Cache) -> Estimates:
    """The estimates of a single run, in this process; raises `SessionError`."""
    with local(1) as executor:
        (outcome,) = carried_out([run], executor, cache)
    if isinstance(outcome, Failure):
        raise outcome.error
    return outcome.estimates


def session_names(sources: Sequence[Source]) -> dict[Path, str]:
    """How the tables name each session: by its file's stem, or its path where two have the same stem."""
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

    @property
    def paths(self) -> dict[str, Path]:
        """The file of each session by its name."""
        return {name: path for path, name in session_names(self.sources).items()}

    def columns(self) -> dict[str, list[Any]]:
        """The tables of all sessions below each other, the session's name in front."""
        return _below({name: estimates.columns() for name, estimates in self.estimates.items()})

    def learnt_columns(self) -> dict[str, list[Any]]:
        """The same of what the data taught; empty with other models than the learned."""
        found = {name: estimates.learnt for name, estimates in self.estimates.items()}
        return _below({name: learnt.columns() for name, learnt in found.items() if len(learnt)})

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas frame; needs ``fieldkit[lab]``."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def write(self, base: Path) -> list[Path]:
        """Write ``BASE.csv``, ``BASE.parquet`` and their provenance ``BASE.json``; raises `StorageError`.

        What the data taught, if anything, is in ``BASE-learnt.csv``.
        """
        about = {
            **provenance(self.sources, self.failures),
            "settings": list(self.settings),
            "campaign": self.present,
        }
        learnt = self.learnt_columns()
        return write_results(base, self.columns(), about, {"learnt": learnt} if learnt else {})


def _below(tables: Mapping[str, Mapping[str, list[Any]]]) -> dict[str, list[Any]]:
    """Tables with the same columns below each other, the name of each in its rows' first column."""
    joined: dict[str, list[Any]] = {}
    for name, table in tables.items():
        rows = len(next(iter(table.values())))
        for column, values in {"session": [name] * rows, **table}.items():
            joined.setdefault(column, []).extend(values)
    return joined


def estimate_sessions(
    paths: Iterable[Path],
    settings: Sequence[str] = (),
    *,
    present: bool = False,
    workers: Workers = THIS_PROCESS,
    on_progress: Progress = no_progress,
) -> EstimatedSessions:
    """Estimate the slopes of sessions, with ``KEY=VALUE`` `settings` over their configurations.

    `present` takes the campaign's ``fieldkit.toml`` and regions as they are now. A session that cannot be
    estimated is in `failures`, and the others go on. Raises `ConfigError` for settings that are wrong.
    """
    sources, failures = readable_sources(paths, present=present)
    runs = [run_of(source, settings) for source in sources]
    found = {run.run.source.path: run.estimates for run in estimated(runs, failures, workers, on_progress)}
    done = tuple(source for source in sources if source.path in found)
    names = session_names(done)
    by_name = {names[source.path]: found[source.path] for source in done}
    return EstimatedSessions(done, by_name, failures, tuple(settings), present)


def carried_out(runs: Iterable[Run], executor: Executor, cache: Cache) -> Iterator[Outcome | Failure]:
    """The outcome of every run, in the order they finish; each is cached before it is yielded.

    Sessions that cannot be read give failures, and the others go on.
    """
    missing: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        if (entry := cache.load(run.key)) is None:
            missing[run.key].append(run)
        else:
            texts = tuple(str(text) for text in entry["texts"])
            learnt = LearntSeries.unpacked(entry)
            yield Outcome(
                run, Estimates(entry["rows"], texts, run.source.regions.latest, learnt), cached=True
            )
    firsts = [same[0] for same in missing.values()]
    for outcome in _RunScheduler(executor, cache).outcomes(firsts) if firsts else ():
        yield from (replace(outcome, run=run) for run in missing[outcome.run.key])


@dataclass(frozen=True)
class _Note:
    """The runs that a piece of work is for, and what to do with its result: yield outcomes or submit more."""

    runs: Sequence[Run]
    follow: Callable[[Any], list[Outcome]]


class _RunScheduler:
    """Runs on an executor: first the minute bins of each session, then slopes from the bins."""

    def __init__(self, executor: Executor, cache: Cache) -> None:
        # the estimator takes a second to import, more than all else where everything is known
        from fieldkit.workflows import bins_and_slopes

        self._read_minutes, self._slopes = bins_and_slopes.read_minutes, bins_and_slopes.estimate
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
        """Estimate the runs whose minute bins are cached; read the session once for all others."""
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
            self._work.submit(note, partial(self._read_minutes, source.path, source.regions, wanted))

    def _minutes_read(self, groups: Sequence[list[Run]], made: Sequence[History]) -> list[Outcome]:
        for group, history in zip(groups, made, strict=True):
            self._cache.store(group[0].bins_key, history.arrays())
            self._estimate(history, group)
        return []

    def _estimate(self, history: History, group: Sequence[Run]) -> None:
        for run in group:
            note = _Note([run], partial(self._estimated, run))
            self._work.submit(note, partial(self._slopes, history, run.source.regions, run.settings))

    def _estimated(self, run: Run, made: Estimates) -> list[Outcome]:
        texts = np.array(made.texts, np.str_)
        self._cache.store(run.key, {"rows": made.rows, "texts": texts, **made.learnt.packed()})
        return [Outcome(run, made)]


def _grouped(runs: Iterable[Run], key: Callable[[Run], str]) -> list[list[Run]]:
    groups: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        groups[key(run)].append(run)
    return list(groups.values())
