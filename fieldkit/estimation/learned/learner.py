"""The chain that learns: one minute after the other, hypotheses drawn anew when the data ask for it.

What is known after a minute depends on the minutes up to it alone, not on when it was asked: a replay that
takes the same minutes takes the same steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.learned.draw import Draw
from fieldkit.estimation.learned.errors import ErrorSums
from fieldkit.estimation.learned.filters import Filters
from fieldkit.estimation.learned.hypotheses import Proposal, effective, normalise
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs, Recorded, bridge
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.normals import FreeNormals, Guess, UnitNormals, unit_normals
from fieldkit.estimation.learned.unusual import with_usual_beds
from fieldkit.estimation.normal import mirror
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.physics.facet import tilt_azimuth

ROUND, FOLLOWING, AT_ONCE = 64, 128, 256
"""Hypotheses of a round that seeks where they count, of those that follow the minutes, and of all at once.

Judged: because means of so many scatter by less than a tenth of a half-width, of the last by a fortieth.
"""
FIRST_DRAW = 5
"""Minutes before the first hypotheses are judged.

Judged: because as many as `min_minutes`, from which slopes are shown, hold against each other at all.
"""
GOOD_SHARE, LEAST_SHARE = 0.35, 0.25
"""Effective share of the hypotheses that ends the rounds, and below which those that follow are drawn anew.

Judged: because a proposal that were the posterior, and as much wider as it has to be, would have two thirds.
"""
ASTRAY = 0.35
"""Distance of the hypotheses' mean from the proposal's centre, in its deviations, that asks for a new draw.

Judged: because the share does not show mass that a proposal misses; its mean begins to leave before.
"""
SETTLED_SDS = 0.3
"""Change of the state that products are linear around, in its deviations, below which no round follows.

Judged: because slopes move by less than a thirtieth of their half-width by it.
"""
LONGER = 1.5
"""Length of the chain over that at the last draw from which a new draw may be due.

Judged: because a draw takes all minutes again: growing by a share keeps the cost of a session linear.
"""
CATCH_UP = 40
"""Old minutes that hypotheses drawn anew take in each minute, beside those that follow.

Judged: because it bounds the time of a minute; after three hours it takes five minutes to catch up.
"""
MOST_ROUNDS = 10
"""Rounds at most: where the minutes contradict the model no share may ever be good."""
REMEMBERED = 3
"""Rounds whose hypotheses show where the next are to be drawn.

Judged: because three times 64 densities carry the polynomial; older draws lie where nothing is any more.
"""
STEPS, STEPS_AFTER_DRAW = 6, 15
"""Newton steps of unit normals from those of the minute before, and from the filters' own.

