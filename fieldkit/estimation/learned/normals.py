"""From a filter's normals times the gain to unit normals: all beds and the gain together.

A filter knows the vectors ``gain * normal`` as a joint normal distribution in which lengths are free. Lengths
must all equal the gain, up to what each bed absorbs more or less than the reference: a bed whose vector the
sun's path pins down gives the gain, so nearly every other bed's too. The most probable unit normals are found
by damped Gauss-Newton steps for all hypotheses at once; around them
the distribution is taken to be normal in the plane that touches the sphere (Laplace).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.normal import tangent_pair
from fieldkit.model.arrays import BoolArray, FloatArray

LONGEST = 0.25
"""Longest step of the gain or of a turn in radians.

Judged: because beyond 14 degrees the plane that touches the sphere is none of its neighbourhood.
"""
LEAST_GAIN = 0.3
"""Judged: because no light meter and surface are off by more; at zero all normals would be one."""
CONVERGED = 1e-7
"""Step of the gain or of a turn in radians below which another one would change nothing."""
NO_WORSE = 1e-8
"""Growth of the misfit that is rounding: it must not decide whether a last small step is taken, else results
would differ between processors."""


@dataclass(frozen=True, slots=True)
class UnitNormals:
    """Unit normals for each of p hypotheses, with the gain (p,).

    `units` are each target's unit vectors in the axes of the layout (p, k), `tangents` the directions in
    which they may turn (p, k, k - 1). `covariance` (p, q, q), rad2, is of gain, turns in the order of the
    targets, and the targets' own gains; `log_evidence` (p,) the logarithm of the probability of unit normals
    given what the filter knows. In units of information `pull` (p, m) is gain and normals less the filter's
    means, `jacobian` (p, m, q) that of gain and normals by gain, turns and own gains.
    """

    gain: FloatArray
    units: tuple[FloatArray, ...]
    tangents: tuple[FloatArray, ...]
    covariance: FloatArray
    log_evidence: FloatArray
    pull: FloatArray
    jacobian: FloatArray

    def turn(self, target: int) -> slice:
        """Places of a target's turns in `covariance`."""
        first = 1 + sum(tangent.shape[2] for tangent in self.tangents[:target])
        return slice(first, first + self.tangents[target].shape[2])


@dataclass(frozen=True, slots=True)
class _Fit:
    """Gain, unit normals and the targets' own gains (p, targets), with what a step from them needs."""

    gain: FloatArray
    units: list[FloatArray]
    own: FloatArray
    tangents: list[FloatArray]
    jacobian: FloatArray
    residual: FloatArray
    misfit: FloatArray

    @classmethod
    def at(
        cls,
        mean: FloatArray,
        information: FloatArray,
        gain: FloatArray,
        units: list[FloatArray],
        own: FloatArray,
    ) -> _Fit:
        each = gain[:, np.newaxis] * (1.0 + own)
        scaled = [each[:, [target]] * unit for target, unit in enumerate(units)]
        residual = mean - np.column_stack([gain, *scaled, own])
        tangents = [tangent_basis(unit) for unit in units]
        turns = sum(tangent.shape[2] for tangent in tangents)
        jacobian = np.zeros((*mean.shape, 1 + turns + len(units)))
        jacobian[:, 0, 0] = 1.0
        row, column = 1, 1
        for target, (unit, tangent) in enumerate(zip(units, tangents, strict=True)):
            rows, columns = slice(row, row + unit.shape[1]), slice(column, column + tangent.shape[2])
            jacobian[:, rows, 0] = (1.0 + own[:, [target]]) * unit
            jacobian[:, rows, columns] = each[:, [target], np.newaxis] * tangent
            jacobian[:, rows, 1 + turns + target] = gain[:, np.newaxis] * unit
            row, column = rows.stop, columns.stop
        jacobian[:, row:, 1 + turns :] = np.eye(len(units))
        weighted = np.matmul(information, residual[..., np.newaxis])[..., 0]
        return cls(gain, units, own, tangents, jacobian, residual, (residual * weighted).sum(axis=1))

    def after_step(self, step: FloatArray) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """Gain, unit normals and own gains after a step of gain, turns and own gains (p, q)."""
        units, column = [], 1
        for unit, tangent in zip(self.units, self.tangents, strict=True):
            columns = slice(column, column + tangent.shape[2])
            moved = unit + np.matmul(tangent, step[:, columns, np.newaxis])[..., 0]
            # a step along the tangent leaves the sphere to second order
            units.append(moved / np.linalg.norm(moved, axis=1, keepdims=True))
            column = columns.stop
        return np.maximum(self.gain + step[:, 0], LEAST_GAIN), units, self.own + step[:, column:]


