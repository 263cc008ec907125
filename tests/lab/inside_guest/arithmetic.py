"""Arithmetic in the guest, to compare with this computer's."""

from __future__ import annotations

import numpy as np


def order(values: list[float]) -> list[int]:
    """The places of the values in ascending order, by numpy's vectorised sort."""
    return [int(place) for place in np.argsort(values)]