Judged: because a minute moves a normal little and most converge in two or three; from afar it takes more.
"""
MULTIPLIED = ("gain", "diffuse", "circumsolar", "brightening")
"""States by which others are multiplied."""
APART = math.cos(0.02)
"""Cosine of the angle from which two branches are two: a degree is less than any half-width."""
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

    @property
    def spread(self) -> FloatArray:
        """Standard deviation of the state (n,) over the hypotheses, without unit normals."""
        means, within = self.filters.mean, np.diagonal(self.filters.covariance, axis1=1, axis2=2)
        return np.asarray(np.sqrt(self.weights @ (within + (means - self.weights @ means) ** 2)))


Density = tuple[FloatArray, FloatArray]
"""Points (p, 5) and the logarithm of the posterior density there, (p,) up to a constant."""


class Learner:
    """Learns from minutes about the regions of a layout, by `count` hypotheses."""

    posterior: Posterior
    _draw: Draw
    _next: Draw | None
    _guess: Guess | None

    def __init__(
        self, layout: Layout, settings: EstimatorSettings, sessions: list[Recorded], count: int = FOLLOWING
    ) -> None:
        self.layout = layout
        self.settings = settings
        self._sessions = sessions
        self._take_all(count)

    @property
    def errors(self) -> ErrorSums:
        """Prediction errors of all minutes under the present hypotheses."""
        return self._draw.errors

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
        self._sessions[-1].minutes.extend((*bridge(self.last, minute), minute))
        self._draw.take(self._sessions)
        self.posterior = self._posterior()
        if self._next is None and self._is_due():
            self._next, self._judged = self._drawn_anew(FOLLOWING, [self._density()]), len(self.minutes)
        if self._next is not None:
            self._next.take(self._sessions, CATCH_UP)
            if self._next.taken == len(self.minutes):
                self._follow(self._next)
                self._next = None

    def take_again(self, session: Recorded) -> None:
        """Take the same minutes again, of which some turned out to be shaded, or not, or to be read."""
        # what was drawn and judged under the wrong inputs counts no longer
        self._sessions = [session]
        self._take_all(FOLLOWING)

    def _take_all(self, count: int) -> None:
        """Draw so many hypotheses for all minutes, after rounds that seek where they count."""
        self._next = None
        self._judged = 0
        nowhere: list[FloatArray | None] = [None] * len(self._sessions)
        is_enough = len(self.minutes) >= FIRST_DRAW
        self._follow(self._drawn(Proposal.prior(), ROUND if is_enough else count, nowhere))
        if is_enough:
            densities: list[Density] = []
            for _ in range(MOST_ROUNDS):
                densities = [*densities, self._density()][-REMEMBERED:]
                before = self._draw.around[-1]
                self._follow(self._drawn_anew(ROUND, densities))
                if self._share() >= GOOD_SHARE and self._is_near(before):
                    break
            if count > ROUND:  # the last round has as many already
                self._follow(self._drawn_anew(count, [*densities, self._density()][-REMEMBERED:]))
            self._judged = len(self.minutes)

    def _drawn(self, proposal: Proposal, count: int, around: Sequence[FloatArray | None]) -> Draw:
        return Draw(self.layout, self.settings, proposal, count, self._sessions, around)

    def _drawn_anew(self, count: int, densities: Sequence[Density]) -> Draw:
        """Hypotheses fitted to the densities of some draws, which have taken no minute yet."""
        points, log_densities = (np.concatenate(arrays) for arrays in zip(*densities, strict=True))
        return self._drawn(Proposal.fit(points, log_densities), count, self._centres())

    def _follow(self, draw: Draw) -> None:
        """Take all minutes with these hypotheses, and go on with them."""
        draw.take(self._sessions)
        self._draw = draw
        self._guess = None
        self.posterior = self._posterior()

    def _density(self) -> Density:
        """The posterior's density at the hypotheses: weights are posterior over proposal."""
        points = self._draw.points
        return points, self.posterior.log_weights + self._draw.proposal.log_density(points)

    def _share(self) -> float:
        """Effective share of the hypotheses."""
        return effective(self.posterior.log_weights) / len(self._draw.points)

    def _is_near(self, before: FloatArray | None) -> bool:
        """True if what products are linear around has hardly moved since before the last round."""
        if before is None:
            return False
        places = [self.layout.place(name) for name in MULTIPLIED]
        spread = self.posterior.spread[places]
        return bool(np.all(np.abs(self.posterior.state - before)[places] <= SETTLED_SDS * spread))

    def _centres(self) -> list[FloatArray | None]:
        """The state at the end of each session, with what lasts as it is known by now."""
        now, lasting = self.posterior.state, self.layout.lasting_places
        ends = [self.posterior.weights @ mean for mean in self._draw.filters.ends]
        for end in ends:
            end[lasting] = now[lasting]
        return [*ends, now]

    def _is_due(self) -> bool:
        count = len(self.minutes)
        if count < FIRST_DRAW or count < LONGER * self._judged:
            return False
        mean = self.posterior.weights @ self._draw.points
        return self._share() < LEAST_SHARE or self._draw.proposal.distance(mean) > ASTRAY

    def _posterior(self) -> Posterior:
        filters = with_usual_beds(self._draw.filters, self.last.hours)
        free = FreeNormals.of(filters)
        start = self._guess or free.guess(self._draw.directions())
        best = self._weigh(filters, free, start, STEPS if self._guess else STEPS_AFTER_DRAW)
        others = {}
        for target, unit in self._second_branches(filters, free, *best):
            start = best[0].mode.under(np.arange(len(filters.mean)))
            start.units[target][:] = unit
            other = self._weigh(filters, free, start, STEPS_AFTER_DRAW)
            if mass(other[1]) > mass(best[1]):
                best, other = other, best
            others[target] = other
        self._guess = best[0].mode
        return Posterior(filters, best[1], best[0], others)

    def _weigh(
        self, filters: Filters, free: FreeNormals, start: Guess, steps: int
    ) -> tuple[UnitNormals, FloatArray]:
        normals = unit_normals(free, start, steps)
        tilts = [
            tilt_azimuth(normals.mode.units[target] @ self.layout.facing[target].T)[0]
            for target in range(self.layout.stated, self.layout.targets)
        ]
        # a finite penalty: where every hypothesis is too steep, weights must still add up to one
        too_steep = np.max(tilts, axis=0) > self.settings.tilt_limit_deg + 5.0
        weights = filters.log_likelihood + normals.log_evidence + self._draw.over_proposal
        return normals, weights - np.where(too_steep, FAR, 0.0)

    def _second_branches(
        self, filters: Filters, free: FreeNormals, normals: UnitNormals, log_weights: FloatArray
    ) -> Iterator[tuple[int, FloatArray]]:
        """Each target with another direction that fits nearly as well, under the heaviest hypothesis."""
        heaviest, targets = int(np.argmax(log_weights)), range(self.layout.stated, self.layout.targets)
        repeated = np.full(self.layout.targets, heaviest)
        here, start = (normals.mode.under(repeated) for _ in range(2))
        for target in targets:
            place = self.layout.normal(target)
            # of the least information, which is the most variance
            information = -filters.covariance[heaviest, place, place]
            start.units[target][target] = mirror(here.units[target][0], information)
        fits = unit_normals(free.under(repeated), start, STEPS_AFTER_DRAW)
        near = fits.log_evidence > normals.log_evidence[heaviest] - FAR / 2.0
        for target in targets:
            unit = fits.mode.units[target][target]
            tilt, _ = tilt_azimuth(self.layout.facing[target] @ unit)
            is_apart = unit @ here.units[target][0] < APART
            if is_apart and near[target] and tilt <= self.settings.tilt_limit_deg:
                yield target, unit


def mass(log_weights: FloatArray) -> float:
    """Logarithm of the probability of a branch with these log-weights."""
    return float(np.logaddexp.reduce(log_weights))
