"""From a filter's normals times the gain to unit normals: all beds and the gain together.

A filter knows the vectors ``gain * normal`` as a joint normal distribution in which lengths are free. Lengths
must all equal the gain, up to what each bed absorbs more or less than the reference: a bed whose vector the
sun's path pins down gives the gain, so nearly every other bed's too. The most probable unit normals are found
by damped Newton steps for all hypotheses at once; around them
the distribution is taken to be normal in the plane that touches the sphere (Laplace).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.normal import tangent_pair
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray

LONGEST = 0.25
"""Longest step of the gain or of a turn in radians.

Judged: because beyond 14 degrees the plane that touches the sphere is none of its neighbourhood.
"""
LEAST_GAIN = 0.3
"""Judged: because no light meter and surface are off by more; at zero all normals would be one."""
CONVERGED = 1e-6
"""Step of the gain or of a turn in radians below which another one would change nothing."""
NO_WORSE = 1e-8
"""Growth of the misfit that is rounding: it must not decide whether a last small step is taken, else results
would differ between processors."""


class Guess(NamedTuple):
    """Gain (p,), unit normals of the targets (p, k) and their own gains (p, targets), under p hypotheses."""

    gain: FloatArray
    units: tuple[FloatArray, ...]
    own: FloatArray

    def under(self, hypotheses: IntArray) -> Guess:
        """The guess at places (h,) of hypotheses, which may repeat."""
        units = tuple(unit[hypotheses] for unit in self.units)
        return Guess(self.gain[hypotheses], units, self.own[hypotheses])


@dataclass(frozen=True, slots=True)
class UnitNormals:
    """Unit normals for each of p hypotheses, with the gain.

    `mode` is the most probable guess, its units in the axes of the layout; `tangents` are the directions in
    which units may turn (p, k, k - 1). `covariance` (p, q, q), rad2, is of gain, turns in the order of the
    targets, and the targets' own gains; `log_evidence` (p,) the logarithm of the probability of unit normals
    given what the filter knows. In units of information `pull` (p, m) is gain and normals less the filter's
    means, `jacobian` (p, m, q) that of gain and normals by gain, turns and own gains, and `free` (p, m, m)
    the information of the filters on gain and normals.
    """

    mode: Guess
    tangents: tuple[FloatArray, ...]
    covariance: FloatArray
    log_evidence: FloatArray
    pull: FloatArray
    jacobian: FloatArray
    free: FloatArray

    def turn(self, target: int) -> slice:
        """Places of a target's turns in `covariance`."""
        first = 1 + sum(tangent.shape[2] for tangent in self.tangents[:target])
        return slice(first, first + self.tangents[target].shape[2])


class FreeNormals(NamedTuple):
    """Gain, normals times the gain and the targets' own gains as filters know them, of any length.

    `mean` (p, m) and `information` (p, m, m).
    """

    mean: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, filters: Filters) -> FreeNormals:
        """Under all hypotheses of the filters."""
        layout, places = filters.layout, filters.layout.gain_and_normals
        # beds that are unlike in what passes are unlike in what stays
        own_sd = filters.model.settings.prior.own_gain_sd * filters.noise.unlike(filters.hypotheses.unrest)
        kinds_sd = [layout.unlike_of(target).gain_sd for target in range(layout.targets)]
        own_sds = np.hypot(own_sd[:, np.newaxis], kinds_sd)
        filtered = np.linalg.inv(filters.covariance[:, places[:, np.newaxis], places])
        count, size = own_sds.shape[0], places.size
        information = np.zeros((count, size + layout.targets, size + layout.targets))
        information[:, :size, :size] = 0.5 * (filtered + filtered.transpose(0, 2, 1))
        information[:, range(size, size + layout.targets), range(size, size + layout.targets)] = own_sds**-2
        return cls(np.column_stack([filters.mean[:, places], np.zeros_like(own_sds)]), information)

    def under(self, hypotheses: IntArray) -> FreeNormals:
        """The same at places (h,) of hypotheses, which may repeat."""
        return FreeNormals(self.mean[hypotheses], self.information[hypotheses])

    def guess(self, units: tuple[FloatArray, ...]) -> Guess:
        """The filters' own gain, with units (p, k) and no gains of the targets' own."""
        return Guess(np.maximum(self.mean[:, 0], LEAST_GAIN), units, self.mean[:, -len(units) :])


