"""The chain that learns: one minute after the other, hypotheses drawn anew when the data ask for it.

What is known after a minute depends on the minutes up to it alone, not on when it was asked: a replay that
takes the same minutes takes the same steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.learned.errors import ErrorSums
from fieldkit.estimation.learned.filters import Filters, Start
from fieldkit.estimation.learned.hypotheses import Proposal, effective, hypotheses, log_prior, normalise
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs, Recorded, bridge
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.noise import noise_of
from fieldkit.estimation.learned.normals import UnitNormals, unit_normals
from fieldkit.estimation.normal import Misfit, solve
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.physics.facet import tilt_azimuth

FIRST_DRAW = 5
"""Minutes before the first hypotheses are judged.

Judged: because as many as `min_minutes`, from which slopes are shown, hold against each other at all.
"""
FEWEST = 10.0
"""Effective hypotheses below which all are drawn anew.

Judged: because the mean of fewer scatters by a third of the posterior's own deviation.
"""
LONGER = 1.2
"""Length of the chain over that at the last draw from which a new draw may be due.

Judged: because a draw takes all minutes again: growing by a share keeps the cost of a session linear.
"""
FIRST_ROUNDS, ROUNDS, MOST_ROUNDS = 3, 2, 10
"""Draws after the first minutes, later, and at most while fewer than `FEWEST` count.

Judged: because the first ones start from the prior and move farthest; ten bound the time that a minute takes.
"""
REMEMBERED = 3
"""Rounds whose hypotheses show where the next are to be drawn.

Judged: because three times 64 densities carry the polynomial; older draws lie where nothing is any more.
"""
STEPS, STEPS_AFTER_DRAW = 4, 15
"""Gauss-Newton steps of unit normals from those of the minute before, and from the filters' own.

Judged: because a minute moves a normal little; from afar it takes more, and what has converged stops.
"""
FAR = 40.0
"""Misfit over the best branch from which another one is not pursued.

Judged: because its weight is then exp(-20).
"""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Posterior distribution after a minute: filters with the hypotheses (p,), and their weights.

    `log_weights` (p,) hold up to a constant, `normals` with every target in its preferred branch. `others`
    has by target with a second branch the normals with that target alone in it, and the log-weights then.
    """

    filters: Filters
    log_weights: FloatArray
    normals: UnitNormals
    others: dict[int, tuple[UnitNormals, FloatArray]]

    @property
    def weights(self) -> FloatArray:
        """Weights of the hypotheses (p,), adding up to one."""
        return normalise(self.log_weights)

    @property
    def state(self) -> FloatArray:
        """Mean state (n,) over the hypotheses, with unit normals."""
        constrained = self.filters.layout.gain_and_normals
        shift = np.matmul(self.filters.covariance[:, :, constrained], self.normals.pull[..., np.newaxis])
        return np.asarray(self.weights @ (self.filters.mean + shift[..., 0]))


