"""Leave one session out: the prior of each from what all others taught of sand and light meter.

Each session is learnt from once for each set of parameters, with its known slopes as references. The one that
is estimated keeps them as targets, so that its errors are those of unknown slopes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from fieldkit.estimation.carried import carried, keys
from fieldkit.estimation.scale import known_slopes, with_known
from fieldkit.model.errors import ConfigError
from fieldkit.results.batch import Estimate
from fieldkit.results.minutes import Run


def prior_of_others(runs: Sequence[Run], estimate: Estimate) -> Iterator[tuple[Run, list[str]]]:
    """Each run with the ``KEY=VALUE`` that the other sessions of its set taught.

    Raises `ConfigError` with a single session, and with another model than the learned.
    """
    if len({run.source.path for run in runs}) < 2:
        raise ConfigError("prior=others needs two sessions or more", fix="name the other sessions too")
    if any(run.settings.model != "learned" for run in runs):
        raise ConfigError("prior=others needs the learned model", fix="add --set estimator.model=learned")
    outcomes = list(estimate([_learning(run) for run in runs]))
    for run in runs:
        others = [
            (one.run.settings, learnt)
            for one in outcomes
            if one.run.number == run.number and one.run.source.path != run.source.path
            if (learnt := one.estimates.learnt.final) is not None
        ]
        known = keys(carried(run.settings, others), run.settings)
        yield run, [f"{key}={value!r}" for key, value in known.items()]


def _learning(run: Run) -> Run:
    """The run with its known slopes as references."""
    known = known_slopes(run.source.regions.latest, (), run.source.path)
    return replace(run, source=replace(run.source, regions=with_known(run.source.regions, known)))