def unit_normals(filters: Filters, starts: tuple[FloatArray, ...], steps: int) -> UnitNormals:
    """Most probable unit normals near the starts, one (k,) or (p, k) for each target, in at most `steps`."""
    filtered, free = _gain_and_normals(filters)
    # beds that are unlike in what passes are unlike in what stays
    own_sd = filters.model.settings.prior.own_gain_sd * filters.noise.unlike(filters.hypotheses.unrest)
    kinds_sd = [filters.layout.unlike_of(target).gain_sd for target in range(len(starts))]
    own_sd = np.hypot(own_sd[:, np.newaxis], kinds_sd)
    mean, information = _with_own_gains(filtered, free, len(starts), own_sd)
    units = [np.broadcast_to(start, (len(mean), start.shape[-1])).copy() for start in starts]
    fit = _Fit.at(mean, information, np.maximum(mean[:, 0], LEAST_GAIN), units, mean[:, filtered.shape[1] :])
    damping = np.full(len(mean), 1e-6)
    for _ in range(steps):
        step = _step(fit, information, damping)
        if np.abs(step).max() < CONVERGED:
            break
        trial = _Fit.at(mean, information, *fit.after_step(step))
        better = trial.misfit <= fit.misfit + NO_WORSE
        damping = np.where(better, 0.2 * damping, 10.0 * damping + 1e-3)
        fit = trial if better.all() else _either(mean, information, better, trial, fit)
    weighted = np.matmul(information, fit.jacobian)
    curvature = np.matmul(fit.jacobian.transpose(0, 2, 1), weighted)
    # the area of a sphere grows with its radius, the gain
    area = np.log(fit.gain) * sum(tangent.shape[2] for tangent in fit.tangents)
    # Laplace: the Gaussian over gain and turns alone, against that over free vectors
    volume = np.linalg.slogdet(information)[1] - np.linalg.slogdet(curvature)[1]
    return UnitNormals(
        fit.gain,
        tuple(fit.units),
        tuple(fit.tangents),
        np.linalg.inv(curvature),
        0.5 * (volume - fit.misfit) + area,
        -np.matmul(free, fit.residual[:, : filtered.shape[1], np.newaxis])[..., 0],
        weighted[:, : filtered.shape[1]],
    )


def _with_own_gains(
    mean: FloatArray, information: FloatArray, targets: int, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The same numbers, followed by the own gains of the targets around zero."""
    count, size = mean.shape
    whole = np.zeros((count, size + targets, size + targets))
    whole[:, :size, :size] = information
    whole[:, range(size, size + targets), range(size, size + targets)] = sd**-2
    return np.column_stack([mean, np.zeros((count, targets))]), whole


def _gain_and_normals(filters: Filters) -> tuple[FloatArray, FloatArray]:
    """The filter's mean (p, m) and information (p, m, m) of gain and normals."""
    places = filters.layout.gain_and_normals
    information = np.linalg.inv(filters.covariance[:, places][:, :, places])
    return filters.mean[:, places], 0.5 * (information + information.transpose(0, 2, 1))


def _step(fit: _Fit, information: FloatArray, damping: FloatArray) -> FloatArray:
    transposed = np.matmul(fit.jacobian.transpose(0, 2, 1), information)
    slope = np.matmul(transposed, fit.residual[..., np.newaxis])
    curvature = np.matmul(transposed, fit.jacobian)
    diagonal = np.arange(curvature.shape[1])
    # as Marquardt damps: relative, because gain and turns differ in size
    curvature[:, diagonal, diagonal] *= 1.0 + damping[:, np.newaxis]
    step = np.linalg.solve(curvature, slope)[..., 0]
    return np.asarray(step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / LONGEST))


def _either(mean: FloatArray, information: FloatArray, better: BoolArray, trial: _Fit, fit: _Fit) -> _Fit:
    """The trial where it is better."""
    chosen = better[:, np.newaxis]
    units = [np.where(chosen, new, old) for new, old in zip(trial.units, fit.units, strict=True)]
    gain, own = np.where(better, trial.gain, fit.gain), np.where(chosen, trial.own, fit.own)
    return _Fit.at(mean, information, gain, units, own)


def tangent_basis(unit: FloatArray) -> FloatArray:
    """Orthonormal directions square to unit vectors (p, k), as (p, k, k - 1); k is 2 or 3."""
    if unit.shape[1] == 2:
        return np.stack([unit[:, 1], -unit[:, 0]], axis=1)[..., np.newaxis]
    return np.stack([axis.T for axis in tangent_pair(unit.T)], axis=2)
