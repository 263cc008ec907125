"""From a session to slopes: what `estimate`, `replay`, `report` and `check` share.

The configuration is the one the session keeps of itself, or the campaign's present one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from fieldkit.config import Config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate
from fieldkit.sessions.reader import Session
from fieldkit.workflows.sources import config_for, regions_for

__all__ = [
    "as_document",
    "config_for",
    "estimates_of",
    "estimator_for",
    "minutes_of",
    "regions_for",
]


def estimator_for(
    session: Session, config: Config, *, present: bool = False, streams: Sequence[StreamInfo] = ()
) -> Estimator:
    """A fresh estimator for a session's streams, or for some of them."""
    regions = regions_for(session, config, present=present)
    chosen = tuple(streams or session.streams.values())
    return Estimator(config.site, regions, chosen, config.estimator_settings())


def minutes_of(session: Session, estimator: Estimator) -> Iterator[Minute]:
    """Every minute of a session, as the estimator closes it."""
    for sample in session.samples():
        yield from estimator.add(sample)
    yield from estimator.finish()


def estimates_of(minutes: Iterable[Minute]) -> Iterator[SlopeEstimate]:
    """The estimates of all minutes, in order of time."""
    return (estimate for minute in minutes for estimate in minute.estimates)


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
