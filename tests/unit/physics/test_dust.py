"""Light under dust against rows of the published table that the code does not carry."""

import numpy as np
import pytest

from fieldkit.model.site import Site
from fieldkit.physics.bodies import EARTH, MARS, MOON
from fieldkit.physics.daylight import clear_day, clear_sky, extraterrestrial
from fieldkit.physics.dust import dusty_sky

# J. Appelbaum and D. J. Flood, Solar Energy 45, 1990, Table III: optical depth, zenith angle, net flux over
# that above the dust, for an albedo of 0.1.
TABLE_III = [
    (0.6, 30.0, 0.775),
    (0.8, 50.0, 0.675),
    (0.9, 0.0, 0.745),
    (0.6, 60.0, 0.677),
    (1.8, 40.0, 0.531),
    (0.6, 85.0, 0.318),
    (0.8, 80.0, 0.360),
    (1.2, 85.0, 0.230),
]


@pytest.mark.parametrize(("depth", "zenith_deg", "net"), TABLE_III)
def test_direct_and_diffuse_light_add_up_to_the_published_flux(depth, zenith_deg, net):
    cosine = np.cos(np.radians(zenith_deg))
    dni, dhi = dusty_sky(np.array([cosine]), 590.0, depth)
    assert dni[0] == pytest.approx(590.0 * np.exp(-depth / cosine))
    assert (dni[0] * cosine + dhi[0]) * 0.9 / (590.0 * cosine) == pytest.approx(net, rel=0.03)


def test_a_low_sun_through_thin_dust_has_the_published_flux():
    """Table III has 0.470 at an optical depth of 0.2 and 85 degrees; half of its neighbours' sum is 0.524."""
    cosine = np.cos(np.radians(85.0))
    dni, dhi = dusty_sky(np.array([cosine]), 590.0, 0.2)
    assert (dni[0] * cosine + dhi[0]) * 0.9 / (590.0 * cosine) == pytest.approx(0.470, rel=1e-6)


def test_without_dust_all_light_is_direct_and_at_night_there_is_none():
    dni, dhi = dusty_sky(np.array([1.0, 0.3, -0.1]), 1361.0, 0.0)
    assert dni == pytest.approx([1361.0, 1361.0, 0.0])
    assert dhi == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_the_sunlight_above_mars_is_that_of_its_perihelion_and_aphelion():
    # NASA's Mars fact sheet: 1.3814 au at perihelion (2022-06-21), 1.6660 au at aphelion
    # (2023-05-30); 1361 W/m2 at 1 au
    days = np.array(["2022-06-21", "2023-05-30"], "datetime64[ns]").astype(np.int64)
    assert extraterrestrial(days, MARS) == pytest.approx([713.2, 490.3], rel=2e-3)
    assert extraterrestrial(int(days[0]), MOON) == pytest.approx(extraterrestrial(int(days[0])), rel=0.01)
    assert extraterrestrial(days, EARTH) == pytest.approx(extraterrestrial(days))


def test_a_clear_day_is_that_of_the_sites_world():
    time_ns, cosine = np.array([1_700_000_000_000_000_000]), np.array([0.7])
    on_earth = clear_day(cosine, time_ns, Site(0.0, 0.0, 9.0), turbidity=3.0)
    assert on_earth == clear_sky(cosine, time_ns, 9.0, 3.0)
    on_moon = clear_day(cosine, time_ns, Site(0.0, 0.0, body="moon"), turbidity=3.0)
    assert on_moon[0] == pytest.approx(extraterrestrial(time_ns, MOON))
