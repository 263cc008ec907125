"""Histories of several days: what is said after a night, and what a minute costs late in a long session."""

from dataclasses import replace

import numpy as np

from benchmarks.drawn_worlds import CLEAR
from fieldkit.estimation.bins import RegionColumns, join
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned import inputs
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.table import slopes_of_part
from fieldkit.estimation.together import Part
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SlopeState
from fieldkit.weather import packaged_day
from tests.harness.drawn import drawn_world, later


def test_after_a_night_the_reason_is_that_of_the_new_day():
    world = drawn_world(5, CLEAR, minutes=12)
    day = world.history
    blind = replace(later(day), temperature_k=np.full_like(day.temperature_k, np.nan))
    chain = SlopeChain(world.regions, replace(world.settings, model="learned"))
    for one in chain.at(join([day, blind])).slopes:
        assert one.reason.endswith("reference yet")
        assert one.window_start_ns == blind.time_ns[0]


def test_all_days_of_a_table_count():
    """Five minutes of the second day took the place of all of the first."""
    world = drawn_world(5, CLEAR, minutes=30)
    settings = replace(world.settings, model="learned")
    table = join([world.history, later(world.history).until(5)])
    for one in slopes_of_part(Part("table", packaged_day().site, world.regions, table, settings)):
        assert one.state is not SlopeState.TOO_FEW
        assert one.n_bins == 35


def test_shade_is_looked_up_beside_a_minute_alone(monkeypatch):
    """Looking through the whole session for each minute takes a time that grows with its square."""
    world, minutes = drawn_world(5, CLEAR, minutes=40), 40
    settings = replace(world.settings, horizon=((0.0, 1.0), (180.0, 1.0)))
    columns = RegionColumns(world.regions)
    layout = Layout.of(columns, columns.targets, settings)
    shaded = np.random.default_rng(1).random((minutes, len(world.regions))) < 0.7
    history = replace(world.history, region_flags=np.where(shaded, int(Quality.SHADED), 0))
    whole = inputs.shade(history, layout)
    looked_up, sunlit = [], inputs.sunlit
    monkeypatch.setattr(
        inputs, "sunlit", lambda sun, of: looked_up.append(np.size(sun) // 3) or sunlit(sun, of)
    )
    found = inputs.minutes_between(history, 0, minutes, layout, settings)
    assert sum(looked_up) <= 4 * minutes
    np.testing.assert_array_equal([one.shaded > 0.0 for one in found], whole[:, 0])
    np.testing.assert_array_equal([one.is_edge for one in found], whole[:, 1])
