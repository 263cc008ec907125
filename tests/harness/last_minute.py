"""The last minute of some samples: the slopes of those before it need not be found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator import Estimator, Minute, measured_minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Sample
from fieldkit.model.site import Region, Site


class Field(Protocol):
    """What an estimator is made for."""

    site: Site
    beds: tuple[Region, ...]
    streams: tuple[StreamInfo, ...]


def last_of(field: Field, samples: Sequence[Sample], settings: EstimatorSettings | None = None) -> Minute:
    """The last minute with its slopes, by the paper's model unless the settings say otherwise."""
    settings = settings or EstimatorSettings(model="paper")
    estimator = Estimator(field.site, field.beds, field.streams, settings)
    closed = [one for sample in samples for one in estimator.collect(sample)] + estimator.collect_rest()
    found = SlopeChain(field.beds, settings).at(History.of([entry for entry, _ in closed]))
    measured = measured_minute(closed[-1], estimator.schedule, estimator.irradiance_model)
    return replace(measured, estimates=found.slopes, learnt=found.learnt)
