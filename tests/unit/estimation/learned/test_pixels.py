"""A pixel is one more target: in worlds that the model does not contain its slope is that of its region."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR, RANDOM
from benchmarks.harsh_worlds import HARMLESS, HARSH, harsh_world
from benchmarks.products import mapped_world
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.pixels import PixelModel
from fieldkit.estimation.minute_maps import MinuteMap
from fieldkit.model.slope import SlopeState
from fieldkit.physics.facet import normal

MINUTES = 60


@pytest.mark.parametrize("seed", [6000, pytest.param(6001, marks=pytest.mark.slow)])
def test_pixels_of_a_region_have_its_slope(seed):
    """Shadows, gusts of each bed's own, unlike sand, another sky: before, whole beds were refused."""
    found = mapped_world(harsh_world(seed, CLEAR, RANDOM, harm=HARSH, minutes=MINUTES))
    for row, region in enumerate(found.regions, start=1):
        tilt, azimuth = found.slopes.tilt_deg[row], found.slopes.azimuth_deg[row]
        assert not np.isin(found.slopes.state[row], (SlopeState.NO_INTERSECTION, SlopeState.SHADED)).any()
        # a map has the likelihood alone: the region of both angles, 1.3 times as wide as the tilt's own
        assert abs(np.median(tilt) - region.tilt_deg) <= 1.3 * region.tilt_half_width_deg
        assert (found.bounds.tilt_low_deg[row] <= region.tilt_deg).all()
        assert (found.bounds.tilt_high_deg[row] >= region.tilt_deg).all()
        aside = (region.azimuth_deg - azimuth + 180.0) % 360.0 - 180.0
        assert (found.bounds.azimuth_low_deg[row] <= azimuth + aside).all()
        assert (found.bounds.azimuth_high_deg[row] >= azimuth + aside).all()
        assert np.median(found.slopes.chi_square[row]) < 3.0


def test_the_exchange_of_each_minute_is_that_of_the_wind():
    """The world's exchange follows its wind, which is not logged."""
    world = harsh_world(
        6003, CLEAR, RANDOM, harm=replace(HARMLESS, per_wind=(4.0, 4.0), gusts=True), minutes=60
    )
    history = replace(world.history, wind_m_s=np.full(len(world.history), np.nan))
    known = {one.name: normal(one.tilt_deg, one.azimuth_deg) for one in world.regions[1:]}
    learnt = SlopeChain(world.regions, world.settings).at_once(history).learnt
    assert learnt is not None
    chosen = np.ones(len(history), np.bool_)
    rows = PixelModel(history, world.regions, chosen, known, world.settings, learnt).rows()
    true = world.field.exchange.at(world.history.wind_m_s)
    assert np.corrcoef(rows.exchange_w_m2_k, true)[0, 1] > 0.7
    without = PixelModel(history, world.regions, chosen, {}, world.settings, learnt).rows()
    assert np.ptp(without.exchange_w_m2_k) == 0.0


def test_without_anything_learnt_pixels_are_solved_by_the_full_model():
    world = harsh_world(6002, CLEAR, RANDOM, harm=HARMLESS, minutes=20)
    regions = tuple(
        replace(one, points_px=((0, row), (2, row), (2, row + 1), (0, row + 1)))
        for row, one in enumerate(world.regions)
    )
    history = world.history
    by_minute = dict(
        zip(history.minute.tolist(), history.temperature_k[..., np.newaxis] * np.ones(2), strict=True)
    )
    tilts = []
    for model in ("learned", "full"):
        settings = replace(world.settings, model=model)
        minutes = np.arange(len(history))
        asked = MinuteMap(history, regions, minutes, (4, 2), settings, {})
        tilts.append(asked.solve(by_minute.__getitem__)[0].tilt_deg)
    np.testing.assert_array_equal(*tilts)
