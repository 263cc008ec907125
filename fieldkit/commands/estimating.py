"""From a session to slopes: what `estimate`, `replay`, `report` and `check` share.

The configuration is the one the session keeps of itself, or the campaign's present one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from fieldkit.campaign.sources import config_for, regions_for
from fieldkit.config import Config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.sessions.reader import Session
from fieldkit.site import Region, RegionKind
from fieldkit.slope import SlopeEstimate, SlopeState

__all__ = [
    "ANSWERED",
    "as_document",
    "config_for",
    "estimator_for",
    "last_answers",
    "last_of",
    "minutes_of",
    "regions_for",
]

ANSWERED = (SlopeState.OK, SlopeState.FLAT, SlopeState.NOT_RESOLVED, SlopeState.HELD_CLOUD)


def estimator_for(session: Session, config: Config, *, present: bool = False) -> Estimator:
    """A fresh estimator for a session's streams."""
    regions = regions_for(session, config, present=present)
    return Estimator(config.site, regions, tuple(session.streams.values()), config.estimator_settings())


def minutes_of(session: Session, estimator: Estimator) -> Iterator[Minute]:
    """Every minute of a session, as the estimator closes it."""
    for sample in session.samples():
        yield from estimator.add(sample)
    yield from estimator.finish()


def last_answers(minutes: Iterable[Minute], regions: Sequence[Region]) -> dict[str, SlopeEstimate]:
    """The last estimate of each target that says something, else its last one."""
    return last_of((estimate for minute in minutes for estimate in minute.estimates), regions)


def last_of(estimates: Iterable[SlopeEstimate], regions: Sequence[Region]) -> dict[str, SlopeEstimate]:
    """The same from the estimates themselves, in order of time."""
    answers: dict[str, SlopeEstimate] = {}
    for estimate in estimates:
        before = answers.get(estimate.region)
        if before is None or estimate.state in ANSWERED or before.state not in ANSWERED:
            answers[estimate.region] = estimate
    targets = [region.name for region in regions if region.kind is RegionKind.TARGET]
    return {name: answers[name] for name in targets if name in answers}


def as_document(estimate: SlopeEstimate, region: Region | None = None) -> dict[str, Any]:
    """An estimate for ``--json``: degrees, kelvin per degree, the state as a word.

    The regions are 90 %, with the stated doubts of scale and offset; the noise regions leave those out.
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
