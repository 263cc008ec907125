from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.simulation import ClearSky, Exchange
from fieldkit.simulation.boards import Board
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.field_minutes import field_minutes
from fieldkit.simulation.scene_series import SceneModel

NIGHT_NS = int(np.datetime64("2026-12-10T15:00", "ns").astype(np.int64))
BEDS = (Facet("flat", ()), Facet("b15", (), 15.0, 180.0))
MODEL = SceneModel(
    Site(35.558675, 139.395232), ClearSky(2.0, 290.0, 0.0, 1.5), BEDS, GROUND, Exchange(19.0, 0.0), (), 3.0
)


def test_minutes_are_means_of_the_scene_between_whole_minutes():
    found = field_minutes(MODEL, NIGHT_NS, 5)
    assert (found.time_ns - NIGHT_NS).tolist() == [(minute + 0.5) * MINUTE_NS for minute in range(5)]
    assert found.dni_w_m2.tolist() == found.dhi_w_m2.tolist() == [0.0] * 5
    # a sky without daily swing: air and wind as given, longwave by Swinbank (1963), 5.31e-13 T^6
    assert found.air_k == pytest.approx(np.full(5, 290.0))
    assert found.wind_m_s == pytest.approx(np.full(5, 1.5))
    assert found.longwave_down_w_m2 == pytest.approx(np.full(5, 5.31e-13 * 290.0**6))
    series = MODEL.series(NIGHT_NS, 300.0)
    for minute in range(5):
        inside = (series.time_s >= 60.0 * minute) & (series.time_s <= 60.0 * (minute + 1))
        mean = np.trapezoid(series.rows[6:8, inside], series.time_s[inside], axis=1) / 60.0
        assert found.surface_k[minute] == pytest.approx(mean, abs=1e-9)


def test_minutes_partly_under_a_board_are_shaded():
    board = Board("b15", 90.0, 180.0)
    found = field_minutes(replace(MODEL, boards=(board,)), NIGHT_NS, 5)
    assert found.is_shaded[:, 0].tolist() == [False] * 5
    assert found.is_shaded[:, 1].tolist() == [False, True, True, False, False]
