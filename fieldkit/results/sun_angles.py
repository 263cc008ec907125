"""Position of the sun at given moments, and its angle of incidence on facets (the paper's Table 2)."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np

from fieldkit.model.clock import as_moment, utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Site, as_site
from fieldkit.physics.bodies import body_of
from fieldkit.physics.facet import incidence_deg, normal, tilt_azimuth
from fieldkit.physics.sun import exact_vectors, refract, solar_time_h


def sun(
    site: Site | Sequence[float],
    at: datetime | str | Sequence[datetime | str],
    facets: Sequence[tuple[float, float]] = (),
) -> list[dict[str, Any]]:
    """Where the sun stands, and at what angle it falls on facets: one row for each time.

    Parameters
    ----------
    site
        A `Site`, or latitude [degrees north], longitude [degrees east] and elevation [m].
    at
        Times with their zone, or ISO 8601.
    facets
        Tilt and azimuth of surfaces. [degrees]

    Raises
    ------
    ConfigError
        A time has no zone, or the site is none.

    Examples
    --------
    >>> (row,) = fieldkit.sun((35.558675, 139.395232, 9.0), "2017-08-30T12:00+09:00", [(10.0, 180.0)])
    >>> round(row["sun_zenith_deg"], 1), round(row["facets"][0]["incidence_deg"], 1)
    (26.9, 17.1)
    """
    moments = [at] if isinstance(at, datetime | str) else at
    facets = checked_facets(facets) if facets else ()
    return sun_rows(as_site(site), [as_moment(time) for time in moments], facets)


def checked_facets(facets: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Tilts of 0 to 90° and azimuths of -360 to 360°; raises `ConfigError` for others, or for none."""
    pairs = tuple((float(tilt), float(azimuth)) for tilt, azimuth in facets)
    wrong = [facet for facet in pairs if not (0.0 <= facet[0] <= 90.0 and -360.0 <= facet[1] <= 360.0)]
    if wrong or not pairs:
        what = "{}°/{}° is not a facet".format(*wrong[0]) if wrong else "there is no facet"
        raise ConfigError(
            what, place=Argument("facets"), fix="give pairs of tilt, 0 to 90°, and azimuth, 0 to 360°"
        )
    return pairs


def sun_rows(
    site: Site, moments: Sequence[datetime], facets: Sequence[tuple[float, float]] = ()
) -> list[dict[str, Any]]:
    """One row per moment: true solar time, the sun's angles and one incidence angle per facet, degrees."""
    geometric = exact_vectors(np.array([utc_ns(moment) for moment in moments]) * 1e-9, site)
    lifted_by_air = refract(geometric, site.elevation_m) if body_of(site).refracts else geometric
    suns = (geometric, lifted_by_air)
    solar_h = solar_time_h([utc_ns(moment) for moment in moments], site)
    (zenith, azimuth), (apparent, bearing) = (tilt_azimuth(sun) for sun in suns)
    # the last axis counts facets, so that no facet at all gives an empty table and not an error
    normals = normal([tilt for tilt, _ in facets], [turn for _, turn in facets]).reshape(-1, 3)
    angles, lifted = (incidence_deg(normals, sun) for sun in suns)
    return [
        {
            "time": moment.isoformat(),
            "solar_time_h": float(solar_h[row]),
            "sun_zenith_deg": float(zenith[row]),
            "sun_azimuth_deg": float(azimuth[row]),
            "sun_zenith_refracted_deg": float(apparent[row]),
            "sun_azimuth_refracted_deg": float(bearing[row]),
            "facets": [
                {
                    "tilt_deg": tilt,
                    "azimuth_deg": turn,
                    "incidence_deg": float(angles[index, row]),
                    "incidence_refracted_deg": float(lifted[index, row]),
                }
                for index, (tilt, turn) in enumerate(facets)
            ],
        }
        for row, moment in enumerate(moments)
    ]
