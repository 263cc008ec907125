"""The surface models against beds that the scene warms from measured minutes (Alamosa, 2016-01-01)."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.balance import least_squares_rows
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import normal
from fieldkit.physics.slab import Slab
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation import Exchange, Facet, MeasuredSky
from fieldkit.simulation.scene_series import SceneModel
from fieldkit.weather import packaged

BEDS = ((7.4, 180.0), (21.3, 180.0), (14.6, 95.0))
SLAB = Slab(depth_m=0.03)
NONE = ((0.0, 0.0),)
REGIONS = (
    Region("flat", RegionKind.REFERENCE, NONE, 0.0, 0.0),
    *(Region(f"b{tilt:.0f}", RegionKind.TARGET, NONE, tilt, azimuth) for tilt, azimuth in BEDS),
)
KNOWN = EstimatorSettings(model="paper", azimuth="known", slab=SLAB)


@pytest.fixture(scope="module")
def clear_day() -> History:
    """Minutes from 9 to 14 h local, without noise."""
    weather = packaged()
    start = int(np.datetime64("2016-01-01T16:00", "ns").astype(np.int64))
    sand = Facet("sand", (), depth_m=SLAB.depth_m)
    facets = tuple(replace(sand, tilt_deg=t, azimuth_deg=a) for t, a in ((0.0, 0.0), *BEDS))
    model = SceneModel(weather.site, MeasuredSky(weather), facets, facets[0], Exchange(18.15, 0.0), (), 1.0)
    series = model.series(start, 300 * 60.0)
    columns = series.rows[:, : 300 * 6].reshape(len(series.rows), 300, 6).mean(axis=2)
    time_ns = start + np.arange(300) * MINUTE_NS + MINUTE_NS // 2
    surface = columns[6:10].T
    return History(
        time_ns // MINUTE_NS,
        time_ns,
        sun_vectors(time_ns, weather.site),
        surface,
        columns[0],
        columns[1],
        columns[2],
        np.zeros(300, np.int64),
        np.zeros(surface.shape, np.int64),
    )


def tilt_errors(history: History, settings: EstimatorSettings) -> np.ndarray:
    found = slopes(history, REGIONS, settings)
    return np.array([abs(one.tilt_deg - bed[0]) for one, bed in zip(found, BEDS, strict=True)])


def test_full_model_is_within_a_tenth_of_a_degree_where_the_papers_is_off_by_degrees(clear_day):
    assert tilt_errors(clear_day, replace(KNOWN, model="full")).max() < 0.15
    assert tilt_errors(clear_day, KNOWN)[1] > 1.0


@pytest.mark.parametrize(
    ("slab", "limit"),
    [(replace(SLAB, conductivity_w_m_k=0.16), 0.3), (replace(SLAB, depth_m=0.05), 1.0)],
)
def test_wrong_layer_costs_tenths_of_a_degree(clear_day, slab, limit):
    # 20 % of the inertia, or 5 cm taken for 3; most of it on the bed facing east, whose heat changes fastest
    errors = tilt_errors(clear_day, replace(KNOWN, model="full", slab=slab))
    assert errors.mean() < limit
    assert errors[:2].max() < limit


def test_region_of_the_full_model_holds_the_beds(clear_day):
    settings = EstimatorSettings(model="full", slab=SLAB, window_s=3540.0)
    random = np.random.default_rng(8)
    noisy = replace(
        clear_day, temperature_k=clear_day.temperature_k + 0.05 * random.standard_normal((300, 4))
    )
    for one, (tilt, azimuth) in zip(slopes(noisy, REGIONS, settings), BEDS, strict=True):
        assert one.tilt_low_deg < tilt < one.tilt_high_deg
        assert one.azimuth_low_deg < azimuth < one.azimuth_high_deg
        assert one.noise_tilt_high_deg - one.noise_tilt_low_deg < one.tilt_high_deg - one.tilt_low_deg


def test_without_sky_instruments_the_full_model_still_beats_the_papers(clear_day):
    bare = replace(clear_day, dhi_w_m2=np.full(300, np.nan), longwave_down_w_m2=np.full(300, np.nan))
    assert tilt_errors(bare, replace(KNOWN, model="full"))[1] < tilt_errors(bare, KNOWN)[1]


def test_missing_minutes_are_bridged_for_the_layer(clear_day):
    kept = np.delete(np.arange(300), [120, 121, 122, 200, 275])
    gappy = History(*(getattr(clear_day, name)[kept] for name in clear_day.__slots__))
    assert tilt_errors(gappy, replace(KNOWN, model="full")).max() < 0.2


def test_full_model_answers_through_a_cloud_where_the_papers_holds(clear_day):
    clouded = replace(clear_day, flags=np.where(np.arange(300) > 290, int(Quality.CLOUD), 0))
    assert slopes(clouded, REGIONS, KNOWN)[0].state == SlopeState.HELD_CLOUD
    assert slopes(clouded, REGIONS, replace(KNOWN, model="full"))[0].state != SlopeState.HELD_CLOUD


def test_rows_of_both_models_are_the_cosines_of_incidence(clear_day):
    for model, limit in (("full", 0.002), ("paper", 0.05)):
        settings = EstimatorSettings(model=model, slab=SLAB)
        made = least_squares_rows(clear_day, 240, RegionColumns(tuple(REGIONS)), settings)
        truth = made.design @ normal(*np.array(BEDS).T).T
        assert np.abs(made.y - truth).max() < limit
