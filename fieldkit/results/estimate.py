"""From a session to slopes: `estimate` for a notebook, and the steps that others share."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path
from typing import Any, overload

from fieldkit.config import Config, config_from_text
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.table import as_part, possible, slopes_of_part
from fieldkit.estimation.together import Part, slopes_together
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import SLOPE_FIELDS, WITH_SLOPE, SlopeEstimate
from fieldkit.results.batch import EstimatedSessions, estimate_sessions
from fieldkit.results.json_document import learnt_document
from fieldkit.results.minutes import estimate_run, run_of
from fieldkit.results.session_estimates import Estimates
from fieldkit.results.sources import (
    ONE,
    SessionOrFile,
    log_warning,
    path_of,
    reading,
    regions_for,
    settings_from,
    source_of,
)
from fieldkit.results.temperature_table import read_table
from fieldkit.sessions.reader import SessionReader


@overload
def estimate(
    session: SessionOrFile, settings: Mapping[str, Any] | None = None, /, **options: Any
) -> Estimates: ...
@overload
def estimate(
    session: Sequence[SessionOrFile], settings: Mapping[str, Any] | None = None, /, **options: Any
) -> EstimatedSessions: ...
def estimate(
    session: SessionOrFile | Sequence[SessionOrFile],
    settings: Mapping[str, Any] | None = None,
    /,
    *,
    model: Model | None = None,
    present: bool = False,
    regions: Sequence[Region] | None = None,
    without_marks: Collection[int | str] = (),
    executor: Executor | None = None,
    **values: Any,
) -> Estimates | EstimatedSessions:
    """Estimate the slopes of a session minute by minute, as it was configured or with other parameters.

    Parameters
    ----------
    session
        A finished session or its file, or several.
    settings, values
        Keys of ``fieldkit.toml``: by their own name where only one table has it (``albedo=0.25``), else
        in full (``{"estimator.diffuse_fraction": 0.2}``).
    model
        The surface model, ``estimator.model``.
    present
        Use the campaign's ``fieldkit.toml`` and regions as they are now.
    regions
        Regions drawn afterwards, in place of those of the session, for all of it; the session is not changed.
    without_marks
        Numbers (see `Session.marks`) or texts of marks that have no effect on the slopes.
    executor
        Any of `concurrent.futures`, whose workers estimate those of several; this process unless given.

    Returns
    -------
    Estimates
        ``result["b05"]`` is the final estimate of a region, ``result.to_frame()`` the table of all minutes.
        What was estimated before comes from the cache. Of several sessions, `EstimatedSessions`.

    Raises
    ------
    SessionError
        If the session cannot be read or is still being recorded.
    ConfigError
        For a key or value that no estimate has, a region that cannot be used in the session's frames, or a
        mark that the session does not have.

    Examples
    --------
    >>> estimates = fieldkit.estimate(session, model="full", albedo=0.25)
    >>> estimates["b15"]
    <b15: tilt 15.8° (10.6 to 31.1), azimuth 180°, wide>
    >>> estimates.to_frame()[["region", "tilt_deg", "state"]].round(1).tail(3)
                              region  tilt_deg      state
    time
    2016-01-01 19:20:30+00:00    b05       5.1       wide
    2016-01-01 19:20:30+00:00    b15      15.8       wide
    2016-01-01 19:20:30+00:00    b25      26.7       wide
    """
    keys = {**(settings or {}), **values}
    if model is not None:
        keys["estimator.model"] = model
    chosen: dict[str, Any] = {"present": present, "regions": regions, "without_marks": without_marks}
    if isinstance(session, ONE):
        with reading(session) as opened:
            return estimate_run(run_of(source_of(opened, **chosen), settings_from(keys)), opened)
    return estimate_sessions(map(path_of, session), settings_from(keys), executor=executor, **chosen)


def estimate_tables(
    paths: Sequence[str | Path],
    site: Site,
    *,
    settings: Sequence[str] = (),
    reference_slope_deg: tuple[float, float] = (0.0, 0.0),
    notify: Callable[[str], None] = log_warning,
) -> tuple[SlopeEstimate, ...]:
    """Estimate the slopes of all targets of a table of temperatures; of several, one slope for all of them.

    Tables are CSV files with the columns of `fieldkit.results.temperature_table`, measured at `site`. Of one
    all of it counts unless a window is set; several are taken as by `estimate_together`. `settings` are
    ``KEY=VALUE`` over the default configuration, `reference_slope_deg` tilt and azimuth of the reference.
    `notify` receives a warning for each column with values that cannot be and are not used. Raises
    `ConfigError` if a file is not such a table, a setting is wrong, or tables overlap.
    """
    parts = [_table_part(Path(path), site, settings, reference_slope_deg, notify) for path in paths]
    return slopes_of_part(parts[0]) if len(parts) == 1 else slopes_together(parts).estimated.slopes


def _table_part(
    path: Path,
    site: Site,
    settings: Sequence[str],
    reference_slope_deg: tuple[float, float],
    notify: Callable[[str], None],
) -> Part:
    text = f"[site]\nlatitude_deg = {site.latitude_deg}\nlongitude_deg = {site.longitude_deg}\n"
    config = config_from_text(f"{text}elevation_m = {site.elevation_m}\n", path, settings=settings)
    if config.tables.estimator.azimuth == "known":
        raise ConfigError("a table has no known azimuths", place=path, fix="omit estimator.azimuth for it")
    settings_used = config.estimator_settings()
    table = read_table(path, needs_reference=settings_used.reference == "region")
    for excess in possible(table, config.site, settings_used)[1]:
        notify(f"{path}: {excess.words(f'line {table.lines[excess.first]}')}")
    return as_part(str(path), table, config.site, settings_used, reference_slope_deg)


def estimator_for(session: SessionReader, config: Config, *, present: bool = False) -> Estimator:
    """A fresh estimator for a session's streams."""
    regions, streams = regions_for(session, config, present=present), tuple(session.streams.values())
    return Estimator(config.site, regions, streams, config.estimator_settings())


