"""Sunlight through the dust of Mars: direct and diffuse light of a clear day by optical depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray

# zenith angles and optical depths of the table below: its columns and rows
_ZENITH_DEG = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0])
_DEPTH = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
_ALBEDO = 0.1  # of the ground under which the table was computed
_NET_FLUX = np.array(
    [
        [0.900, 0.900, 0.900, 0.900, 0.900, 0.900, 0.900, 0.900, 0.900, 0.900],
        [0.885, 0.883, 0.882, 0.880, 0.876, 0.870, 0.857, 0.830, 0.755, 0.635],
        [0.866, 0.865, 0.860, 0.858, 0.851, 0.836, 0.813, 0.758, 0.640, 0.470],
        [0.847, 0.846, 0.841, 0.836, 0.826, 0.806, 0.774, 0.708, 0.562, 0.412],
        [0.828, 0.827, 0.821, 0.815, 0.802, 0.778, 0.740, 0.667, 0.502, 0.373],
        [0.810, 0.810, 0.802, 0.796, 0.778, 0.752, 0.708, 0.628, 0.452, 0.342],
        [0.776, 0.773, 0.766, 0.755, 0.733, 0.700, 0.646, 0.555, 0.383, 0.298],
        [0.732, 0.725, 0.717, 0.700, 0.670, 0.628, 0.560, 0.455, 0.317, 0.252],
        [0.651, 0.646, 0.633, 0.612, 0.580, 0.530, 0.460, 0.362, 0.251, 0.202],
        [0.582, 0.573, 0.558, 0.537, 0.500, 0.448, 0.378, 0.293, 0.208, 0.170],
        [0.518, 0.509, 0.492, 0.469, 0.430, 0.378, 0.316, 0.242, 0.174, 0.145],
        [0.460, 0.450, 0.434, 0.414, 0.376, 0.330, 0.273, 0.206, 0.150, 0.128],
        [0.370, 0.360, 0.347, 0.330, 0.296, 0.258, 0.212, 0.160, 0.118, 0.100],
        [0.294, 0.286, 0.275, 0.258, 0.230, 0.203, 0.166, 0.130, 0.094, 0.080],
        [0.228, 0.223, 0.215, 0.200, 0.178, 0.153, 0.130, 0.103, 0.080, 0.068],
    ]
)
"""Net flux at the ground over that above the dust, by depth and zenith angle: Table III of the reference.

Without dust nothing but the albedo is missing: the first row. Rows of the reference that are not here lie
within 4 % of straight lines between these.
"""


def dusty_sky(
    cos_zenith: ArrayLike, top_w_m2: ArrayLike, optical_depth: float
) -> tuple[FloatArray, FloatArray]:
    """Direct normal and diffuse horizontal irradiance under dust.

    Parameters
    ----------
    cos_zenith
        Cosine of the sun's zenith angle, shape (n,). [-]
    top_w_m2
        Irradiance of a plane facing the sun above the dust, (n,) or scalar. [W/m2]
    optical_depth
        Of the dust, 0 to 6: 0.3 to 0.6 in the clear season of Mars, 2 to 6 in global storms. [-]

    Returns
    -------
    DNI, ``top exp(-depth / cos_zenith)``, and DHI, what is left of the global light; shape (n,) each, zero
    with the sun below the horizon. Held from 85 degrees of zenith angle on. [W/m2]

    References
    ----------
    .. [1] J. Appelbaum and D. J. Flood, "Solar radiation on Mars", Solar Energy 45, 353-363, 1990,
       doi:10.1016/0038-092X(90)90156-7: eq. (7) and Table III, computed by J. B. Pollack for dust as seen by
       the Viking landers.
    """
    cosine = np.asarray(cos_zenith, np.float64)
    is_up = cosine > 0.0
    safe = np.where(is_up, cosine, 1.0)
    by_zenith = np.array([np.interp(optical_depth, _DEPTH, column) for column in _NET_FLUX.T])
    net = np.interp(np.degrees(np.arccos(np.minimum(safe, 1.0))), _ZENITH_DEG, by_zenith)
    beam = np.asarray(top_w_m2) * np.exp(-optical_depth / safe)
    diffuse = np.asarray(top_w_m2) * net / (1.0 - _ALBEDO) * safe - beam * safe
    return np.where(is_up, beam, 0.0), np.where(is_up, np.maximum(diffuse, 0.0), 0.0)
