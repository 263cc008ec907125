"""From a session to slopes: `estimate` for a notebook, and the steps that other workflows share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from fieldkit.config import Config, config_from_text
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.estimation.settings import Model
from fieldkit.estimation.table import slopes_of_table
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import WITH_SLOPE, SlopeEstimate
from fieldkit.sessions.reader import SessionReader
from fieldkit.workflows.batch import estimate_run, run_of
from fieldkit.workflows.cache import Cache
from fieldkit.workflows.json_document import learnt_document
from fieldkit.workflows.session_estimates import Estimates
from fieldkit.workflows.sources import SessionOrFile, marks_of, path_of, regions_for, settings_from, source_of
from fieldkit.workflows.temperature_table import read_table


def estimate(
    session: SessionOrFile,
    settings: Mapping[str, Any] | None = None,
    /,
    *,
    model: Model | None = None,
    present: bool = False,
    regions: Sequence[Region] | None = None,
    **values: Any,
) -> Estimates:
    """Estimate the slopes of a session minute by minute, as it was configured or with other parameters.

    Parameters
    ----------
    session
        A finished session or its file.
    settings, values
        Keys of ``fieldkit.toml``: by their own name where only one table has it (``albedo=0.25``), else
        in full (``{"estimator.diffuse_fraction": 0.2}``).
    model
        The surface model, ``estimator.model``.
    present
        Use the campaign's ``fieldkit.toml`` and regions as they are now.
    regions
        Regions drawn afterwards, in place of those of the session, for all of it; the session is not changed.

    Returns
    -------
    Estimates
        ``result["b05"]`` is the final estimate of a region, ``result.to_frame()`` the table of all minutes.
        What was estimated before comes from the cache.

    Raises
    ------
    SessionError
        If the session cannot be read or is still being recorded.
    ConfigError
        For a key or value that no estimate has, or a region that cannot be used in the session's frames.

    Examples
    --------
    >>> estimates = fieldkit.estimate(session, model="full", albedo=0.25)
    >>> estimates["b15"]
    <b15: tilt 15.8° (11.2 to 22.0), azimuth 181°, uncertain>
    >>> estimates.to_frame()[["region", "tilt_deg", "state"]].round(1).tail(3)
                              region  tilt_deg      state
    time
    2016-01-01 19:20:30+00:00    b05       5.1  uncertain
    2016-01-01 19:20:30+00:00    b15      15.8  uncertain
    2016-01-01 19:20:30+00:00    b25      26.7  uncertain
    """
    keys = {**(settings or {}), **values}
    if model is not None:
        keys["estimator.model"] = model
    return estimate_run(
        run_of(source_of(path_of(session), present=present, regions=regions), settings_from(keys)), Cache()
    )


def estimate_table(
    path: str | Path,
    site: Site,
    *,
    settings: Sequence[str] = (),
    reference_slope_deg: tuple[float, float] = (0.0, 0.0),
) -> tuple[SlopeEstimate, ...]:
    """Estimate the slopes of all targets of a table of temperatures, over all of it unless a window is set.

    Parameters
    ----------
    path
        A CSV file with the columns of `fieldkit.workflows.temperature_table`.
    site
        Where it was measured.
    settings
        ``KEY=VALUE`` over the default configuration.
    reference_slope_deg
        Tilt and azimuth of the reference. [degrees]

    Raises
    ------
    ConfigError
        If the file is not such a table, or a setting is wrong.
    """
    path = Path(path)
    text = f"[site]\nlatitude_deg = {site.latitude_deg}\nlongitude_deg = {site.longitude_deg}\n"
    config = config_from_text(f"{text}elevation_m = {site.elevation_m}\n", path, settings=settings)
    if config.tables.estimator.azimuth == "known":
        raise ConfigError(f"{path}: a table has no known azimuths", fix="omit estimator.azimuth")
    return slopes_of_table(
        read_table(path), config.site, config.estimator_settings(), reference_slope_deg=reference_slope_deg
    )


def estimator_for(
    session: SessionReader, config: Config, *, present: bool = False, streams: Sequence[StreamInfo] = ()
) -> Estimator:
    """A fresh estimator for a session's streams, or for some of them."""
    regions = regions_for(session, config, present=present)
    chosen = tuple(streams or session.streams.values())
    return Estimator(config.site, regions, chosen, config.estimator_settings())


def minutes_of(session: SessionReader, estimator: Estimator) -> Iterator[Minute]:
    """Every minute of a session, as the estimator closes it."""
    for sample in chain(marks_of(session), session.samples()):
        yield from estimator.add(sample)
    yield from estimator.finish()


def estimates_of(minutes: Iterable[Minute]) -> Iterator[SlopeEstimate]:
    """The estimates of all minutes, in order of time."""
    return (estimate for minute in minutes for estimate in minute.estimates)


def as_document(estimate: SlopeEstimate, region: Region | None = None) -> dict[str, Any]:
    """An estimate for ``--json``: degrees, kelvin per degree, the state as a word.

    The 90 % regions include the systematic uncertainties of scale and offset; the noise regions do not.
    """
    document: dict[str, Any] = {
        "region": estimate.region,
        "state": estimate.state.name.lower(),
        "tilt_deg": estimate.tilt_deg,
        "azimuth_deg": estimate.azimuth_deg,
        "tilt_region_deg": [estimate.tilt_low_deg, estimate.tilt_high_deg],
        "azimuth_region_deg": [estimate.azimuth_low_deg, estimate.azimuth_high_deg],
        "tilt_noise_region_deg": [estimate.noise_tilt_low_deg, estimate.noise_tilt_high_deg],
        "azimuth_noise_region_deg": [estimate.noise_azimuth_low_deg, estimate.noise_azimuth_high_deg],
        "second_tilt_deg": estimate.second_tilt_deg,
        "second_azimuth_deg": estimate.second_azimuth_deg,
        "kelvin_per_degree": estimate.kelvin_per_degree,
        "chi_square": estimate.chi_square,
        "time_ns": estimate.time_ns,
        "minutes": estimate.n_bins,
        "flags": [str(flag.name).lower() for flag in estimate.flags],
        "model": estimate.model,
        "reason": estimate.reason,
    }
    if region is not None:
        document["true_tilt_deg"], document["true_azimuth_deg"] = region.tilt_deg, region.azimuth_deg
    return document


def session_document(path: Path, estimates: Estimates) -> dict[str, Any]:
    """The final estimates of a session for ``--json``."""
    regions = {region.name: region for region in estimates.regions}
    slopes = [as_document(one, regions[name]) for name, one in estimates.final.items()]
    return {
        "session": str(path),
        "minutes": estimates.minutes,
        "slopes": slopes,
        "learnt": learnt_document(estimates.learnt.final),
    }


def require_slope(slopes: Iterable[SlopeEstimate]) -> None:
    """Raise `NoAnswerError` with the reasons if none of the estimates has a slope."""
    slopes = tuple(slopes)
    if not any(one.state in WITH_SLOPE for one in slopes):
        reasons = {one.reason or one.state.name.lower() for one in slopes} or {"no targets"}
        raise NoAnswerError(f"no slope could be estimated: {', '.join(sorted(reasons))}")
