"""Which of the two branches is meant: the tilt limit decides, then the prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.normal import Branches, Misfit
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth

_ROUNDING_DEG = 1e-3
"""A slope on the very limit must not be ruled out by rounding."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The normal to believe (..., 3), its misfit, and the other branch where it keeps the limit, else NaN."""

    best: FloatArray
    misfit: FloatArray
    other: FloatArray
    other_misfit: FloatArray


def choose(misfit: Misfit, branches: Branches, tilt_limit_deg: float) -> Choice:
    """Choose between the branches, given that the tilt does not exceed the limit.

    In 20 minutes both often fit equally well. Then the prior decides, uniform in tilt and
    azimuth up to the limit: per solid angle it falls as 1 / sin(tilt), so of two equal fits
    the flatter one is believed. Where both branches are steeper, the least misfit on the
    limit itself is taken: its misfit tells whether the limit is to blame.
    """
    normals = np.stack([branches.first, branches.second])
    misfits = np.stack([branches.first_misfit, branches.second_misfit])
    tilts = tilt_azimuth(normals)[0]
    allowed = tilts <= tilt_limit_deg + _ROUNDING_DEG
    price = misfits + 2.0 * np.log(np.sin(np.radians(np.clip(tilts, 0.1, 90.0))))
    price = np.where(allowed, price, np.inf)
    swap = price[1] < price[0]
    swapped = swap[..., np.newaxis]
    best, other = np.where(swapped, normals[::-1], normals)
    misfit_best, misfit_other = np.where(swap, misfits[::-1], misfits)
    lone = branches.merged | ~allowed.all(axis=0)
    other = np.where(lone[..., np.newaxis], np.nan, other)
    steep = ~allowed.any(axis=0) & np.isfinite(misfits[0])
    if np.any(steep):
        edge, edge_misfit = _on_limit(misfit, tilt_limit_deg, steep)
        best = np.where(steep[..., np.newaxis], edge, best)
        misfit_best = np.where(steep, edge_misfit, misfit_best)
    return Choice(best, misfit_best, other, np.where(lone, np.nan, misfit_other))


def _on_limit(
    misfit: Misfit, tilt_limit_deg: float, wanted: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Least misfit among normals of the limit's tilt, for the slopes wanted (NaN for the others)."""
    rim = normal(tilt_limit_deg, np.arange(0.0, 360.0, 0.1))
    best, least = np.full((*wanted.shape, 3), np.nan), np.full(wanted.shape, np.nan)
    # in parts, so that many slopes do not fill the memory
    for part in np.array_split(np.argwhere(wanted), 1 + int(wanted.sum()) // 1000):
        index = tuple(part.T)
        H = misfit.H if misfit.H.ndim == 2 else misfit.H[index]
        values = np.einsum("ri,...ij,rj->...r", rim, H, rim, optimize=True)
        values = values - 2.0 * misfit.b[index] @ rim.T + np.asarray(misfit.c)[index][..., np.newaxis]
        best[index], least[index] = rim[np.argmin(values, axis=-1)], values.min(axis=-1)
    return best, least
