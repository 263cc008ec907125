import numpy as np
import pytest

from fieldkit.physics.daylight import air_mass, clear_sky, extraterrestrial

NOON = np.array(["2017-08-30T03:00"], dtype="datetime64[ns]").astype(np.int64)


def test_air_mass_of_kasten_and_young():
    # Kasten and Young 1989, table II: altitudes 90, 30, 10, 5, 0 degrees
    cosines = np.cos(np.radians([0.0, 60.0, 80.0, 85.0, 90.0]))
    np.testing.assert_allclose(air_mass(cosines), [1.0, 1.9943, 5.5841, 10.3058, 37.9196], rtol=2e-3)


@pytest.mark.parametrize("elevation", [0.0, 9.0, 2317.0])
@pytest.mark.parametrize("turbidity", [2.0, 3.5, 6.0])
def test_clear_sky_agrees_with_pvlib(elevation, turbidity):
    clearsky = pytest.importorskip("pvlib.clearsky", reason="pvlib comes with the [lab] extra")
    zenith = np.array([5.0, 27.0, 60.0, 80.0, 87.0])
    cosines = np.cos(np.radians(zenith))
    theirs = clearsky.ineichen(
        zenith, air_mass(cosines, elevation), turbidity, elevation, float(extraterrestrial(NOON)[0])
    )
    direct, diffuse = clear_sky(cosines, NOON, elevation, turbidity)
    np.testing.assert_allclose(direct, theirs["dni"], rtol=1e-9)
    np.testing.assert_allclose(diffuse, theirs["dhi"], rtol=1e-9)


def test_night_is_dark():
    direct, diffuse = clear_sky([-0.1, -1.0], NOON)
    assert not direct.any()
    assert not diffuse.any()
