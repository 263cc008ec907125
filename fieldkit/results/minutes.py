"""The minutes of sessions: measured once, their slopes solved once, both found again by what they depend on.

A minute has two parts: what was measured and noticed (`Measured`), and the slopes by one set of settings
(`Estimates`). `estimate`, `sweep`, `map`, `report`, `check` and `calibrate surface` ask for them here. Both
are kept in the cache by the checksum of the session's file, the settings they depend on and the version of
the code; they are those of the `Estimator`, to the last bit. A recording that ends leaves its own there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.config import Config, changed_config
from fieldkit.disk import sha256
from fieldkit.estimation.binner import Binner, Closed
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator import Estimator, Minute, measured_minute
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.together import Together
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import FieldkitError
from fieldkit.model.learnt import Learnt
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import ReferenceCheck, SlopeEstimate
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.results.cache import Arrays, Cache, as_text, digest, of_text
from fieldkit.results.executors import results
from fieldkit.results.json_document import attributes
from fieldkit.results.session_estimates import Budgets, Estimates, LearntSeries
from fieldkit.results.sources import SessionOrFile, Source, config_for, marks_of, reading, regions_for
from fieldkit.sessions.reader import SessionReader, open_session

FINISHED = ("sealed", "recovered")
"""States in which a session changes no more, so that what is known of it stays true."""


@dataclass(frozen=True)
class Run:
    """A session with a set of parameters, the `number`-th of a sweep; only `streams`, if any are named."""

    source: Source
    site: Site
    settings: EstimatorSettings
    number: int = 0
    streams: tuple[str, ...] = ()

    @property
    def cache(self) -> Cache:
        """Where its minutes and slopes are found again."""
        return Cache(checksums=[self.source.checksum])

    @cached_property
    def bins_key(self) -> str:
        """Digest of everything that its minutes without slopes depend on."""
        made_of = self.site, self.source.regions, bin_settings(self.settings), self.streams
        return digest("minutes", self.source.checksum, *made_of, self.source.without_marks)

    @cached_property
    def key(self) -> str:
        """Digest of everything that its slopes depend on."""
        return digest("slopes", self.bins_key, self.settings)


def run_of(source: Source, settings: Sequence[str] = (), number: int = 0) -> Run:
    """A session with ``KEY=VALUE`` over its configuration; raises `ConfigMistakesError`."""
    config = changed_config(source.config, settings)
    return Run(source, config.site, config.estimator_settings(), number)


BIN_SETTINGS = (
    *("irradiance", "light_stream", "measures", "probes", "horizon", "horizons", "refraction"),
    *("reflected_temperature_k", "low_sun_deg", "settle_s", "camera_path", "limits"),
)


def bin_settings(settings: EstimatorSettings) -> EstimatorSettings:
    """The settings that the minute bins depend on, everything else at its default.

    From counts to surface temperature (emissivity, reflected temperature), from light readings
    to DNI (streams, irradiance model, refraction), probes, what flags a minute (low sun, settling,
    horizons), the camera's pose, and the limits of what a quantity can be.
    """
    surface = SurfaceParameters(emissivity=settings.surface.emissivity)
    return EstimatorSettings(surface=surface, **attributes(settings, *BIN_SETTINGS))


# --- what was measured


@dataclass(frozen=True)
class Measured:
    """The minutes of a session without slopes, their bins, and the damaged samples by stream.

    `is_recordings` where the recording itself measured them, with this version and these settings.
    """

    minutes: tuple[Minute, ...]
    history: History
    damaged: Mapping[str, int]
    irradiance_model: str
    is_recordings: bool = False

    def arrays(self) -> Arrays:
        """As arrays, every number exact."""
        about = self.minutes, self.damaged, self.irradiance_model, self.is_recordings
        return {"about": as_text(about), **self.history.arrays()}

    @classmethod
    def of(cls, arrays: Arrays) -> Measured:
        """Minutes of which `arrays` made arrays."""
        minutes, *about = of_text(tuple[tuple[Minute, ...], dict[str, int], str, bool], arrays["about"])
        history = History(**{field.name: arrays[field.name] for field in fields(History)})
        return cls(minutes, history, *about)


def measure(
    session: SessionOrFile,
    regions: Regions,
    requests: Sequence[tuple[Site, EstimatorSettings]],
    streams: Sequence[str] = (),
    without_marks: Collection[int] = (),
) -> list[Measured]:
    """The minutes of a session for each site and settings, in one pass over its samples.

    `streams` alone take part, if any are named, and no mark numbered in `without_marks`. Raises
    `SessionError`.
    """
    with reading(session) as opened:
        chosen = tuple(info for name, info in opened.streams.items() if not streams or name in streams)
        binners = [Binner(site, regions, chosen, settings) for site, settings in requests]
        closed: list[list[Closed]] = [[] for _ in binners]
        for sample in chain(marks_of(opened, without_marks), opened.samples()):
            for binner, minutes in zip(binners, closed, strict=True):
                minutes.extend(binner.add(sample))
        for binner, minutes in zip(binners, closed, strict=True):
            minutes.extend(binner.finish())
        return [_as_measured(*pair, opened.damaged) for pair in zip(binners, closed, strict=True)]


def _as_measured(binner: Binner, closed: Sequence[Closed], damaged: Mapping[str, int]) -> Measured:
    schedule, words = binner.schedule, binner.irradiance_model
    minutes = tuple(measured_minute(closed_bin, schedule, words) for closed_bin in closed)
    history = History.of([bin_ for bin_, _ in closed], len(schedule.columns))
    return Measured(minutes, history, dict(damaged), words)


def measure_run(run: Run, session: SessionReader | None = None) -> Measured:
    """The minutes of a run without slopes, from the cache or else from its session.

    Raises `SessionError`.
    """
    if (cached := _known_minutes(run)) is not None:
        return cached
    requests, source = [(run.site, bin_settings(run.settings))], run.source
    chosen = run.streams, source.without_marks
    (bins,) = measure(session or source.path, source.regions, requests, *chosen)
    return _keep_minutes(run, bins)


def _known_minutes(run: Run) -> Measured | None:
    entry = run.cache.load(run.bins_key)
    return None if entry is None else Measured.of(entry)


def _keep_minutes(run: Run, bins: Measured) -> Measured:
    run.cache.store(run.bins_key, bins.arrays())
    return bins


# --- slopes


def solve(history: History, regions: Regions, settings: EstimatorSettings) -> Estimates:
    """Slopes of every target at every minute."""
    chain = SlopeChain(regions, settings)
    series = list(chain.series(history))
    times_ns = history.time_ns.tolist()
    learnt = {time: minute.learnt for time, minute in zip(times_ns, series, strict=True) if minute.learnt}
    slopes = [minute.slopes for minute in series]
    return _as_estimates(
        history, chain.schedule, slopes, learnt, chain.budgets(history), chain.reference_checks()
    )


def final_estimates_of(together: Together) -> Estimates:
    """The slopes at the last minute of sessions estimated together."""
    last, estimated = together.history.since(len(together.history) - 1), together.estimated
    learnt = {int(last.time_ns[0]): estimated.learnt} if estimated.learnt else {}
    schedule, slopes = RegionSchedule.of(together.regions), [estimated.slopes]
    return _as_estimates(last, schedule, slopes, learnt, together.budgets, together.checks)


def _as_estimates(
    history: History,
    schedule: RegionSchedule,
    minutes: Sequence[tuple[SlopeEstimate, ...]],
    learnt: Mapping[int, Learnt],
    budgets: Budgets,
    checks: tuple[ReferenceCheck, ...],
) -> Estimates:
    temperature_k = [
        history.temperature_k[row, schedule.column(slope.region, int(history.minute[row]))]
        for row, minute in enumerate(minutes)
        for slope in minute
    ]
    dni_w_m2 = np.repeat(history.dni_w_m2, [len(minute) for minute in minutes])
    inputs: dict[str, ArrayLike] = {"temperature_k": temperature_k, "irradiance_w_m2": dni_w_m2}
    estimates = [slope for minute in minutes for slope in minute]
    return Estimates.of(estimates, inputs, schedule.latest, learnt, budgets, checks)


def _known_slopes(run: Run) -> Estimates | None:
    entry = run.cache.load(run.key)
    return None if entry is None else unpacked_slopes(entry, run.source.regions.latest)


def _keep_slopes(run: Run, estimates: Estimates) -> Estimates:
    run.cache.store(run.key, packed_slopes(estimates))
    return estimates


def packed_slopes(estimates: Estimates) -> Arrays:
    """Slopes as arrays for the cache, without the regions."""
    about = estimates.texts, estimates.learnt.by_time_ns, estimates.budgets, estimates.checks
    return {"rows": estimates.rows, "about": as_text(about)}


def unpacked_slopes(arrays: Arrays, regions: tuple[Region, ...]) -> Estimates:
    """Slopes of which `packed_slopes` made arrays."""
    kinds = tuple[tuple[str, ...], dict[int, Learnt], Budgets, tuple[ReferenceCheck, ...]]
    texts, learnt, budgets, checks = of_text(kinds, arrays["about"])
    return Estimates(arrays["rows"], texts, regions, LearntSeries(learnt), budgets, checks)


def keep_recorded(path: Path, estimator: Estimator) -> None:
    """Keep what a recording measured and estimated itself for the first who asks for its minutes.

    Nothing is kept where the sealed session has other minutes, settings or marks. Raises `SessionError`,
    `OSError`.
    """
    with open_session(path) as session:
        session_minutes = SessionMinutes(session, config_for(session))
        if session.has_corrected_marks:  # it estimated some minutes before it knew the corrections
            return
        stored = len(session.table("irradiance")["time"])
        if session_minutes.settings == estimator.settings and stored == len(estimator.history):
            session_minutes.keep(estimator)


def estimate_run(run: Run, session: SessionReader | None = None) -> Estimates:
    """The slopes of one run, in this process, of its file or the open session; raises `SessionError`."""
    if (cached := _known_slopes(run)) is not None:
        return cached
    return _keep_slopes(run, solve(measure_run(run, session).history, run.source.regions, run.settings))


class SessionMinutes:
    """The minutes of an open session by one configuration, with slopes by any model.

    `streams` are those that take part, all of the session unless given.
    """

    def __init__(
        self,
        session: SessionReader,
        config: Config,
        *,
        present: bool = False,
        streams: Sequence[StreamInfo] = (),
    ) -> None:
        self.schedule: RegionSchedule = regions_for(session, config, present=present)
        self._session = session
        is_finished = session.state in FINISHED and session.path.exists()
        checksum = sha256(session.path) if is_finished else ""
        source = Source(session.path, checksum, session.session_id, config, self.schedule)
        is_part = 0 < len(streams) < len(session.streams)
        names = tuple(stream.name for stream in streams) if is_part else ()
        self.run: Run = Run(source, config.site, config.estimator_settings(), streams=names)

    @property
    def site(self) -> Site:
        """Site that the estimates assume."""
        return self.run.site

    @property
    def settings(self) -> EstimatorSettings:
        """Settings of the estimator."""
        return self.run.settings

    @cached_property
    def measured(self) -> Measured:
        """The minutes without slopes."""
        return measure_run(self.run, self._session)

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions that hold in the last minute."""
        return self.measured.history.at_last(self.schedule)[1]

    @property
    def history(self) -> History:
        """The bins of `regions`."""
        return self.measured.history.at_last(self.schedule)[0]

    def estimates(self, model: Model | None = None) -> Estimates:
        """The slopes by a model, that of the settings unless given."""
        run = replace(self.run, settings=replace(self.settings, model=model or self.settings.model))
        if (cached := _known_slopes(run)) is not None:
            return cached
        return _keep_slopes(run, solve(self.measured.history, self.schedule, run.settings))

    def keep(self, estimator: Estimator) -> None:
        """Keep the minutes and slopes of the estimator that recorded the session."""
        minutes, history = estimator.minutes, estimator.history
        bins = tuple(replace(minute, estimates=(), learnt=None) for minute in minutes)
        words = estimator.irradiance_model
        _keep_minutes(self.run, Measured(bins, history, {}, words, is_recordings=True))
        learnt = {minute.time_ns: minute.learnt for minute in minutes if minute.learnt is not None}
        slopes = [minute.estimates for minute in minutes]
        about = estimator.budgets(), estimator.reference_checks()
        estimates = _as_estimates(history, estimator.schedule, slopes, learnt, *about)
        _keep_slopes(self.run, estimates)

    def minutes(self, model: Model | None = None) -> list[Minute]:
        """All minutes with slopes by a model, that of the settings unless given."""
        estimates = self.estimates(model)
        slopes, learnt = iter(estimates), estimates.learnt.by_time_ns
        minutes = zip(self.measured.minutes, self.measured.history.minute.tolist(), strict=True)

        def targets(minute: int) -> int:
            return sum(region.kind is RegionKind.TARGET for region in self.schedule.regions_at(minute))

        return [
            replace(bin_, estimates=tuple(islice(slopes, targets(minute))), learnt=learnt.get(bin_.time_ns))
            for bin_, minute in minutes
        ]


