"""A bank of Kalman filters: p states of n unknown numbers with their covariances, stepped side by side.

::

    x' = F x + c + w,  w ~ N(0, Q)        m' = F m + c,  P' = F P F' + Q                         (predict)
    y  = H x + c + v,  v ~ N(0, R)        e = y - H m - c,  S = H P H' + R,  K = P H' S^-1       (update)
                                          m' = m + K e,  P' = P - K S K',  log N(e; 0, S)

S. Särkkä, Bayesian Filtering and Smoothing, Cambridge, 2013, theorem 4.2; the sum of the logarithms is the
log-likelihood of all measurements (A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman
Filter, Cambridge, 1989, section 3.4).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldkit.model.arrays import FloatArray, IntArray

JUMP_SDS = 4.5
"""Deviations from what all others say, from which a measurement is a jump.

Judged: because chance does that once in 150 000 normal numbers, more than a session has.
"""
JUMP_PROBABILITY = 0.01
"""Prior probability that a measurement is a jump: a shadow of ten seconds, a step of the shutter.

Judged: because such things come about once in a hundred minutes of a bed. A jump costs as much evidence.
"""
BLOCK = 16
"""Covariances that are stepped together.

Judged: because so many stay in a processor's cache; all at once take twice as long.
"""
LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, slots=True)
class Affine:
    """Numbers that a state determines, ``rows x + constant``: rows (p, m, n), constants (p, m)."""

    rows: FloatArray
    constant: FloatArray

    def at(self, state: FloatArray) -> FloatArray:
        """The numbers (p, m) at states (p, n)."""
        return np.asarray(np.matmul(self.rows, state[..., np.newaxis])[..., 0] + self.constant)


@dataclass(frozen=True, slots=True)
class Transition:
    """A state fades, and what flows moves its first places: ``x' = decay x + into [flows(x), x at drives]``.

    `decay` (n,); `into` (k, m) fills the first k places by flows and by the places `drives`, which drive
    others. So F is a diagonal but for its first rows.
    """

    decay: FloatArray
    into: FloatArray
    flows: Affine
    drives: slice


class Innovation(NamedTuple):
    """Measured less predicted (p, m), the same whitened to unit variance, and its log-likelihood (p,)."""

    difference: FloatArray
    standardised: FloatArray
    log_likelihood: FloatArray


class KalmanBank:
    """Filters with `mean` (p, n) and `covariance` (p, n, n)."""

    def __init__(self, mean: FloatArray, covariance: FloatArray) -> None:
        self.mean: FloatArray = mean
        self.covariance: FloatArray = covariance

    def predict(self, transition: Transition, noise: FloatArray) -> None:
        """Move the states by a transition; `noise` (p, n) is the diagonal of Q."""
        decay, into, drives = transition.decay, transition.into, transition.drives
        flows, first = transition.flows, slice(len(into))
        moving = np.concatenate([flows.at(self.mean), self.mean[:, drives]], axis=1)
        self.mean = decay * self.mean
        self.mean[:, first] += moving @ into.T
        faded, diagonal = np.outer(decay, decay), np.arange(decay.size)
        for block in self._blocks():
            covariance, rows = self.covariance[block], flows.rows[block]
            # F P F' without a product of two whole matrices: diagonal, and a part of few rows with its
            # transpose
            crossed = np.concatenate([rows @ covariance, covariance[:, drives]], axis=1)
            among = np.concatenate([crossed @ rows.transpose(0, 2, 1), crossed[:, :, drives]], axis=2)
            crossed *= decay
            # half of the square here: the transpose below brings the other half
            crossed[:, :, first] += 0.5 * among @ into.T
            inflow = into @ crossed
            covariance *= faded
            covariance[:, first] += inflow
            covariance[:, :, first] += inflow.transpose(0, 2, 1)
            covariance[:, diagonal, diagonal] += noise[block]

    def update(
        self,
        design: Affine,
        measured: FloatArray,
        variance: FloatArray,
        jumps: IntArray | None = None,
    ) -> Innovation:
        """Correct the states by measurements (m,) with independent noise (p, m), R's diagonal.

        NaN is skipped. A measurement that contradicts all others and what came before is a jump of the state
        in its place of `jumps` (m,), where they are given.
        """
        seen, difference = np.isfinite(measured), measured - design.at(self.mean)
        rows, error, count = design.rows[:, seen], difference[:, seen], int(seen.sum())
        shared = rows @ self.covariance
        spread = shared @ rows.transpose(0, 2, 1) + variance[:, seen, np.newaxis] * np.eye(count)
        # judged by the prediction: the update would share the error out among the states
        added = np.zeros_like(error) if jumps is None else _jump_variance(spread, error)
        if jumps is not None and added.any():
            places = jumps[seen]
            self.covariance[:, places, places] += added
            shared = rows @ self.covariance
            spread = shared @ rows.transpose(0, 2, 1) + variance[:, seen, np.newaxis] * np.eye(count)
        root = np.linalg.cholesky(spread)
        # K S K' as a square of one matrix, L^-1 H P with S = L L': P stays symmetric and positive
        whitening = np.linalg.inv(root)
        half_gain = whitening @ shared
        white = np.matmul(whitening, error[..., np.newaxis])[..., 0]
        self.mean = self.mean + np.einsum("pmn,pm->pn", half_gain, white)
        # a copy: of one array with its own transpose numpy makes a triangle, and mirrors it slowly
        transposed = half_gain.transpose(0, 2, 1).copy()
        for block in self._blocks():
            self.covariance[block] -= transposed[block] @ half_gain[block]
        log_size = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1) + 0.5 * count * LOG_TWO_PI
        standardised = np.full_like(difference, np.nan)
        standardised[:, seen] = white
        chance = np.log(JUMP_PROBABILITY) * (added > 0.0).sum(axis=1)
        return Innovation(difference, standardised, chance - 0.5 * (white**2).sum(axis=1) - log_size)

    def _blocks(self) -> Iterator[slice]:
        """Parts of the bank, one after the other."""
        return (slice(first, first + BLOCK) for first in range(0, len(self.mean), BLOCK))


def _jump_variance(spread: FloatArray, error: FloatArray) -> FloatArray:
    """Squares (p, m) of what one measurement is off from what all others say, 0 where that may be chance."""
    if error.shape[1] < 2:
        return np.zeros_like(error)
    inverse = np.linalg.inv(spread)
    # what is left of each given all others is (S^-1 e)_i / (S^-1)_ii, of variance 1 / (S^-1)_ii;
    # Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press, 2006, eq. 5.12
    alone = np.matmul(inverse, error[..., np.newaxis])[..., 0]
    information = np.diagonal(inverse, axis1=1, axis2=2)
    sizes = np.abs(alone) / np.sqrt(information)
    # the worst alone: its error is in what the others are compared with
    worst = np.arange(error.shape[1]) == np.argmax(sizes, axis=1)[:, np.newaxis]
    return np.where(worst & (sizes > JUMP_SDS), (alone / information) ** 2, 0.0)
