"""The sun over Mars and the Moon against printed examples, a published ephemeris and another algorithm."""

from datetime import UTC, datetime

import numpy as np
import pvlib
import pytest
from astropy.coordinates import get_body_barycentric
from astropy.time import Time

from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.physics.bodies import BODIES, MARS, MOON, body_of
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.subsolar import mars_subsolar, moon_subsolar
from fieldkit.physics.sun import exact_vectors, solar_time_h, sun_angles, sun_vectors

LAST_DIGIT = 1.0e-5
"""One unit of the last digit that Mars24 prints; it rounds some values and cuts others off."""

# "Mars24 Sunclock: Algorithm and Worked Examples", NASA GISS, steps B-1, B-4, B-5, C-1, C-2, C-5 (west) and
# D-2: 2000-01-06 00:00:00 UTC and 2004-01-03 13:46:31 UTC, the landing of Spirit: UTC seconds, solar
# longitude, equation of time, mean solar time of the prime meridian, distance.
MARS24 = [
    (947_116_800, 277.18758, -5.18774, 23.99425, 1.39358),
    (1_073_137_591, 327.32416, -12.77553, 13.16537, None),
]

# Hourly "Moon Phase and Libration" tables (Slon, Slat) of NASA's Scientific Visualization Studio, from the
# JPL ephemeris DE421: svs.gsfc.nasa.gov/4768 for 2020, 4955 for 2022, and those of 2024 and 2026.
MOON_SUBSOLAR = [
    ("2020-01-01T00", 114.557, -0.045),
    ("2020-06-28T14", 85.600, 0.213),
    ("2020-06-30T00", 68.296, 0.261),
    ("2020-07-02T00", 43.887, 0.331),
    ("2020-07-04T00", 19.497, 0.402),
    ("2021-01-01T00", -27.058, -0.567),
    ("2022-12-26T12", 140.408, -1.219),
    ("2022-12-28T00", 122.141, -1.252),
    ("2022-12-31T23", 74.007, -1.347),
    ("2024-01-01T00", -55.867, -1.554),
    ("2026-01-01T00", 32.520, -1.346),
]


@pytest.mark.parametrize("printed", MARS24)
def test_the_worked_examples_of_mars24_hold_to_all_printed_digits(printed):
    unix_s, ls_deg, time_deg, mean_h, distance_au = printed
    declination, longitude, distance = mars_subsolar(np.array([float(unix_s)]))
    sine = np.sin(np.radians(declination)) / 0.42565  # step D-1: the sine of the obliquity
    assert 360.0 + np.degrees(np.arcsin(sine)) == pytest.approx(ls_deg, abs=1.05 * LAST_DIGIT)
    below_deg = (180.0 - 15.0 * mean_h - time_deg) % 360.0
    assert longitude % 360.0 == pytest.approx(below_deg, abs=9.0 * LAST_DIGIT)
    assert distance_au is None or distance == pytest.approx(distance_au, abs=1.05 * LAST_DIGIT)


def test_true_solar_time_on_mars_is_that_of_mars24():
    meridian, spirit = Site(0.0, 0.0, body="mars"), Site(-14.640, 175.298, body="mars")
    assert solar_time_h(947_116_800 * 10**9, meridian) == pytest.approx(23.64840, abs=LAST_DIGIT)
    assert solar_time_h(1_073_137_591 * 10**9, spirit) == pytest.approx(0.00020, abs=LAST_DIGIT)


def iau_mars_subsolar(unix_s):
    """Planetocentric subsolar point by astropy's ephemeris and the rotation of the IAU's report of 2009."""
    time = Time(unix_s, format="unix")
    sun, mars = (get_body_barycentric(name, time, ephemeris="builtin") for name in ("sun", "mars"))
    towards = (sun - mars).xyz.to_value("au").T
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, np.newaxis]
    days = time.tdb.jd - 2451545.0
    ra, dec = np.radians(317.68143 - 0.1061 * days / 36525), np.radians(52.88650 - 0.0609 * days / 36525)
    pole = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    node = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=-1)
    along = np.einsum("ij,ij->i", towards, node)
    across = np.einsum("ij,ij->i", towards, np.cross(pole, node))
    longitude = np.degrees(np.arctan2(across, along)) - (176.630 + 350.89198226 * days)
    return np.degrees(np.arcsin(np.einsum("ij,ij->i", towards, pole))), longitude, distance