# --- many runs


@dataclass(frozen=True)
class Outcome:
    """The slopes of a run, and whether they came from the cache."""

    run: Run
    estimates: Estimates
    cached: bool = False


def estimate_runs(
    runs: Iterable[Run], executor: Executor | None
) -> Iterator[tuple[Run, Outcome | FieldkitError]]:
    """The outcome of every run: cached ones, then the others as they are solved; each is kept at once.

    A session is read once for all its runs. One that cannot be read gives errors, and the others go on.
    """
    missing: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        if (cached := _known_slopes(run)) is not None:
            yield run, Outcome(run, cached, cached=True)
        else:
            missing[run.key].append(run)
    histories = _measure_all([same[0] for same in missing.values()], executor)
    pieces = []
    for same in missing.values():
        history = histories[same[0].bins_key]
        if isinstance(history, FieldkitError):
            yield from ((run, history) for run in same)
        else:
            pieces.append((same, partial(solve, history, same[0].source.regions, same[0].settings)))
    for same, estimates in results(executor, pieces):
        is_solved = not isinstance(estimates, FieldkitError)
        if is_solved:
            _keep_slopes(same[0], estimates)
        yield from ((run, Outcome(run, estimates) if is_solved else estimates) for run in same)


def _measure_all(runs: Iterable[Run], executor: Executor | None) -> dict[str, History | FieldkitError]:
    """The bins of runs, or why there are none, by `Run.bins_key`; each session is read once."""
    histories: dict[str, History | FieldkitError] = {}
    unread: dict[Path, dict[str, Run]] = defaultdict(dict)
    for run in {run.bins_key: run for run in runs}.values():
        if (cached := _known_minutes(run)) is not None:
            histories[run.bins_key] = cached.history
        else:
            unread[run.source.path][run.bins_key] = run
    pieces = [([*by_key.values()], partial(_measure_runs, [*by_key.values()])) for by_key in unread.values()]
    for same, minutes in results(executor, pieces):
        for place, run in enumerate(same):
            is_read = not isinstance(minutes, FieldkitError)
            histories[run.bins_key] = _keep_minutes(run, minutes[place]).history if is_read else minutes
    return histories


def _measure_runs(runs: Sequence[Run]) -> list[Measured]:
    """The minutes of runs of one session, in a worker."""
    bin_requests = [(run.site, bin_settings(run.settings)) for run in runs]
    source = runs[0].source
    return measure(source.path, source.regions, bin_requests, runs[0].streams, source.without_marks)
