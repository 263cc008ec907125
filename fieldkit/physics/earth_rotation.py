"""How the Earth turned: UT1 and the pole's motion from the file astropy brings along, read in milliseconds.

astropy reads the same file (IERS, finals2000A) with a general reader, which takes longer
than everything else a verb does at its start. Only what a direction to the sun needs is read.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import astropy.units as u
import numpy as np
from astropy.table import QTable
from astropy.utils import iers

COLUMNS = {
    "MJD": (7, 15, u.d),
    "PM_x": (18, 27, u.arcsec),
    "PM_y": (37, 46, u.arcsec),
    "UT1_UTC": (58, 68, u.s),
}
"""First and last character of each column, and its unit, by the file's description (readme.finals2000A)."""


class EarthRotation(iers.IERS):  # type: ignore[misc]
    """UT1 - UTC and polar motion by day, measured and predicted; beyond its ends the last values hold."""

    def _check_interpolate_indices(self, *_: object) -> None:
        """A guess of UT1 beyond the table is good enough: below 0.005 degrees of sun."""


@lru_cache(maxsize=1)
def earth_rotation() -> EarthRotation:
    """The table of the file that was installed with astropy."""
    days = [line for line in Path(iers.IERS_A_FILE).read_text("ascii").splitlines() if line[58:68].strip()]
    columns = {
        name: np.array([line[begin:end] for line in days], np.float64) * unit
        for name, (begin, end, unit) in COLUMNS.items()
    }
    return EarthRotation(QTable(columns))
