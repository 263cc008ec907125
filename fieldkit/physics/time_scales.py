"""Terrestrial time, in which ephemerides count, from UTC."""

from __future__ import annotations

import warnings

import erfa  # type: ignore[import-untyped]
import numpy as np

from fieldkit.model.units import DAY_S
from fieldkit.physics.facet import FloatArray

EPOCH_JD, MJD_0_JD, J2000_JD = 2440587.5, 2400000.5, 2451545.0
"""Julian dates of 1970-01-01, of modified Julian day 0 and of J2000."""


def tt_of_utc(unix_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Julian date in terrestrial time, in two parts, of UTC seconds since 1970; shape of `unix_s` each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # of years whose leap seconds are not known yet
        day, fraction = erfa.taitt(*erfa.utctai(EPOCH_JD + np.floor(unix_s / DAY_S), unix_s % DAY_S / DAY_S))
    return np.asarray(day), np.asarray(fraction)


def days_of_tt(unix_s: FloatArray) -> FloatArray:
    """Days of terrestrial time since J2000 of UTC seconds since 1970; same shape."""
    day, fraction = tt_of_utc(unix_s)
    return np.asarray(day - J2000_JD + fraction)
