"""Which parameters do best against beds of known tilt, and how far that may be believed.

Pure: errors in, numbers out. A set's error is the mean over sessions of the mean over beds
of the median absolute tilt error, so a long session weighs no more than a short one. A set
that answers much less often than others is not ranked: silence is not accuracy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.workflows.grid import Parameter

FloatArray = NDArray[np.float64]

OVERFITTED = 1.2
"""How much larger than the best set's error that of sessions excluded from the choice may be."""

TALKATIVE = 0.9
"""Share of the most answers any set gives, below which a set is not ranked."""


@dataclass(frozen=True)
class Effect:
    """How the error goes with one parameter: its mean over all ranked sets of each value, degrees."""

    key: str
    values: tuple[str, ...]
    error_deg: tuple[float, ...]

    @property
    def span_deg(self) -> float:
        """How much the choice of this parameter matters."""
        return float(np.nanmax(self.error_deg) - np.nanmin(self.error_deg))

    @property
    def best_at_edge(self) -> bool:
        """Whether the best value is the first or last of three or more."""
        return len(self.values) > 2 and int(np.nanargmin(self.error_deg)) in (0, len(self.values) - 1)


@dataclass(frozen=True)
class Ranking:
    """The best set and its honesty.

    `error_deg` is that of every set (NaN: not ranked), `worst_deg` the largest single error of
    the best. `left_out_deg` is the mean error of sessions under the parameters chosen from the
    other sessions (NaN with fewer than two), `same_choice` in how many of `folds` that choice
    was the best set itself. `uncertain_share` of the best set's slopes are uncertain. `silent` are the
    sessions in which no ranked set has an error.
    """

    best: int
    error_deg: FloatArray
    worst_deg: float
    left_out_deg: float
    same_choice: int
    folds: int
    effects: tuple[Effect, ...]
    uncertain_share: float
    silent: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against taking the best set over."""
        return tuple(self._doubts())

    def _doubts(self) -> list[str]:
        found = float(self.error_deg[self.best])
        doubts = []
        if self.folds < 2:
            doubts.append("one session cannot tell a good parameter from a lucky one; sweep over several")
        elif self.left_out_deg > OVERFITTED * found:
            doubts.append(
                f"overfitting: chosen without it, parameters give a session {self.left_out_deg:.2f}°, not "
                f"{found:.2f}°; the choice stays the same in {self.same_choice} of {self.folds} such trials"
            )
        elif self.same_choice < self.folds:
            doubts.append(
                f"the choice is loose: in {self.folds - self.same_choice} of {self.folds} trials without one "
                f"session another set is chosen, and it is about as good ({self.left_out_deg:.2f}°, the best "
                f"set {found:.2f}°)"
            )
        if self.silent:
            doubts.append(
                f"without a slope of a bed of known tilt, and not in the ranking: {', '.join(self.silent)}"
            )
        if self.uncertain_share > 0.0:
            doubts.append(
                f"{self.uncertain_share:.0%} of the best set's slopes are uncertain: their 90 % regions "
                "are wide however small the errors came out"
            )
        doubts.extend(
            f"{effect.key}: the best value is at the end of those tried; try further"
            for effect in self.effects
            if effect.best_at_edge and effect.span_deg > 0.05
        )
        return doubts


def ranked(
    error_deg: FloatArray,
    worst_deg: FloatArray,
    answers: NDArray[np.int64],
    uncertain: NDArray[np.int64],
    sets: Sequence[tuple[str, ...]],
    varied: Sequence[Parameter],
    names: Sequence[str],
) -> Ranking | None:
    """Rank sets (rows) by their errors in sessions (columns), degrees, NaN where nothing is known.

    `worst_deg` and `answers` are the largest error and the number of answers, of the same shape,
    `uncertain` how many of the answers are; `sets` the ``KEY=VALUE`` of each row, `names` the sessions. None
    where no set has an error.
    """
    quiet = answers.sum(axis=1) < TALKATIVE * answers.sum(axis=1).max(initial=0)
    judged = np.where(quiet[:, np.newaxis], np.nan, error_deg)
    sessions = np.flatnonzero(np.isfinite(judged).any(axis=0))
    silent = tuple(name for place, name in enumerate(names) if place not in sessions)
    if not sessions.size:
        return None
    judged = judged[:, sessions]
    error = _mean(judged)
    best = int(np.nanargmin(error))
    left_out, same = np.nan, 0
    if sessions.size > 1:
        choices = [int(np.nanargmin(_mean(np.delete(judged, out, axis=1)))) for out in range(sessions.size)]
        left_out = float(_mean(np.array([judged[choice, out] for out, choice in enumerate(choices)])))
        same = choices.count(best)
    effects = tuple(_effect(parameter, sets, error) for parameter in varied)
    worst = float(np.nanmax(worst_deg[best, sessions]))
    share = float(uncertain[best].sum() / answers[best].sum())
    return Ranking(best, error, worst, left_out, same, sessions.size, effects, share, silent)


def _mean(error_deg: FloatArray) -> FloatArray:
    """Mean over the sessions where a set speaks; NaN where it never does."""
    known = np.isfinite(error_deg)
    total, count = np.where(known, error_deg, 0.0).sum(axis=-1), known.sum(axis=-1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan), np.float64)


def _effect(parameter: Parameter, sets: Sequence[tuple[str, ...]], error_deg: FloatArray) -> Effect:
    settings = [f"{parameter.key}={value}" for value in parameter.values]
    means = (_mean(error_deg[[setting in one for one in sets]]) for setting in settings)
    return Effect(parameter.key, parameter.values, tuple(float(mean) for mean in means))
