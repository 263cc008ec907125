import numpy as np
import pytest

from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.gusts import Gusts, von_karman


def test_spectrum_is_that_of_esdu_85020():
    """Unit variance, f S = 0.271 at its peak f L / U = 0.146, and S(0) = 4 L / U (ESDU 85020)."""
    frequency = np.geomspace(1e-8, 1e6, 20_000)
    spectrum = von_karman(frequency, 60.0)
    assert np.trapezoid(spectrum, frequency) == pytest.approx(1.0, abs=0.003)
    peak = int(np.argmax(frequency * spectrum))
    assert frequency[peak] * 60.0 == pytest.approx(0.146, abs=0.001)
    assert frequency[peak] * spectrum[peak] == pytest.approx(0.271, abs=0.001)
    assert spectrum[0] == pytest.approx(4.0 * 60.0)


def test_gusts_have_the_intensity_they_are_given():
    # in a strong wind the speed varies as the component along it; a twelfth of the variance is above the band
    time_ns = np.arange(0, 4 * 86_400, 10) * SECOND_NS
    speeds = [Gusts(seed, 0.2, 0.0).speed_m_s(time_ns, np.full(time_ns.size, 10.0)) for seed in range(3)]
    assert np.mean([np.std(speed) for speed in speeds]) == pytest.approx(2.0, rel=0.1)
    assert np.mean(speeds) == pytest.approx(10.0, rel=0.03)


def test_plumes_blow_in_calm_air():
    """The speed of two normal components of 0.5 m/s has Rayleigh's mean, 0.5 sqrt(pi / 2) = 0.627 m/s."""
    time_ns = np.arange(0, 4 * 86_400, 10) * SECOND_NS
    speeds = [Gusts(seed, 0.2, 0.5).speed_m_s(time_ns, np.zeros(time_ns.size)) for seed in range(3)]
    assert np.mean(speeds) == pytest.approx(0.627, rel=0.06)


def test_a_gust_depends_on_time_and_seed_alone():
    time_ns, mean = 1_451_674_800 * SECOND_NS + np.arange(600) * SECOND_NS, np.full(600, 3.0)
    whole = Gusts(1).speed_m_s(time_ns, mean)
    np.testing.assert_array_equal(Gusts(1).speed_m_s(time_ns[100:200], mean[:100]), whole[100:200])
    assert np.std(Gusts(2).speed_m_s(time_ns, mean) - whole) > 0.1
