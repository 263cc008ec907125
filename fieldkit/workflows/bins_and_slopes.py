"""What worker processes do: read a session into minute bins, and estimate slopes from the bins.

A session is read once for all parameters: most of them are used after the bins are made, so that
estimating again costs no reading. What the bins do depend on is what `batch.bin_settings` keeps.
The results are those of the `Estimator`, to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.binner import Binner, Closed
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import slope_series
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.site import Site
from fieldkit.sessions.reader import SessionReader
from fieldkit.workflows.session_estimates import Estimates
from fieldkit.workflows.sources import SessionOrFile, marks_of, reading


def read_minutes(
    session: SessionOrFile, regions: Regions, wanted: Sequence[tuple[Site, EstimatorSettings]]
) -> list[History]:
    """The minute bins of a session for each site and `batch.bin_settings`, in one pass over its samples.

    Raises `SessionError`.
    """
    with reading(session) as opened:
        streams = tuple(opened.streams.values())
        binners = [Binner(site, regions, streams, settings) for site, settings in wanted]
        return [History.of([entry for entry, _ in closed]) for closed in closed_minutes(opened, binners)]


def closed_minutes(session: SessionReader, binners: Sequence[Binner]) -> list[list[Closed]]:
    """What each binner makes of a session's samples, in one pass over them."""
    closed: list[list[Closed]] = [[] for _ in binners]
    for sample in chain(marks_of(session), session.samples()):
        for binner, minutes in zip(binners, closed, strict=True):
            minutes.extend(binner.add(sample))
    for binner, minutes in zip(binners, closed, strict=True):
        minutes.extend(binner.finish())
    return closed


def estimate(history: History, regions: Regions, settings: EstimatorSettings) -> Estimates:
    """Slopes of every target at every minute."""
    schedule = RegionSchedule.of(regions)
    series = list(slope_series(history, regions, settings))
    minutes = [one.slopes for one in series]
    learnt = {int(time): one.learnt for time, one in zip(history.time_ns, series, strict=True) if one.learnt}
    temperature_k = [
        history.temperature_k[row, schedule.column(one.region, int(history.minute[row]))]
        for row, minute in enumerate(minutes)
        for one in minute
    ]
    dni_w_m2 = np.repeat(history.dni_w_m2, [len(minute) for minute in minutes])
    measured: dict[str, ArrayLike] = {"temperature_k": temperature_k, "irradiance_w_m2": dni_w_m2}
    return Estimates.of([one for minute in minutes for one in minute], measured, schedule.latest, learnt)
