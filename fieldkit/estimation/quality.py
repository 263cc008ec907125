"""How far an estimate may be trusted: noise that is really there, chi-square, kelvin per degree.

The noise level comes from second differences, which a slope, a drift or a passing hour
cannot feign. A small chi-square does not mean a small error: a smooth wrong world fits a
smooth wrong slope; only the stated doubts speak about that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from fieldkit.physics.facet import FloatArray, normal

ALARM_PROBABILITY = 0.01
"""Chance that chi-square calls a good window a bad one."""
MIN_DIFFERENCES = 8
LOWEST_COS_INCIDENCE = 0.03
"""Rows whose predicted cosine of incidence is lower count as in the bed's own shade."""
SHADE_SIGMAS = 2.0


def noise_ratio(residuals: ArrayLike) -> float:
    """Variance of standardised residuals (n,) by their second differences; 1.0 when too few.

    ``mean (r[k-1] - 2 r[k] + r[k+1])**2 / 6``. Below 1, or above it by less than chance
    explains (95 %), the stated noise stands: 1.0.
    """
    values = np.asarray(residuals, np.float64)
    bends = np.diff(values, 2)
    if bends.size < MIN_DIFFERENCES:
        return 1.0
    ratio = float(np.mean(bends**2)) / 6.0
    # neighbouring second differences share samples: 18/35 of their number is independent
    freedom = bends.size * 18.0 / 35.0
    return ratio if ratio > float(chdtri(freedom, 0.05)) / freedom else 1.0


def chi_square_limit(freedom: int) -> float:
    """Reduced chi-square that noise alone exceeds once in a hundred windows."""
    return float(chdtri(freedom, ALARM_PROBABILITY)) / freedom


def kelvin_per_degree(tilt_deg: float, azimuth_deg: float, lamp: FloatArray, y_per_kelvin: float) -> float:
    """Change of surface temperature per degree of tilt at a slope under a lamp (3,), K per degree."""
    steeper = normal(tilt_deg + 90.0, azimuth_deg)  # the unit vector along growing tilt
    return float(np.radians(1.0) * (steeper @ lamp) / y_per_kelvin)


def sunlit(y: FloatArray, sigma: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Rows bright enough to be an equation: in its own shade a bed only says ``n . s < 0``."""
    return np.asarray(y >= SHADE_SIGMAS * sigma)
