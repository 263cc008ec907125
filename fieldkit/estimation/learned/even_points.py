"""Points that fill a unit square or cube more evenly than chance would: scrambled Sobol sequences, as tables.

They are the same numbers in every run, and only these are ever used. `scipy.stats.qmc` makes them, and takes
half a second to import, as long as everything else that an estimate needs.
"""

from __future__ import annotations

import io
from importlib import resources

import numpy as np

from fieldkit.physics.facet import FloatArray

_BITS = 30
"""The points are whole multiples of two to the power of minus this."""


def even_points(table: str) -> FloatArray:
    """Points (count, dimensions) within [0, 1), any first power of two of them evenly spread.

    ``"sobol-5"`` are 64 points of ``scipy.stats.qmc.Sobol(5, rng=numpy.random.default_rng(20170830))``,
    ``"sobol-2"`` 32 of ``Sobol(2, rng=default_rng(1))``. S. Joe and F. Y. Kuo, "Constructing Sobol sequences
    with better two-dimensional projections", SIAM Journal on Scientific Computing 30, 2008.
    """
    text = (resources.files("fieldkit") / "data" / f"{table}.csv").read_text(encoding="ascii")
    return np.loadtxt(io.StringIO(text), delimiter=",") / 2.0**_BITS
