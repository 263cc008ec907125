"""Statements against what the minutes show: slopes of references, and that beds are alike.

A stated slope enters the filters as a prior: directions square to its normal are zero within its level.
Measuring the same with a negative variance takes it out again, exactly, as Kalman filters are linear.
"""

from __future__ import annotations

import copy

import numpy as np

from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.learner import STEPS_AFTER_DRAW, Learner
from fieldkit.estimation.learned.normals import FreeNormals, unit_normals
from fieldkit.estimation.learned.readout import KnownSlope, known_states, slope_of, turns_of
from fieldkit.estimation.normal import tangent_pair
from fieldkit.model.arrays import FloatArray

LEAST_TAUGHT = 0.01
"""Share of a statement's variance that the minutes must have taken to be compared with it.

Judged: because they then show the slope to ten times its level.
"""


def unstated_slope(learner: Learner, reference: int) -> KnownSlope:
    """Slope of a reference of the learner's layout by all others."""
    layout, posterior = learner.layout, learner.posterior
    filters, change = _without_statement(learner, reference)
    normals = unit_normals(FreeNormals.of(filters), posterior.normals.mode, STEPS_AFTER_DRAW)
    log_weights = posterior.log_weights + change + normals.log_evidence - posterior.normals.log_evidence
    if reference:
        facing = layout.facing[reference - 1]
        units, tangents, covariance = turns_of(normals, reference - 1)
    else:
        off, covariance, _ = known_states(filters, normals, range(layout.level.start, layout.level.stop))
        facing, scale = np.eye(3), normals.mode.gain[:, np.newaxis]
        units = layout.known[0] + off / scale @ layout.level_axes.T
        units /= np.linalg.norm(units, axis=1, keepdims=True)
        covariance = covariance / scale[..., np.newaxis] ** 2
        tangents = np.broadcast_to(layout.level_axes, (len(units), 3, 2))
    return slope_of([(units, tangents, covariance, log_weights)], facing, learner.settings)


def statement_sds(learner: Learner, reference: int) -> float:
    """How far the stated slope of a reference is off what all others show, in standard deviations of both.

    By what the minutes have moved the statement: its posterior mean m is of variance P0 - P before the data.
    """
    layout, posterior = learner.layout, learner.posterior
    rows = _stated_directions(layout, reference)
    places = np.flatnonzero(rows.any(axis=0))
    means, covariances, _ = known_states(posterior.filters, posterior.normals, places)
    away, weights = means @ rows[:, places].T, posterior.weights
    mean = weights @ away
    covariance = rows[:, places] @ np.tensordot(weights, covariances, axes=1) @ rows[:, places].T
    covariance += (weights[:, np.newaxis] * (away - mean)).T @ (away - mean)
    level = (learner.settings.scale * layout.level_sds[reference]) ** 2
    sizes, axes = np.linalg.eigh(level * np.eye(len(mean)) - covariance)
    # what hardly any minute has moved says nothing, and rounding would
    return float(np.sqrt(np.sum((mean @ axes) ** 2 / np.maximum(sizes, LEAST_TAUGHT * level))))


def _without_statement(learner: Learner, reference: int) -> tuple[Filters, FloatArray]:
    """The filters as if a reference's slope were as little known as a target's; change of weights."""
    filters, layout, settings = learner.posterior.filters, learner.layout, learner.settings
    rows = _stated_directions(layout, reference)
    level = 1.0 / (settings.scale * layout.level_sds[reference]) ** 2
    free = 1.0 / (settings.scale * settings.prior.normal_horizontal_sd) ** 2
    measured = filters.mean @ rows.T
    shared = filters.covariance @ rows.T
    spread = rows @ shared - np.eye(len(rows)) / (level - free)
    gain = np.linalg.solve(spread, shared.transpose(0, 2, 1))
    without = copy.copy(filters)
    without.mean = filters.mean - np.matmul(measured[:, np.newaxis], gain)[:, 0]
    without.covariance = filters.covariance - shared @ gain
    surprise = np.matmul(measured[:, np.newaxis], np.linalg.solve(spread, measured[..., np.newaxis]))
    return without, -0.5 * (surprise[:, 0, 0] + np.linalg.slogdet(-spread)[1])


def _stated_directions(layout: Layout, reference: int) -> FloatArray:
    """Rows (k, n) of the state that a reference's statement makes zero, within its level."""
    if not reference:
        return np.eye(layout.size)[layout.level]
    along = layout.stated_normal(reference - 1)
    square = np.array([[along[1], -along[0]]]) if along.size == 2 else np.stack(tangent_pair(along))
    rows = np.zeros((len(square), layout.size))
    rows[:, layout.normal(reference - 1)] = square
    return rows
