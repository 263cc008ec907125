"""What a cloudless sky would deliver: for planning and for the simulation study.

Ineichen and Perez's model with the Linke turbidity given by the user: about 2 in clear
mountain winter, 3 rural, 4-5 a humid summer near a city. A plan, never a measurement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.physics.facet import FloatArray
from fieldkit.physics.sky import extraterrestrial


def clear_sky(
    cos_zenith: ArrayLike, time_ns: ArrayLike, elevation_m: float = 0.0, linke_turbidity: float = 3.0
) -> tuple[FloatArray, FloatArray]:
    """Direct normal and diffuse horizontal irradiance of a cloudless sky, W/m2, (n,) each.

    Zero with the sun down. P. Ineichen and R. Perez, "A new airmass independent
    formulation for the Linke turbidity coefficient", Solar Energy 73, 151-157, 2002.
    """
    cosine = np.asarray(cos_zenith, np.float64)
    up = cosine > 0.0
    safe = np.where(up, cosine, 1.0)
    top = extraterrestrial(time_ns)
    mass = air_mass(safe, elevation_m)
    f1, f2 = np.exp(-elevation_m / 8000.0), np.exp(-elevation_m / 1250.0)
    cg1, cg2 = 5.09e-5 * elevation_m + 0.868, 3.92e-5 * elevation_m + 0.0387
    total = cg1 * top * safe * np.exp(-cg2 * mass * (f1 + f2 * (linke_turbidity - 1.0)))
    beam = (0.664 + 0.163 / f1) * top * np.exp(-0.09 * mass * (linke_turbidity - 1.0))
    # the beam cannot leave less diffuse light than the clearest sky has
    most = total / safe * (1.0 - (0.1 - 0.2 * np.exp(-linke_turbidity)) / (0.1 + 0.882 / f1))
    beam = np.minimum(beam, np.maximum(most, 0.0))
    return np.where(up, beam, 0.0), np.where(up, total - beam * safe, 0.0)


def air_mass(cos_zenith: ArrayLike, elevation_m: float = 0.0) -> FloatArray:
    """Air mass corrected for the pressure at the site, sun above the horizon.

    F. Kasten and A. T. Young, "Revised optical air mass tables and approximation formula",
    Applied Optics 28, 4735-4738, 1989.
    """
    zenith = np.degrees(np.arccos(np.clip(cos_zenith, -1.0, 1.0)))
    relative = 1.0 / (np.cos(np.radians(zenith)) + 0.50572 * (96.07995 - zenith) ** -1.6364)
    pressure = (1.0 - 2.25577e-5 * elevation_m) ** 5.25588
    return np.asarray(relative * pressure)