def test_mars_agrees_with_an_ephemeris_and_the_iau_rotation_at_a_hundred_times():
    unix_s = np.random.default_rng(1).uniform(9.46e8, 1.79e9, 100)
    declination, longitude, distance = iau_mars_subsolar(unix_s)
    found_declination, found_longitude, found_distance = mars_subsolar(unix_s)
    apart = (found_longitude - longitude + 180.0) % 360.0 - 180.0
    assert np.abs(apart).max() < 0.01
    assert np.abs(found_declination - declination).max() < 0.005
    assert np.abs(found_distance / distance - 1.0).max() < 2e-4


@pytest.mark.parametrize(("when", "longitude_deg", "latitude_deg"), MOON_SUBSOLAR)
def test_the_point_of_the_moon_below_the_sun_is_that_of_jpl(when, longitude_deg, latitude_deg):
    unix_s = datetime.fromisoformat(when).replace(tzinfo=UTC).timestamp()
    latitude, longitude, _ = moon_subsolar(np.array([unix_s]))
    assert longitude[0] == pytest.approx(longitude_deg, abs=0.05)
    assert latitude[0] == pytest.approx(latitude_deg, abs=0.05)


@pytest.mark.parametrize("body", ["mars", "moon"])
def test_the_sun_stands_overhead_at_the_point_below_it(body):
    unix_s = np.array([1.6e9])
    latitude, longitude, _ = BODIES[body].subsolar(unix_s)
    zenith, _ = tilt_azimuth(exact_vectors(unix_s, Site(float(latitude[0]), float(longitude[0]), body=body)))
    assert zenith[0] < 1e-5
    north = Site(float(latitude[0]) + 30.0, float(longitude[0]), body=body)
    zenith, azimuth = tilt_azimuth(exact_vectors(unix_s, north))
    assert (zenith[0], azimuth[0]) == pytest.approx((30.0, 180.0), abs=1e-4)
    east = Site(0.0, float(longitude[0]) + 40.0, body=body)
    assert tilt_azimuth(exact_vectors(unix_s, east))[1][0] > 180.0  # the afternoon: the sun is in the west


@pytest.mark.parametrize("body", ["mars", "moon"])
def test_the_interpolated_sun_is_the_exact_one_and_is_not_refracted(body):
    site = Site(20.0, 77.0, body=body)
    time_ns = np.arange(1_700_000_000, 1_700_080_000, 777) * 10**9
    exact = exact_vectors(time_ns * 1e-9, site)
    assert np.abs(sun_vectors(time_ns, site, refraction=True) - exact).max() < 1e-9


def test_the_sun_crosses_half_a_degree_of_the_moons_sky_in_an_hour():
    hour = np.array([1_700_000_000, 1_700_003_600]) * 10**9
    first, second = solar_time_h(hour, Site(0.0, 0.0, body="moon"))
    assert (second - first) * 15.0 == pytest.approx(0.508, abs=0.01)


def test_a_body_without_a_model_is_named_with_those_that_have_one():
    with pytest.raises(ConfigError, match="'venus'") as found:
        body_of(Site(0.0, 0.0, body="venus"))
    assert str(found.value.fix).endswith(", ".join(BODIES))
    with pytest.raises(ConfigError):
        sun_angles(0, Site(0.0, 0.0, body="venus"))


def test_sunlight_above_the_air_has_the_lumens_per_watt_of_its_standard_spectrum():
    """ASTM G173, extraterrestrial, to 4 um; the whole of it is 1366.1 W/m2 (ASTM E490)."""
    spectrum = pvlib.spectrum.get_reference_spectra()["extraterrestrial"]
    nm = np.asarray(spectrum.index, np.float64)
    # CIE 1931 V(lambda), C. Wyman et al., JCGT 2(2), 2013
    lobes = ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1))
    eye = sum(a * np.exp(-0.5 * ((nm - m) / np.where(nm < m, low, high)) ** 2) for a, m, low, high in lobes)
    lux = 683.0 * np.trapezoid(spectrum.to_numpy() * eye, nm)
    for body in (MARS, MOON):
        assert body.beam_lm_w == pytest.approx(lux / 1366.1, rel=0.01)
        assert body.sky_lm_w == body.beam_lm_w
