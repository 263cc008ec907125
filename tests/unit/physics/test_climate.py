"""The usual air against what stations measure: good to its 8 K from the tropics to the polar winter."""

import numpy as np
import pytest

from fieldkit.model.site import Site
from fieldkit.physics.climate import usual_air_k
from fieldkit.weather import packaged_day

AT_NOON = "T12:00"


def celsius(site, date):
    solar_noon = np.datetime64(date + AT_NOON, "ns") - np.timedelta64(round(4 * site.longitude_deg), "m")
    return float(usual_air_k(solar_noon.astype(np.int64), site)) - 273.15


@pytest.mark.parametrize(
    ("name", "latitude", "longitude", "elevation", "date", "expected_c"),
    [
        # monthly means at 9 and 15 h, Bureau of Meteorology, stations 066062 and 014015
        ("Sydney in June", -33.86, 151.20, 39.0, "2024-06-15", 15.0),
        ("Darwin in January", -12.42, 130.89, 30.0, "2024-01-15", 30.0),
        # monthly normals 1991-2020 near noon, Japan Meteorological Agency, Tokyo (47662)
        ("Tokyo in August", 35.69, 139.75, 25.0, "2024-08-15", 30.0),
        ("Tokyo in January", 35.69, 139.75, 25.0, "2024-01-15", 8.0),
    ],
)
def test_within_its_spread_of_stations(name, latitude, longitude, elevation, date, expected_c):
    assert celsius(Site(latitude, longitude, elevation), date) == pytest.approx(expected_c, abs=8.0)


def test_alamosa_on_a_winter_day_is_as_measured():
    """NOAA SURFRAD, 2016-01-01, 2317 m: -6 to -3 degrees around noon."""
    day = packaged_day()
    noon = day.time_ns.size * 19 // 24
    usual = float(usual_air_k(day.time_ns[noon], day.site))
    assert usual == pytest.approx(day.air_temperature_k[noon], abs=4.0)