@dataclass(frozen=True, slots=True)
class _Fit:
    """A guess, with what a step from it needs."""

    guess: Guess
    tangents: list[FloatArray]
    jacobian: FloatArray
    pull: FloatArray
    misfit: FloatArray

    @classmethod
    def at(cls, free: FreeNormals, guess: Guess) -> _Fit:
        gain, units, own = guess
        each = gain[:, np.newaxis] * (1.0 + own)
        scaled = [each[:, [target]] * unit for target, unit in enumerate(units)]
        residual = free.mean - np.column_stack([gain, *scaled, own])
        tangents = [tangent_basis(unit) for unit in units]
        turns = sum(tangent.shape[2] for tangent in tangents)
        jacobian = np.zeros((*residual.shape, 1 + turns + len(units)))
        jacobian[:, 0, 0] = 1.0
        row, column = 1, 1
        for target, (unit, tangent) in enumerate(zip(units, tangents, strict=True)):
            rows, columns = slice(row, row + unit.shape[1]), slice(column, column + tangent.shape[2])
            jacobian[:, rows, 0] = (1.0 + own[:, [target]]) * unit
            jacobian[:, rows, columns] = each[:, [target], np.newaxis] * tangent
            jacobian[:, rows, 1 + turns + target] = gain[:, np.newaxis] * unit
            row, column = rows.stop, columns.stop
        jacobian[:, row:, 1 + turns :] = np.eye(len(units))
        pull = np.matmul(free.information, residual[..., np.newaxis])[..., 0]
        return cls(guess, tangents, jacobian, pull, (residual * pull).sum(axis=1))

    def after_step(self, step: FloatArray) -> Guess:
        """The guess after a step of gain, turns and own gains (p, q)."""
        units, column = [], 1
        for unit, tangent in zip(self.guess.units, self.tangents, strict=True):
            columns = slice(column, column + tangent.shape[2])
            moved = unit + np.matmul(tangent, step[:, columns, np.newaxis])[..., 0]
            # a step along the tangent leaves the sphere to second order
            units.append(moved / np.linalg.norm(moved, axis=1, keepdims=True))
            column = columns.stop
        gain = np.maximum(self.guess.gain + step[:, 0], LEAST_GAIN)
        return Guess(gain, tuple(units), self.guess.own + step[:, column:])


def unit_normals(free: FreeNormals, start: Guess, steps: int) -> UnitNormals:
    """Most probable unit normals near a start, in at most `steps`."""
    information, fit = free.information, _Fit.at(free, start)
    damping = np.full(len(information), 1e-6)
    for _ in range(steps):
        step = _step(fit, information, damping)
        if np.abs(step).max() < CONVERGED:
            break
        trial = _Fit.at(free, fit.after_step(step))
        better = trial.misfit <= fit.misfit + NO_WORSE
        damping = np.where(better, 0.2 * damping, 10.0 * damping + 1e-3)
        fit = trial if better.all() else _either(free, better, trial, fit)
    weighted = np.matmul(information, fit.jacobian)
    curvature = np.matmul(fit.jacobian.transpose(0, 2, 1), weighted)
    size = information.shape[1] - len(start.units)
    # the area of a sphere grows with its radius, the gain
    area = np.log(fit.guess.gain) * sum(tangent.shape[2] for tangent in fit.tangents)
    # Laplace: the Gaussian over gain and turns alone, against that over free vectors
    volume = np.linalg.slogdet(information)[1] - np.linalg.slogdet(curvature)[1]
    return UnitNormals(
        fit.guess,
        tuple(fit.tangents),
        np.linalg.inv(curvature),
        0.5 * (volume - fit.misfit) + area,
        -fit.pull[:, :size],
        weighted[:, :size],
        information[:, :size, :size],
    )


def _step(fit: _Fit, information: FloatArray, damping: FloatArray) -> FloatArray:
    transposed = fit.jacobian.transpose(0, 2, 1)
    slope = np.matmul(transposed, fit.pull[..., np.newaxis])
    curvature = np.matmul(transposed, np.matmul(information, fit.jacobian))
    diagonal, targets = np.arange(curvature.shape[1]), len(fit.tangents)
    # the sphere bends away from its tangents: with this two steps converge where Gauss and Newton's take ten;
    # at most half is taken off, so that no step climbs
    along = (1.0 + fit.guess.own) * (slope[:, -targets:, 0] - fit.pull[:, -targets:])
    bend = np.repeat(along, [tangent.shape[2] for tangent in fit.tangents], axis=1)
    turns = diagonal[1 : 1 + bend.shape[1]]
    curvature[:, turns, turns] += np.maximum(bend, -0.5 * curvature[:, turns, turns])
    # as Marquardt damps: relative, because gain and turns differ in size
    curvature[:, diagonal, diagonal] *= 1.0 + damping[:, np.newaxis]
    step = np.linalg.solve(curvature, slope)[..., 0]
    return np.asarray(step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / LONGEST))


def _either(free: FreeNormals, better: BoolArray, trial: _Fit, fit: _Fit) -> _Fit:
    """The trial where it is better."""
    chosen = better[:, np.newaxis]
    new, old = trial.guess, fit.guess
    units = (np.where(chosen, *pair) for pair in zip(new.units, old.units, strict=True))
    gain, own = np.where(better, new.gain, old.gain), np.where(chosen, new.own, old.own)
    return _Fit.at(free, Guess(gain, tuple(units), own))


def tangent_basis(unit: FloatArray) -> FloatArray:
    """Orthonormal directions square to unit vectors (p, k), as (p, k, k - 1); k is 2 or 3."""
    if unit.shape[1] == 2:
        return np.stack([unit[:, 1], -unit[:, 0]], axis=1)[..., np.newaxis]
    return np.stack([axis.T for axis in tangent_pair(unit.T)], axis=2)
