"""Terrain from surface normals: slope along a drive, northerly tilt and share of sun for a planner; heights.

Slope and heading are the tilt and azimuth of `facet`. The set is that of JPL's MARSSLOPE [1]_, with the sun's
way over the day in place of its elevation at noon. Axes are east, north, up.

Heights are those of the surface whose slopes differ least from the normals on a grid: between neighbouring
cells the height changes by the mean of their slopes; least squares over all neighbours gives the heights,
also around cells without a normal [2]_. Slopes measured without error close every loop; what the surface
cannot follow is a check of the normals.

.. [1] NASA AMMOS, "Help for MARSSLOPE", VICAR documentation.
.. [2] R. T. Frankot and R. Chellappa, "A method for enforcing integrability in shape from shading
   algorithms", IEEE PAMI 10, 1988, doi:10.1109/34.3909; on grids with holes: D. T. Ghiglia and
   M. D. Pritt, "Two-dimensional phase unwrapping", Wiley 1998, chapter 5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray, IndexArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def climb_deg(normals: ArrayLike, azimuth_deg: ArrayLike) -> FloatArray:
    """Slope along a direction, such as that of a drive, of unit normals (..., 3); positive where the way
    climbs.

    `azimuth_deg` is from north, clockwise, and broadcasts to (...). In [-90, 90] for surfaces that face up.
    [degrees]
    """
    n, along = np.asarray(normals), np.radians(azimuth_deg)
    downhill = n[..., 0] * np.sin(along) + n[..., 1] * np.cos(along)
    return np.asarray(np.degrees(np.arctan2(-downhill, n[..., 2])))


def northerly_tilt_deg(normals: ArrayLike) -> FloatArray:
    """Tilt towards north: the angle of normals (..., 3) from the zenith in the meridian plane, degrees."""
    return climb_deg(normals, 180.0)


def sunlit_cosine(normals: ArrayLike, suns: ArrayLike) -> FloatArray:
    """Mean cosine of incidence (...), zero while a surface or the horizontal faces away from the sun, in [0,
    1].

    Of unit normals (..., 3) and unit vectors to the sun at even steps of time (n, 3). Times the direct normal
    irradiance, constant over the time, it is the mean direct irradiance.
    """
    rays = np.asarray(suns, np.float64)
    total = np.zeros(np.shape(normals)[:-1])
    for ray in rays[rays[:, 2] > 0.0]:  # one at a time: a map times a day does not fit the memory
        total += np.maximum(normals @ ray, 0.0)
    return np.asarray(total / len(rays))


def heights_from_normals(
    normals: FloatArray, cell_m: float, about_m: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Heights of a surface with these normals, and how far its slopes are from theirs.

    Parameters
    ----------
    normals
        Upward normals (east, north, up) of any length on a grid with north up, shape (rows, cols, 3); NaN
        where there is none.
    cell_m
        Side of a cell. [m]
    about_m
        Heights, shape (rows, cols) or a scalar, whose mean over each connected area that of the found ones
        is. [m]

    Returns
    -------
    heights_m
        Shape (rows, cols); NaN without a normal or a neighbour that has one. [m]
    misclosure_deg
        Root mean square difference between the surface's slopes from a cell to its neighbours and those of
        the normals. [degrees]
    """
    rise = np.stack([-normals[..., 0], -normals[..., 1]]) / normals[..., 2] * cell_m
    ends, steps = _steps(rise)
    number = normals[..., 0].size
    differences = _differences(ends, number)
    heights = _least_squares(differences, steps, np.broadcast_to(about_m, rise.shape[1:]).ravel())
    off = differences @ heights - steps
    count = np.bincount(ends.ravel(), minlength=number)
    with np.errstate(invalid="ignore"):
        square = np.bincount(ends.ravel(), np.tile(off**2, 2), minlength=number) / count
    misclosure = np.degrees(np.arctan(np.sqrt(square) / cell_m))
    heights[count == 0] = np.nan
    return heights.reshape(rise.shape[1:]), misclosure.reshape(rise.shape[1:])


def _steps(rise_m: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Numbers of neighbouring cells (2, n), and the rise from the first to the second in metres (n,)."""
    east, north = rise_m
    cells = np.arange(east.size).reshape(east.shape)
    across = 0.5 * (east[:, :-1] + east[:, 1:])
    down = -0.5 * (north[:-1] + north[1:])  # rows run southwards
    ends = np.hstack([[cells[:, :-1].ravel(), cells[:, 1:].ravel()], [cells[:-1].ravel(), cells[1:].ravel()]])
    steps = np.concatenate([across.ravel(), down.ravel()])
    has_step = np.isfinite(steps)
    return ends[:, has_step], steps[has_step]


def _differences(ends: IndexArray, count: int) -> csr_array:
    """Matrix that takes heights to their steps."""
    from scipy.sparse import csr_array

    steps = ends.shape[1]
    signs = np.repeat([-1.0, 1.0], steps)
    return csr_array((signs, (np.tile(np.arange(steps), 2), ends.ravel())), shape=(steps, count))


def _least_squares(differences: csr_array, steps: FloatArray, about: FloatArray) -> FloatArray:
    """Heights whose steps are nearest, of the mean of others over each connected area: one cell is held."""
    from scipy.sparse import csc_array
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import spsolve

    equations, right_side = csc_array(differences.T @ differences), differences.T @ steps
    _, area = connected_components(equations, directed=False)
    _, first = np.unique(area, return_index=True)
    free = np.setdiff1d(np.arange(area.size), first)
    heights = np.zeros(area.size)
    if free.size:
        heights[free] = spsolve(equations[free][:, free], right_side[free])
    above = np.bincount(area, about - heights) / np.bincount(area)
    return np.asarray(heights + above[area])