class Learner:
    """Learns from minutes about the regions of a layout."""

    def __init__(self, layout: Layout, settings: EstimatorSettings, sessions: list[Recorded]) -> None:
        self.layout = layout
        self.settings = settings
        self.errors: ErrorSums = ErrorSums()
        """Prediction errors of all minutes under the present hypotheses."""
        self._take(sessions)

    def _take(self, sessions: list[Recorded]) -> None:
        """Take all these minutes under hypotheses drawn from the prior."""
        self._sessions = sessions
        self._judged = 0
        self._around: list[FloatArray | None] = [None] * len(sessions)
        self._draw(Proposal.prior())
        self.posterior: Posterior = self._posterior(STEPS_AFTER_DRAW)

    @property
    def minutes(self) -> Sequence[MinuteInputs]:
        """All minutes taken, with those that were bridged."""
        return [minute for session in self._sessions for minute in session.minutes]

    @property
    def last(self) -> MinuteInputs:
        """The last minute taken."""
        return self._sessions[-1].minutes[-1]

    @property
    def logged_inputs(self) -> Logged:
        """Quantities that the last session logs."""
        return self._sessions[-1].logged

    def add(self, minute: MinuteInputs) -> None:
        """Take one more minute, bridging those that are missing before it."""
        for following in (*bridge(self.last, minute), minute):
            self._sessions[-1].minutes.append(following)
            self.errors = self.errors.plus(self._filters.step(following))
        self.posterior = self._posterior(STEPS)
        if self._is_due():
            self._draw_anew(ROUNDS if self._judged else FIRST_ROUNDS)

    def reshade(self, minutes: list[MinuteInputs]) -> None:
        """Take the same minutes again, of which some turned out to be shaded, or not."""
        # what was drawn and judged under the wrong shade counts no longer
        self._take([Recorded(self.logged_inputs, minutes)])

    def draw_for_all(self) -> None:
        """Draw the hypotheses for all minutes at once, not as they add up."""
        self._draw_anew(FIRST_ROUNDS)

    def _draw_anew(self, rounds: int) -> None:
        """Hypotheses where those that count are, some rounds over, and more while few of them count."""
        densities: list[tuple[FloatArray, FloatArray]] = []
        for number in range(MOST_ROUNDS):
            if number >= rounds and effective(self.posterior.log_weights) >= FEWEST:
                break
            self._around = self._centres()
            # weights are posterior over proposal: times the proposal they are the density again
            log_density = self.posterior.log_weights + self._proposal.log_density(self._points)
            densities = [*densities, (self._points, log_density)][-REMEMBERED:]
            points, log_densities = (np.concatenate(arrays) for arrays in zip(*densities, strict=True))
            self._draw(Proposal.fit(points, log_densities))
            self.posterior = self._posterior(STEPS_AFTER_DRAW)
        self._judged = len(self.minutes)

    def _centres(self) -> list[FloatArray | None]:
        """The state at the end of each session, with what lasts as it is known by now."""
        now, lasting = self.posterior.state, self.layout.lasting_places
        ends = [self.posterior.weights @ mean for mean in self._filters.ends]
        for end in ends:
            end[lasting] = now[lasting]
        return [*ends, now]

    def _is_due(self) -> bool:
        count = len(self.minutes)
        if count < FIRST_DRAW:
            return False
        if self._judged == 0 or count >= 2 * self._judged:
            return True
        # a draw takes all minutes again: only a chain that has grown by a share keeps the whole cost linear
        return count >= LONGER * self._judged and effective(self.posterior.log_weights) < FEWEST

    def _draw(self, proposal: Proposal) -> None:
        """New hypotheses, taken through all minutes so far."""
        self._proposal = proposal
        self._points = proposal.draw()
        starts = [
            Start(minutes[0], logged, around, noise_of(minutes, self.settings.noise_k))
            for (logged, minutes), around in zip(self._sessions, self._around, strict=True)
        ]
        drawn = hypotheses(self._points, self.settings)
        self._filters = Filters(self.layout, drawn, self.settings, starts[0])
        self.errors = ErrorSums()
        for number, session in enumerate(self._sessions):
            if number:
                self._filters.begin_session(starts[number])
            for minute in session.minutes:
                self.errors = self.errors.plus(self._filters.step(minute))
        self._starts = self._directions()

    def _posterior(self, steps: int) -> Posterior:
        best = self._weigh(self._starts, steps)
        others = {}
        for target, start in self._second_branches(*best).items():
            starts = tuple(start if i == target else unit for i, unit in enumerate(best[0].units))
            other = self._weigh(starts, STEPS_AFTER_DRAW)
            if mass(other[1]) > mass(best[1]):
                best, other = other, best
            others[target] = other
        self._starts = best[0].units
        return Posterior(self._filters, best[1], best[0], others)

    def _weigh(self, starts: tuple[FloatArray, ...], steps: int) -> tuple[UnitNormals, FloatArray]:
        normals = unit_normals(self._filters, starts, steps)
        tilts = [
            tilt_azimuth(unit @ axes.T)[0]
            for unit, axes in zip(normals.units, self.layout.facing, strict=True)
        ]
        # a finite penalty: where every hypothesis is too steep, weights must still add up to one
        too_steep = np.max(tilts, axis=0) > self.settings.tilt_limit_deg + 5.0
        over_proposal = log_prior(self._points) - self._proposal.log_density(self._points)
        weights = self._filters.log_likelihood + normals.log_evidence + over_proposal
        return normals, weights - np.where(too_steep, FAR, 0.0)

    def _directions(self) -> tuple[FloatArray, ...]:
        """Directions of the filters' own normals, a start that knows no branch."""
        vectors = [self._filters.mean[:, self.layout.normal(target)] for target in range(self.layout.targets)]
        return tuple(vector / np.linalg.norm(vector, axis=1, keepdims=True) for vector in vectors)

    def _second_branches(self, normals: UnitNormals, log_weights: FloatArray) -> dict[int, FloatArray]:
        """The other direction in which each target fits nearly as well, under the heaviest hypothesis."""
        heaviest = int(np.argmax(log_weights))
        gain, facing = normals.gain[heaviest], self.layout.facing
        here = [unit[heaviest] for unit in normals.units]
        places = [self.layout.normal(target) for target in range(self.layout.targets)]
        covariance, mean = self._filters.covariance[heaviest], self._filters.mean[heaviest]
        information = [np.linalg.inv(covariance[place, place]) * gain**2 for place in places]
        towards = [matrix @ mean[place] / gain for matrix, place in zip(information, places, strict=True)]
        others = _other_minima(information, towards, here)
        limit = self.settings.tilt_limit_deg
        return {
            target: other
            for target, other in others.items()
            if tilt_azimuth(facing[target] @ other)[0] <= limit
        }


