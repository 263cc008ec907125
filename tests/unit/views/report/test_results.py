"""The report's table of results, cell by cell, on minutes made by hand."""

import pytest

from fieldkit.model.samples import Quality
from fieldkit.model.slope import SlopeState
from fieldkit.views.report import results
from fieldkit.views.report.series import ReportData

SLOPES = {"tilt": "tilt °", "given": "given", "state": "state"}
ACCURACY = {"error": "last error °", "mae": "mean |error| (SD) °", "n": "n"}


@pytest.fixture
def cell(site, regions, settings):
    """A cell of the first bed (given: 15 degrees) in either table; None if its column is not shown."""

    def of(minutes, name: str, sd: str = "usual") -> object:
        data = ReportData(None, minutes, settings, site, tuple(regions), config_toml="", sd=sd)
        assert data.columns.targets[0].region.tilt_deg == 15.0
        table = results.slopes(data) if name in SLOPES else results.accuracy(data)
        return dict(zip(table.columns, table.rows[0], strict=True)).get({**SLOPES, **ACCURACY}[name])

    return of


@pytest.mark.parametrize(("tilt_deg", "error"), [(17.5, "+2.5"), (12.25, "-2.8"), (15.0, "+0.0")])
def test_an_error_is_what_was_found_less_what_was_given(make_minute, cell, tilt_deg, error):
    assert cell([make_minute(0, tilt_deg=tilt_deg)], "error") == error


def test_slopes_held_over_a_cloud_count_for_nothing(make_minute, cell):
    held = {"state": SlopeState.HELD_CLOUD, "flags": Quality.CLOUD, "tilt_deg": 40.0}
    minutes = [make_minute(0, tilt_deg=16.0), make_minute(1, **held), make_minute(2, tilt_deg=18.0)]
    assert cell(minutes, "n") == 2
    assert cell(minutes, "mae") == "2.0 (1.00)"  # errors of 1 and 3 degrees
    assert cell(minutes, "mae", sd="paper") == "2.0 (0.71)"  # eq. (9): n outside the root


def test_a_bed_without_an_estimate_has_a_dash_and_no_error(make_minute, cell):
    empty = [make_minute(0, estimates=())]
    assert [cell(empty, name) for name in ("tilt", "error", "mae")] == ["–", None, None]
    assert cell(empty, "n") == 0
    assert cell(empty, "state") == "no estimate"
