"""Distribution functions, by scipy, which is imported when the first one is called.

It takes as long to import as everything else that ``fieldkit check`` needs, and a command that finds its
slopes known calls none of these.
"""

from __future__ import annotations

import numpy as np

from fieldkit.model.arrays import FloatArray


def normal_cdf(value: FloatArray | float) -> FloatArray:
    """Probability that a standard normal variable lies below a value, of any shape."""
    from scipy.special import ndtr

    return np.asarray(ndtr(np.asarray(value)))


def normal_quantile(probability: FloatArray | float) -> FloatArray:
    """Value that a standard normal variable lies below with a probability in [0, 1], of any shape."""
    from scipy.special import ndtri

    return np.asarray(ndtri(np.asarray(probability)))


def chi_square_exceeded(freedom: float, probability: float) -> float:
    """Value that chi-square with `freedom` > 0 degrees of freedom exceeds with a probability in (0, 1)."""
    from scipy.special import chdtri

    return float(chdtri(freedom, probability))
