"""Ranks of truths: where a truth lies in an interval, and what is called uneven."""

import numpy as np
import pytest

from benchmarks.estimation_ranks import BINS, evenness, rank, rows
from docs.ranks import histograms


@pytest.mark.parametrize(
    ("truth", "share"),
    [(10.0, 0.5), (14.0, 0.95), (8.0, 0.05), (18.0, 0.9995), (10.0 + 4.0 * 0.67449 / 1.64485, 0.75)],
)
def test_a_truth_on_an_end_of_the_90_percent_interval_has_a_twentieth_beyond_it(truth, share):
    """Quantiles of the normal distribution (0.75: 0.67449, 0.95: 1.64485), wider above than below."""
    assert rank(truth, 10.0, 8.0, 14.0, 0.90) == pytest.approx(share, abs=1e-4)


def test_an_interval_without_width_has_no_rank():
    assert np.isnan(rank(10.0, 10.0, 10.0, 10.0, 0.90))


def test_even_ranks_pass_and_those_of_too_narrow_or_biased_regions_do_not():
    even = (np.arange(500) + 0.5) / 500
    narrow = 0.5 + 0.5 * np.sign(even - 0.5) * np.abs(2.0 * even - 1.0) ** 0.6
    for ranks, is_even in ((even, True), (narrow, False), (even**1.3, False)):
        assert [one > 0.01 for one in evenness(ranks)] == [is_even, is_even]
    row, *_ = rows({"gain": narrow})
    assert row.value < 0.01
    assert "500 ranks" in row.note


def test_the_figure_has_a_histogram_of_each_quantity():
    even = (np.arange(200) + 0.5) / 200
    figure = histograms({"gain": even, "tilt of bed0": even[:150]})
    assert [axes.get_title() for axes in figure.axes[:2]] == ["gain", "tilt of bed0"]
    bars = figure.axes[0].patches[-1].get_data().values
    assert bars == pytest.approx(np.full(BINS, 10.0))
