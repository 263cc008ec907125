"""Noise of regions and their own deviations from minute to minute, as the minutes themselves show them.

Once the gusts that all regions share are taken out, second differences of a temperature over one minute are
mostly noise, those over four mostly what passes one region only: gusts of its own, steps of the shutter. With
sd s and the correlation r_k over k minutes such a process has second differences of variance
``s^2 (6 - 8 r_k + 2 r_2k)``, white noise n of ``6 n^2``; two lags give both. What second differences over
twenty minutes show beyond is an own deviation that lasts: exchange that changes within the hour, a camera in
the sun.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.learned.inputs import MinuteInputs
from fieldkit.model.arrays import BoolArray, FloatArray

OWN_MINUTES = 4.0
"""Time constant of what a region does alone.

Judged: because gusts that reach one bed, people and a shutter's steps last for minutes; the lags below tell
such a process from white noise.
"""
NEAR, FAR, LONG = 1, 4, 20
"""Lags of second differences, and the longest as the time constant of what lasts. [min]

Judged: because at one minute white noise prevails, at four the own process, at twenty what lasts for longer.
"""
OF_ALL = 0.15
"""Share of what all regions do over `LONG` that slopes of their own explain.

Judged: because it was 0.05 to 0.15 in simulated beds of 5 to 25 degrees under clear and broken skies.
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
    """Standard deviations of a region's minute: white, and an own one that lasts for `own_minutes`, K."""

    white_k: float
    own_k: float
    own_minutes: float = OWN_MINUTES

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
    shapes = {lag: _shape(lag, OWN_MINUTES) for lag in (NEAR, FAR, LONG)}
    own = max(far - near, 0.0) / (shapes[FAR] - shapes[NEAR])
    white = max(near - shapes[NEAR] * own, 0.0) / 6.0
    # gusts of its own reach a region smoothed by the ground, and so show about twice over the longest
    steady = np.where(_warms_again(minutes), np.nan, kelvin)
    beyond = max(_alone(steady, LONG, OF_ALL) - 6.0 * white - 2.0 * shapes[LONG] * own, 0.0)
    share = len(kelvin) / (len(kelvin) + WORTH_MINUTES)
    own = share * own + (1.0 - share) * OWN_K**2
    white = share * white + (1.0 - share) * configured_k**2
    lasting = share * beyond / _shape(LONG, LONG)
    own_minutes = (own * OWN_MINUTES + lasting * LONG) / (own + lasting)
    own_k = max(math.sqrt(own + lasting), LEAST_K)
    return Noise(min(max(math.sqrt(white), LEAST_K), configured_k), own_k, own_minutes)


def _warms_again(minutes: Sequence[MinuteInputs]) -> BoolArray:
    """Whether each region is, or was within `LONG`, in shade (minutes, regions): its course is its own."""
    hidden = np.array([(minute.shaded > 0.0) | (minute.sunlit < 1.0) for minute in minutes])
    return np.array([hidden[max(row - LONG, 0) : row + 1].any(axis=0) for row in range(len(hidden))])


def _shape(lag: int, minutes: float) -> float:
    """Variance of second differences of a process of this time constant over its variance."""
    return 6.0 - 8.0 * math.exp(-lag / minutes) + 2.0 * math.exp(-2.0 * lag / minutes)


def _alone(kelvin: FloatArray, lag: int, of_all: float = 0.0) -> float:
    """Variance of second differences of one region that the mean of the others does not explain, K2.

    Less that of the share `of_all` of this mean.
    """
    bent = kelvin[2 * lag :] - 2.0 * kelvin[lag:-lag] + kelvin[: -2 * lag]
    bent = bent[np.isfinite(bent).all(axis=1)]  # all regions, or there is nothing to compare with
    if not len(bent):
        return 0.0
    regions = bent.shape[1]
    variances = []
    for region in range(regions):
        others = np.delete(bent, region, axis=1).mean(axis=1)
        shared = float(others @ bent[:, region] / max(float(others @ others), 1e-12))
        remainder = np.median(np.abs(bent[:, region] - shared * others))
        alone = remainder**2 - (of_all * np.median(np.abs(others))) ** 2
        # the others' mean brings its own part of the noise
        variances.append(alone / (1.0 + shared**2 / (regions - 1)))
    return float(np.mean(variances)) / _MEDIAN_OF_NORMAL**2
