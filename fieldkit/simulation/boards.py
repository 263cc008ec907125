"""Boards held over single beds: the shade test."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.simulation.sky import SkyState

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
