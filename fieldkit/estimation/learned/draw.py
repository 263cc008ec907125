"""One draw: hypotheses side by side, each with its filter, and how far they have come in the minutes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from fieldkit.estimation.learned.errors import ErrorSums
from fieldkit.estimation.learned.filters import Filters, Start
from fieldkit.estimation.learned.hypotheses import Proposal, hypotheses, log_prior
from fieldkit.estimation.learned.inputs import Recorded
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.noise import noise_of
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray


class Draw:
    """Hypotheses drawn from a proposal at `points` (p, 5), for the minutes of some sessions by then.

    `over_proposal` (p,) is the logarithm of the prior over the proposal. Noise is that of these minutes, and
    products of two unknowns are linear around the states `around`, one of each session or None for the
    prior's. `taken` counts the minutes that `filters` have taken, with the prediction errors `errors`.
    """

    def __init__(
        self,
        layout: Layout,
        settings: EstimatorSettings,
        proposal: Proposal,
        count: int,
        sessions: Sequence[Recorded],
        around: Sequence[FloatArray | None],
    ) -> None:
        self.proposal = proposal
        self.points: FloatArray = proposal.draw(count)
        self.over_proposal: FloatArray = log_prior(self.points) - proposal.log_density(self.points)
        self.around = around
        self.taken: int = 0
        self.errors: ErrorSums = ErrorSums()
        self._session = 0
        self._starts = [
            Start(minutes[0], logged, centre, noise_of(minutes, settings.noise_k))
            for (logged, minutes), centre in zip(sessions, around, strict=True)
        ]
        self.filters: Filters = Filters(layout, hypotheses(self.points, settings), settings, self._starts[0])

    def take(self, sessions: Sequence[Recorded], most: int | None = None) -> None:
        """Take the next minutes, all that are left or `most` of them."""
        minutes = [(number, minute) for number, (_, taken) in enumerate(sessions) for minute in taken]
        for number, minute in islice(minutes, self.taken, None if most is None else self.taken + most):
            if number > self._session:
                self.filters.begin_session(self._starts[number])
                self._session = number
            self.errors = self.errors.plus(self.filters.step(minute))
            self.taken += 1

    def directions(self) -> tuple[FloatArray, ...]:
        """Directions of the filters' own normals, a start that knows no branch."""
        layout = self.filters.layout
        vectors = [self.filters.mean[:, layout.normal(target)] for target in range(layout.targets)]
        return tuple(vector / np.linalg.norm(vector, axis=1, keepdims=True) for vector in vectors)
