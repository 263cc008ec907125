"""Noise of regions and their own deviations from minute to minute, as the minutes themselves show them.

Once the gusts that all regions share are taken out, second differences of a temperature over one minute are
mostly noise, those over four mostly what passes one region only: gusts of its own, steps of the shutter. With
sd s and the correlation r_k over k minutes such a process has second differences of variance
``s^2 (6 - 8 r_k + 2 r_2k)``, white noise n of ``6 n^2``; two lags give both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.learned.inputs import MinuteInputs
from fieldkit.model.arrays import FloatArray

OWN_MINUTES = 4.0
"""Time constant of what a region does alone.

Judged: because gusts that reach one bed, people and a shutter's steps last for minutes; the lags below tell
such a process from white noise.
"""
NEAR, FAR = 1, 4
"""Lags of second differences. [min]

Judged: because at one minute white noise prevails, at four the own process.
"""
OWN_K = 0.05
"""Own deviation that is taken before there are minutes to show it.

Judged: because it is the default noise of a region's mean, `noise_k`.
"""
UNLIKE_K = 0.1
"""Own deviation of minutes that doubles the variance of what is a region's own for hours.

Judged: because it is twice the usual: beds that do so much alone for minutes are not alike in what lasts.
"""
LEAST_UNLIKE = 0.25
"""Factor on what lasts in beds that behave alike for minutes and hours.

Judged: because they may still differ a little: without it two quiet beds would be taken for one.
"""
WORTH_MINUTES = 15.0
"""Number of minutes that `OWN_K` and the configured noise count for.

Judged: because second differences over four minutes of fewer minutes are a handful of numbers.
"""
LEAST_K = 0.01
"""Judged: because no camera knows a region's mean better; zero would make a filter certain."""
_MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal number."""


class Noise(NamedTuple):
    """Standard deviations of a region's minute: white, and an own one that lasts for minutes, K."""

    white_k: float
    own_k: float

    def unlike(self, unrest: FloatArray) -> FloatArray:
        """How unlike regions are in what lasts, by what each does alone for minutes and hours; 1 as usual."""
        return np.hypot(unrest, LEAST_UNLIKE) * math.hypot(1.0, self.own_k / UNLIKE_K)


def noise_of(minutes: Sequence[MinuteInputs], configured_k: float) -> Noise:
    """Noise of a region's minutes in a row; the white part is never more than `configured_k`."""
    # a board over one region is no noise of it
    alone = [minute.measured & (minute.shaded == 0.0) for minute in minutes]
    kelvin = np.where(alone, [minute.temperature_k for minute in minutes], np.nan)
    if len(kelvin) <= 2 * FAR + 1 or kelvin.shape[1] < 2:
        return Noise(configured_k, OWN_K)
    near, far = (_alone(kelvin, lag) for lag in (NEAR, FAR))
    # white noise is alike at both lags, so their difference is of the own process alone
    own = max(far - near, 0.0) / (_shape(FAR) - _shape(NEAR))
    white = max(near - _shape(NEAR) * own, 0.0) / 6.0
    share = len(kelvin) / (len(kelvin) + WORTH_MINUTES)
    own = share * own + (1.0 - share) * OWN_K**2
    white = share * white + (1.0 - share) * configured_k**2
    return Noise(min(max(white**0.5, LEAST_K), configured_k), max(own**0.5, LEAST_K))


def _shape(lag: int) -> float:
    """Variance of second differences of the own process over its variance."""
    return float(6.0 - 8.0 * np.exp(-lag / OWN_MINUTES) + 2.0 * np.exp(-2.0 * lag / OWN_MINUTES))


def _alone(kelvin: FloatArray, lag: int) -> float:
    """Variance of second differences of one region that the mean of the others does not explain, K2."""
    bent = kelvin[2 * lag :] - 2.0 * kelvin[lag:-lag] + kelvin[: -2 * lag]
    bent = bent[np.isfinite(bent).all(axis=1)]  # all regions, or there is nothing to compare with
    if not len(bent):
        return 0.0
    regions = bent.shape[1]
    variances = []
    for region in range(regions):
        others = np.delete(bent, region, axis=1).mean(axis=1)
        shared = float(others @ bent[:, region] / max(float(others @ others), 1e-12))
        remainder = bent[:, region] - shared * others
        # the others' mean brings its own part of the noise
        variances.append(np.median(np.abs(remainder)) ** 2 / (1.0 + shared**2 / (regions - 1)))
    return float(np.mean(variances)) / _MEDIAN_OF_NORMAL**2
