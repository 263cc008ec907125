"""The last minute of some samples: the slopes of those before it need not be found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Protocol

from fieldkit.estimation.binner import Closed
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator import Estimator, Minute, measured_minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, Sample
from fieldkit.model.site import Region, Site


class Field(Protocol):
    """What an estimator is made for."""

    site: Site
    beds: tuple[Region, ...]
    streams: tuple[StreamInfo, ...]


def collected(
    field: Field, items: Iterable[Sample | Event], settings: EstimatorSettings | None = None
) -> tuple[Estimator, list[Closed]]:
    """An estimator that was given samples and marks, and the bins that closed; no slopes."""
    estimator = Estimator(field.site, field.beds, field.streams, settings or EstimatorSettings(model="paper"))
    closed = [entry for item in items for entry in estimator.collect(item)]
    return estimator, closed + estimator.collect_rest()


def history_of(
    field: Field, items: Iterable[Sample | Event], settings: EstimatorSettings | None = None
) -> History:
    """The bins of some samples side by side."""
    return History.of([entry for entry, _ in collected(field, items, settings)[1]])


def measured(field: Field, items: Iterable[Sample | Event]) -> list[Minute]:
    """All minutes without their slopes."""
    estimator, closed = collected(field, items)
    return [measured_minute(entry, estimator.schedule, estimator.irradiance_model) for entry in closed]


def last_of(field: Field, samples: Sequence[Sample], settings: EstimatorSettings | None = None) -> Minute:
    """The last minute with its slopes, by the paper's model unless the settings say otherwise."""
    settings = settings or EstimatorSettings(model="paper")
    estimator, closed = collected(field, samples, settings)
    estimated = SlopeChain(field.beds, settings).at(History.of([entry for entry, _ in closed]))
    minute = measured_minute(closed[-1], estimator.schedule, estimator.irradiance_model)
    return replace(minute, estimates=estimated.slopes, learnt=estimated.learnt)
