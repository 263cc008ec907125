"""The report's table of results, cell by cell, on minutes made by hand."""

from __future__ import annotations

import pytest

from fieldkit.model.samples import Quality
from fieldkit.model.slope import SlopeState
from fieldkit.views.report import results
from fieldkit.views.report.series import series

SLOPES, ACCURACY = {"tilt": 1, "given": 3, "state": 4}, {"error": 4, "mae": 5, "n": 6}


@pytest.fixture
def cell(regions):
    """A cell of the first bed's row in either table; the bed was given as 15 degrees."""

    def of(minutes, name: str, sd: str = "usual") -> object:
        bed = series(minutes, regions).targets[0]
        assert bed.region.tilt_deg == 15.0
        if name in SLOPES:
            return results._slope_row(bed)[SLOPES[name]]
        return results._accuracy_row(bed, sd)[ACCURACY[name]]

    return of


@pytest.mark.parametrize(("tilt_deg", "error"), [(17.5, "+2.5"), (12.25, "-2.8"), (15.0, "+0.0")])
def test_an_error_is_what_was_found_less_what_was_given(make_minute, cell, tilt_deg, error):
    assert cell([make_minute(0, tilt_deg=tilt_deg)], "error") == error


def test_slopes_held_over_a_cloud_count_for_nothing(make_minute, cell):
    held = {"state": SlopeState.HELD_CLOUD, "flags": Quality.CLOUD, "tilt_deg": 40.0}
    minutes = [make_minute(0, tilt_deg=16.0), make_minute(1, **held), make_minute(2, tilt_deg=18.0)]
    assert cell(minutes, "n") == 2
    assert cell(minutes, "mae") == "2.0 ± 1.00"  # errors of 1 and 3 degrees
    assert cell(minutes, "mae", sd="paper") == "2.0 ± 0.71"  # eq. (9): n outside the root


def test_a_bed_without_an_estimate_has_dashes(make_minute, cell):
    empty = [make_minute(0, estimates=())]
    assert [cell(empty, name) for name in ("tilt", "error", "mae")] == ["–", "–", "–"]
    assert cell(empty, "n") == 0
    assert cell(empty, "state") == "no estimate"
