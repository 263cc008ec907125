"""Boards held over single beds: the shade test."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.simulation.sky import SkyState

WITHIN_MIN = 0.5
"""Boards are held by hand: they come and go within a minute and not at its ends."""
HIDDEN_SKY = 0.8
"""Share of the sky that a board hides from the bed under it; light and air enter at its sides."""


@dataclass(frozen=True, slots=True)
class Board:
    """A board over the bed of that name from `begin_s` until `end_s`, seconds after the scene's origin."""

    bed: str
    begin_s: float
    end_s: float

    def over(self, sky: SkyState, time_s: FloatArray) -> SkyState:
        """Sky and air below the board at times (n,): no beam, little sky, and longwave of a board as warm as
        the air.
        """
        hidden = HIDDEN_SKY * ((time_s > self.begin_s) & (time_s <= self.end_s))
        from_board = STEFAN_BOLTZMANN * sky.air_temperature_k**4
        return replace(
            sky,
            dni_w_m2=np.where(hidden > 0.0, 0.0, sky.dni_w_m2),
            dhi_w_m2=(1.0 - hidden) * sky.dhi_w_m2,
            longwave_down_w_m2=(1.0 - hidden) * sky.longwave_down_w_m2 + hidden * from_board,
        )


def boards_in_turn(
    beds: Iterable[str], first_min: float, every_min: float, lasts_min: float
) -> tuple[Board, ...]:
    """A board over each bed in turn, the first one in the minute `first_min` of the scene; all in minutes."""
    begins = (first_min + WITHIN_MIN + every_min * number for number in itertools.count())
    return tuple(
        Board(bed, 60.0 * begin, 60.0 * (begin + lasts_min)) for bed, begin in zip(beds, begins, strict=False)
    )
