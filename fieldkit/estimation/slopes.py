"""From the bins of a session to the slopes at its last minute: one pure function for live and batch.

`slopes` looks back over the settings' window (`window`), whose minutes become rows
(`balance`) that are solved by the method asked for, and says how far the answer may be
trusted. During a cloud or a shadow it answers with what was known just before, so an
estimate is held, not reset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.answers import WORKED_OUT
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.window import Field, Window
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, SlopeState


def slopes(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    """Slope of every target at the last minute of the history, in the order of the regions."""
    field = Field(tuple(regions))
    clouded = (history.flags & Quality.CLOUD) != 0
    last = len(history)
    if settings.model == "paper" and last and clouded[-1]:
        return _held(history, field, ~clouded, settings)
    window = Window(history, last, field, settings)
    answers = window.told_of_drift([window.estimate(index) for index in range(field.targets.size)])
    return tuple(
        _shaded(history, field, index, settings) if answer.flags & Quality.SHADED else answer
        for index, answer in enumerate(answers)
    )


def _held(
    history: History, field: Field, clear: NDArray[np.bool_], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    last = int(np.flatnonzero(clear)[-1]) + 1 if clear.any() else 0
    window = Window(history, last, field, settings)
    now, flags = int(history.time_ns[-1]), Quality(int(history.flags[-1]))
    ago = (now - history.time_ns[last - 1]) / 60e9 if last else 0.0
    held = []
    for index in range(field.targets.size):
        answer = window.estimate(index)
        answer = replace(answer, time_ns=now, flags=answer.flags | flags)
        if answer.state in WORKED_OUT:
            reason = f"the light is unsteady; estimate of {ago:.0f} min ago"
            answer = replace(answer, state=SlopeState.HELD_CLOUD, reason=reason)
        held.append(answer)
    return tuple(held)


def _shaded(history: History, field: Field, index: int, settings: EstimatorSettings) -> SlopeEstimate:
    """The last estimate before this region alone lost its sun."""
    column = field.targets[index]
    lit = (history.region_flags[:, column] & Quality.SHADED) == 0
    last = int(np.flatnonzero(lit)[-1]) + 1 if lit.any() else 0
    held = Window(history, last, field, settings).estimate(index)
    return replace(
        held,
        time_ns=int(history.time_ns[-1]),
        state=SlopeState.SHADED,
        flags=held.flags | Quality.SHADED,
        reason="this region alone lost its sun",
    )
