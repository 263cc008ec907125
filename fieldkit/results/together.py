"""Sessions of one place estimated together: one slope of each region for all of them.

Nothing that was estimated of a session alone is replaced: the joined slopes are returned, and written to
files of their own where that is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fieldkit.estimation.chain import rows_after_gaps
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.together import Part, slopes_together
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region
from fieldkit.results import minutes
from fieldkit.results.batch import Progress, no_progress, session_names
from fieldkit.results.cache import Cache, as_text, digest, of_text
from fieldkit.results.result_files import provenance, write_results
from fieldkit.results.session_estimates import Estimates, budget_columns
from fieldkit.results.sources import SessionOrFile, Settings, log_warning, path_of, settings_from, source_of


@dataclass(frozen=True, repr=False)
class JoinedEstimates(Estimates):
    """The final slopes of sessions estimated together, a row for each target, and what they came from.

    `chosen` is how sessions and settings were chosen.

    >>> joined = fieldkit.estimate_together([june, august])                          # doctest: +SKIP
    >>> joined["b15"], joined.sessions                                               # doctest: +SKIP
    >>> joined.columns(), joined.to_frame(), joined.to_xarray()                      # doctest: +SKIP
    >>> joined.of_region(b15), joined.plot()                                         # doctest: +SKIP
    >>> joined.write(Path("results/both"))                                           # doctest: +SKIP
    """

    runs: tuple[minutes.Run, ...] = ()
    chosen: Mapping[str, Any] = field(default_factory=dict)

    @property
    def minutes(self) -> int:
        """Number of minutes of the region that was measured longest."""
        return int(self.rows["n_bins"].max(initial=0))

    @property
    def sessions(self) -> list[Path]:
        """The files of the sessions, in order of time."""
        return [run.source.path for run in self.runs]

    def write(self, base: Path) -> list[Path]:
        """Write ``BASE.csv``, ``BASE-learnt.csv``, ``BASE-budget.csv`` and their provenance ``BASE.json``.

        Raises `StorageError`.
        """
        sources = [run.source for run in self.runs]
        about = {**provenance(sources, {}), **self.chosen, "together": True}
        together = " + ".join(session_names(sources).values())
        tables = [self.columns(), self.learnt.columns(), budget_columns(self.budgets)]
        columns, learnt, budget = (
            {"session": [together] * len(next(iter(table.values()))), **table} for table in tables
        )
        return write_results(base, columns, about, {"learnt": learnt, "budget": budget})


def estimate_together(
    sessions: Iterable[SessionOrFile],
    settings: Settings = (),
    /,
    *,
    model: Model | None = None,
    present: bool = False,
    without_marks: Collection[int | str] = (),
    notify: Callable[[str], None] = log_warning,
    on_progress: Progress = no_progress,
    **values: Any,
) -> JoinedEstimates:
    """Estimate one slope of each region from several sessions of one place, by the learned model.

    Slopes, absorbed light, thermal inertia and what is unlike in a bed are those of all sessions; exchange,
    sky, air, temperatures in depth and the camera's offsets begin anew in each, and after a gap of more than
    two hours. A region that a session does not have is not measured there.

    Parameters
    ----------
    sessions
        Finished sessions or their files, in any order.
    settings, model, present, without_marks, values
        As for `fieldkit.estimate`.
    notify
        Receives a warning for each session with damaged samples, which are excluded.
    on_progress
        Called with the number of finished steps and of all: a step for each session, one for the slopes.

    Raises
    ------
    SessionError
        If a session cannot be read or is still being recorded.
    ConfigError
        With one session that has no such gap, or none; if they are not of one place (sites more than 100 m
        apart, other references), overlap in time, or differ in their settings; as for `fieldkit.estimate`.

    Examples
    --------
    >>> june = ["recordings/20260601T180000Z.h5", "recordings/20260610T180000Z.h5"]
    >>> fieldkit.estimate_together(june)["b15"]                                       # doctest: +SKIP
    <b15: tilt 15.2° (13.4 to 17.1), azimuth 181°, ok>
    """
    keys = values if model is None else {**values, "estimator.model": model}
    texts = [*settings_from(settings), *settings_from(keys)]
    paths = list(dict.fromkeys(path_of(session).resolve() for session in sessions))
    runs = [
        minutes.run_of(source_of(path, present=present, without_marks=without_marks), texts) for path in paths
    ]
    parts = []
    for run in runs:
        parts.append(_part(run, notify))
        on_progress(len(parts), len(runs) + 1)
    if len(parts) < 2 and not any(rows_after_gaps(part.history) for part in parts):
        raise ConfigError("one session without a gap of two hours cannot be joined", fix="name two or more")
    begun = {part.name: part.history.time_ns[:1].tolist() for part in parts}
    runs.sort(key=lambda run: begun[str(run.source.path)])
    estimates = _estimate_parts(runs, parts)
    on_progress(len(runs) + 1, len(runs) + 1)
    chosen = {"settings": texts, "campaign": present, "without_marks": list(map(str, without_marks))}
    return JoinedEstimates(**vars(replace(estimates, site=runs[0].site)), runs=tuple(runs), chosen=chosen)


def _estimate_parts(runs: Sequence[minutes.Run], parts: Sequence[Part]) -> Estimates:
    """The slopes by all parts, from the cache or else solved."""
    cache = Cache(checksums=[run.source.checksum for run in runs])
    key = digest("together", *(run.key for run in runs))
    if (entry := cache.load(key)) is not None:
        return minutes.unpacked_slopes(entry, of_text(tuple[Region, ...], entry["regions"]))
    together = slopes_together(parts)
    estimates = minutes.final_estimates_of(together)
    cache.store(key, {"regions": as_text(together.regions), **minutes.packed_slopes(estimates)})
    return estimates


def _part(run: minutes.Run, notify: Callable[[str], None]) -> Part:
    """The minutes of a session in which its last regions hold."""
    path, measured, schedule = run.source.path, minutes.measure_run(run), run.source.regions
    if damaged := sum(measured.damaged.values()):
        notify(f"{path}: {damaged} damaged samples are excluded; a check lists them")
    history, regions = measured.history.at_last(schedule)
    return Part(str(path), run.site, regions, history, run.settings)
