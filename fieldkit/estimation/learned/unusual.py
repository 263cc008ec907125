"""What hardly any bed does, and one may do a lot of: priors that are usually narrow and sometimes wide.

The filters take a wide prior. Whether a bed needs it is decided afterwards, under each hypothesis: with the
usual, narrow prior a state of the filter's mean m and variance s² is as if it had been measured once more, as
0 with the variance r, ``1 / r = 1 / narrow² - 1 / wide²``, and the narrow prior is ``wide / narrow
sqrt(r / (s² + r)) exp(-m² / (2 (s² + r)))`` times as probable by the minutes as the wide one. The
mixture of both goes on as a normal distribution of its mean and covariance (M. West and J. Harrison, Bayesian
Forecasting and Dynamic Models, 2nd ed., Springer, 1997, section 12.3).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy

import numpy as np

from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.learned.prior_state import DRYING_MINUTES, DRYING_W_M2

USUAL = 0.9
"""Prior probability that a bed does not dry.

Judged: because one bed in ten is damper than the others; the minutes of one that dries speak for it by e^2 to
e^7.
"""
USUAL_DRYING_W_M2 = 5.0
"""Flux that only fades into a bed which does not dry.

Judged: because it is a tenth of that of damp sand, and of what slopes of a degree absorb more or less.
"""


def with_usual_beds(filters: Filters, hours: float) -> Filters:
    """Filters in which a bed does what is unusual only if the minutes ask for it, `hours` after the first."""
    states = list(_unusual(filters, hours))
    places = [place for place, *_ in states]
    mean, columns = filters.mean.copy(), filters.covariance[:, :, places]
    changes, log_likelihood = np.empty((len(mean), len(places))), filters.log_likelihood
    for number, (place, narrow, wide) in enumerate(states):
        column, later = columns[:, :, number], slice(number + 1, None)
        read = 1.0 / (narrow**-2.0 - wide**-2.0)
        off, variance = mean[:, place], column[:, place] + read
        odds = math.log(USUAL * wide / narrow) + 0.5 * (np.log(read / variance) - off**2 / variance)
        evidence = np.logaddexp(odds, math.log(1.0 - USUAL))
        share = np.exp(odds - evidence)
        # moved by a part of the way; narrower by it, and wider where it is undecided
        change = share * ((1.0 - share) * (off / variance) ** 2 - 1.0 / variance)
        mean -= (share * off / variance)[:, np.newaxis] * column
        moved = change[:, np.newaxis, np.newaxis] * column[:, np.newaxis, places[later]]
        columns[:, :, later] += moved * column[..., np.newaxis]
        changes[:, number] = change
        log_likelihood = log_likelihood + evidence
    usual = copy(filters)
    usual.mean, usual.log_likelihood = mean, log_likelihood
    # in place: memory for a second bank costs more time than the sum
    usual.covariance = np.matmul(changes[:, np.newaxis] * columns, columns.transpose(0, 2, 1))
    usual.covariance += filters.covariance
    return usual


def _unusual(filters: Filters, hours: float) -> Iterator[tuple[int, float, float]]:
    """Places of what each bed may do, with the usual and the unusual standard deviation."""
    faded = math.exp(-60.0 * hours / DRYING_MINUTES)
    for target in range(filters.layout.targets):
        yield filters.layout.drying(target), USUAL_DRYING_W_M2 * faded, DRYING_W_M2 * faded
