"""A map of a session below its horizon."""

import pytest

from fieldkit.model.errors import NoAnswerError
from fieldkit.results.slope_map import slope_map


def test_minutes_behind_the_horizon_enter_no_map(sessions):
    assert slope_map(sessions[0], "all", settings=["site.horizon=[[0, 1.0]]"]).minutes > 5
    with pytest.raises(NoAnswerError, match="window='all'"):
        slope_map(sessions[0], "all", settings=["site.horizon=[[0, 89.0]]"])