def estimates_of(minutes: Iterable[Minute]) -> Iterator[SlopeEstimate]:
    """The estimates of all minutes, in order of time."""
    return (estimate for minute in minutes for estimate in minute.estimates)


def as_document(estimate: SlopeEstimate, region: Region | None = None) -> dict[str, Any]:
    """An estimate for ``--json``: degrees, kelvin per degree, the state as a word.

    The regions include the systematic uncertainties of scale and offset; the noise regions do not.
    """
    numbers: dict[str, Any] = {}
    for field in SLOPE_FIELDS.values():
        value = getattr(estimate, field.key)
        numbers[field.pair or field.key] = [*numbers.get(field.pair, ()), value] if field.pair else value
    document: dict[str, Any] = {
        "region": estimate.region,
        "state": estimate.state.name.lower(),
        **numbers,
        "time_ns": estimate.time_ns,
        "minutes": estimate.n_bins,
        "flags": [str(flag.name).lower() for flag in estimate.flags],
        "model": estimate.model,
        "reason": estimate.reason,
    }
    if region is not None:
        document["true_tilt_deg"], document["true_azimuth_deg"] = region.tilt_deg, region.azimuth_deg
    return document


def slopes_document(estimates: Estimates) -> dict[str, Any]:
    """The final estimates for ``--json``, without the session they are of."""
    regions = {region.name: region for region in estimates.regions}
    slopes = [as_document(estimate, regions[name]) for name, estimate in estimates.final.items()]
    return {
        "minutes": estimates.minutes,
        "slopes": slopes,
        "learnt": learnt_document(estimates.learnt.final),
        "reference_checks": [asdict(check) for check in estimates.checks],
    }


def require_slope(slopes: Iterable[SlopeEstimate]) -> None:
    """Raise `NoAnswerError` with the reasons if none of the estimates has a slope or a component of it."""
    slopes = tuple(slopes)
    if not any(slope.state in WITH_SLOPE or math.isfinite(slope.along_sun_deg) for slope in slopes):
        reasons = {slope.reason or slope.state.name.lower() for slope in slopes} or {"no targets"}
        raise NoAnswerError(f"no slope could be estimated: {', '.join(sorted(reasons))}")
