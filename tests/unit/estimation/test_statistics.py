"""Hand numbers for eqs. (8) and (9): errors 1, 2, 3 and 6 degrees."""

import math

import numpy as np
import pytest

from fieldkit.estimation.statistics import (
    errors_over_time,
    mean_absolute_error,
    root_mean_square_error,
    sd_of_absolute_error,
)

TRUTH = np.array([10.0, 10.0, 20.0, 20.0])
ESTIMATED = np.array([11.0, 8.0, 23.0, 14.0])  # |error| 1 2 3 6: mean 3, squares about it 4 1 0 9 = 14


def test_errors_are_those_by_hand():
    assert mean_absolute_error(ESTIMATED, TRUTH) == pytest.approx(3.0, abs=1e-12)
    # eq. (9) as printed has n outside the root
    assert sd_of_absolute_error(ESTIMATED, TRUTH, "paper") == pytest.approx(math.sqrt(14) / 4, abs=1e-12)
    assert sd_of_absolute_error(ESTIMATED, TRUTH, "usual") == pytest.approx(math.sqrt(14 / 4), abs=1e-12)
    assert root_mean_square_error(ESTIMATED, TRUTH) == pytest.approx(math.sqrt(50 / 4), abs=1e-12)


def test_unknown_values_do_not_count():
    estimated = np.array([11.0, np.nan, 23.0, 14.0])
    truth = np.array([10.0, 10.0, np.nan, 20.0])
    assert mean_absolute_error(estimated, truth) == pytest.approx(3.5, abs=1e-12)  # of 1 and 6


@pytest.mark.parametrize("statistic", [mean_absolute_error, root_mean_square_error, sd_of_absolute_error])
def test_nothing_known_gives_nan(statistic):
    assert math.isnan(statistic([np.nan], [1.0]))
    assert math.isnan(statistic([], []))


def test_errors_fall_into_stretches_of_whole_multiples():
    minute = 60 * 10**9
    times = [19 * minute, 20 * minute, 21 * minute, 61 * minute]
    spans = errors_over_time(times, [11.0, 12.0, 14.0, np.nan], 10.0, span_s=1200, kind="usual")
    assert [(span.start_ns // minute, span.count) for span in spans] == [(0, 1), (20, 2)]
    assert [span.mean for span in spans] == [pytest.approx(1.0), pytest.approx(3.0)]
    assert [span.sd for span in spans] == [0.0, pytest.approx(1.0)]
    assert spans[1].middle_ns == 30 * minute
