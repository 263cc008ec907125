"""One instant's component along the sun: geometry, region, two slopes that fit, what it must not claim."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.instant import along_sun
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.physics.terrain import climb_deg
from tests.harness.papers_field import SITE, temperatures_k, utc_ns
from tests.harness.pixels import sums_of_frames

AFTERNOON_NS = utc_ns("2017-08-30T06:00")
LOW, HIGH = normal(60.0, 200.0), normal(25.0, 200.0)
PAPER = EstimatorSettings(model="paper")
NO_SD = np.array(1e-6)


def test_a_slope_that_faces_the_sun_or_away_from_it_is_found_exactly():
    for tilt in (-20.0, -5.0, 0.0, 10.0, 25.0):
        found = along_sun(LOW, normal(tilt, 200.0) @ LOW, NO_SD, PAPER)
        assert found.tilt_deg == pytest.approx(tilt, abs=1e-6)
        assert found.resolved
        assert found.azimuth_deg == pytest.approx(200.0)


def test_a_longer_design_vector_changes_nothing():
    """Sky light makes the full model's design vector longer or shorter than the sun's."""
    one = along_sun(1.3 * LOW, 1.3 * np.array(0.6), 1.3 * np.array(0.02), PAPER)
    other = along_sun(LOW, np.array(0.6), np.array(0.02), PAPER)
    for name in ("tilt_deg", "low_deg", "high_deg"):
        assert float(getattr(one, name)) == pytest.approx(float(getattr(other, name)))


def test_regions_hold_slopes_of_the_prior_that_lean_across_too():
    """Truths and noise as stated: normals of 0.25 (sd of a horizontal component), cosines of 0.02."""
    random = np.random.default_rng(5)
    east, north = PAPER.prior.normal_horizontal_sd * random.standard_normal((2, 4000))
    kept = np.hypot(east, north) < np.sin(np.radians(PAPER.tilt_limit_deg))
    truths = np.column_stack([east, north, np.sqrt(np.maximum(1.0 - east**2 - north**2, 0.0))])[kept]
    cosine = truths @ LOW + 0.02 * random.standard_normal(len(truths))
    found = along_sun(LOW, cosine, np.full(len(truths), 0.02), PAPER)
    along = climb_deg(truths, 200.0 + 180.0)
    inside = (found.low_deg <= along) & (along <= found.high_deg)
    assert 0.88 < inside[np.isfinite(found.tilt_deg)].mean() < 0.97
    # a region without leans would miss half of them
    assert np.nanmedian(along - found.tilt_deg) > 0.5


def test_under_a_high_sun_the_slope_beyond_it_belongs_to_the_region():
    found = along_sun(HIGH, normal(20.0, 200.0) @ HIGH, np.array(0.01), PAPER)
    assert not found.resolved
    assert found.low_deg < 20.0 < 30.0 < found.high_deg <= 45.0


def test_what_no_slope_gives_is_no_number():
    warmer, shaded, steeper = (1.2, 0.01, normal(50.0, 20.0) @ LOW)
    for cosine in (warmer, shaded, steeper, np.nan):
        found = along_sun(LOW, np.array(cosine), np.array(0.01), PAPER)
        assert np.isnan([found.tilt_deg, found.low_deg, found.high_deg]).all()
        assert not found.resolved


def minute(time_ns: int, *normals, flags: int = 0) -> History:
    """One minute of surfaces by the paper's eq. (7), the first of them level."""
    sun = sun_vectors(np.array([time_ns]), SITE)
    kelvin = temperatures_k(np.array([VERTICAL, *normals]), sun[0])
    times = np.array([time_ns // 60_000_000_000]), np.array([time_ns])
    return History(*times, sun, kelvin[np.newaxis], np.array([800.0]), flags=np.array([flags]))


def estimate(history: History, settings: EstimatorSettings, azimuth_deg: float = float("nan")):
    flat = Region("flat", RegionKind.REFERENCE, ((0, 0),), 0.0, 0.0)
    bed = Region("bed", RegionKind.TARGET, ((0, 0),), azimuth_deg=azimuth_deg)
    (found,) = SlopeChain((flat, bed), settings).at(history).slopes
    return found


@pytest.mark.parametrize("model", ["paper", "full", "learned"])
def test_a_minute_gives_the_component_and_says_what_is_missing(model):
    """A slope of 12 degrees towards the afternoon's sun at 251.59 degrees (SPA), from temperatures."""
    found = estimate(minute(AFTERNOON_NS, normal(12.0, 251.59)), EstimatorSettings(model=model))
    assert found.state is SlopeState.TOO_FEW
    assert np.isnan(found.tilt_deg)
    assert found.sun_azimuth_deg == pytest.approx(251.590, abs=0.003)
    if model == "paper":
        assert found.along_sun_deg == pytest.approx(12.0, abs=0.001)
    assert found.along_sun_low_deg < 12.0 < found.along_sun_high_deg
    assert "towards 252°" in found.reason


def test_a_cloud_a_known_azimuth_and_a_night_give_none():
    bed = normal(12.0, 251.59)
    cloud = estimate(minute(AFTERNOON_NS, bed, flags=int(Quality.CLOUD)), EstimatorSettings(model="full"))
    known = estimate(minute(AFTERNOON_NS, bed), replace(PAPER, azimuth="known"), 251.59)
    night = estimate(minute(AFTERNOON_NS + 6 * 3_600_000_000_000, bed), PAPER)
    assert np.isnan([one.along_sun_deg for one in (cloud, known, night)]).all()


def test_a_pixel_has_the_component_and_the_region_of_its_region():
    bed = normal(12.0, 230.0)
    history = minute(AFTERNOON_NS, bed)
    settings = replace(PAPER, exchange_sd=0.0)
    of_region = estimate(history, settings)
    level_k, bed_k = history.temperature_k[0]
    sums = sums_of_frames([np.array([[bed_k]])], [level_k], history.sun, settings.noise_k)
    of_pixel = sums.along_sun(VERTICAL, settings)
    pixel = [float(one[0, 0]) for one in (of_pixel.tilt_deg, of_pixel.low_deg, of_pixel.high_deg)]
    region = [of_region.along_sun_deg, of_region.along_sun_low_deg, of_region.along_sun_high_deg]
    assert pixel == pytest.approx(region, abs=0.1)
    assert of_pixel.azimuth_deg == pytest.approx(of_region.sun_azimuth_deg)