def mass(log_weights: FloatArray) -> float:
    """Logarithm of the probability of a branch with these log-weights."""
    return float(np.logaddexp.reduce(log_weights))


def _other_minima(
    information: list[FloatArray], towards: list[FloatArray], here: list[FloatArray]
) -> dict[int, FloatArray]:
    """By target, the other minimum of ``u'Hu - 2 b'u`` over unit vectors, unless it is far worse."""
    minima = {}
    for target, units in enumerate(_minima(information, towards)):
        H, b, unit = information[target], towards[target], here[target]
        misfits = np.sum((units @ H - 2.0 * b) * units, axis=1)
        close = (units @ unit < np.cos(0.02)) & (misfits < (unit @ H - 2.0 * b) @ unit + FAR)
        if close.any():
            minima[target] = units[close][np.argmin(misfits[close])]
    return minima


def _minima(information: list[FloatArray], towards: list[FloatArray]) -> list[FloatArray]:
    """All local minima of each target (m, k) over unit vectors, on the circle or on the sphere."""
    minima = [
        _minima_on_circle(H, b) if b.size == 2 else b for H, b in zip(information, towards, strict=True)
    ]
    free = [target for target, b in enumerate(towards) if b.size == 3]
    if free:
        H, b = (np.stack([of[target] for target in free]) for of in (information, towards))
        branches = solve(Misfit(H, b, np.zeros(len(free)), np.ones(len(free), np.int64)))
        for target, first, second in zip(free, branches.first, branches.second, strict=True):
            minima[target] = np.stack([first, second])
    return minima


def _minima_on_circle(H: FloatArray, b: FloatArray) -> FloatArray:
    # half a degree is near enough: unit normals are polished from there
    angles = np.linspace(-np.pi, np.pi, 721)[:-1]
    grid = np.column_stack([np.sin(angles), np.cos(angles)])
    misfit = np.sum((grid @ H - 2.0 * b) * grid, axis=1)
    return np.asarray(grid[(misfit < np.roll(misfit, 1)) & (misfit <= np.roll(misfit, -1))])
