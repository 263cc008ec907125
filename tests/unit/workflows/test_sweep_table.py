"""One bed's line in the summary of a sweep, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.workflows.session_estimates import Estimates
from fieldkit.workflows.sweep import _region_row

BED = Region("b15", RegionKind.TARGET, ((0.0, 0.0),), 15.0, 180.0)


def line(region: Region, *found: tuple[SlopeState, float]) -> dict[str, float]:
    estimates = [
        SlopeEstimate(minute * 60 * 10**9, region.name, state, tilt)
        for minute, (state, tilt) in enumerate(found)
    ]
    rows = Estimates.of(estimates, np.full(len(found), 300.0), np.full(len(found), 800.0), (region,))
    return _region_row(region, rows.of_region(region))


def test_errors_are_of_the_minutes_with_an_answer() -> None:
    ok = SlopeState.OK
    held, few = (SlopeState.HELD_CLOUD, 40.0), (SlopeState.TOO_FEW, np.nan)
    found = line(BED, (ok, 16.0), (ok, 13.0), (ok, 15.5), held, few)
    assert (found["minutes"], found["answered"]) == (5, 3)
    assert found["median_tilt_deg"] == 15.5
    assert found["mean_error_deg"] == pytest.approx((1.0 - 2.0 + 0.5) / 3)
    assert found["mean_abs_error_deg"] == pytest.approx(3.5 / 3)
    assert found["median_abs_error_deg"] == 1.0
    assert found["worst_abs_error_deg"] == 2.0


def test_a_region_row_of_unknown_slope_has_no_error() -> None:
    found = line(Region("x", RegionKind.TARGET, ((0.0, 0.0),)), (SlopeState.OK, 16.0))
    assert found["median_tilt_deg"] == 16.0
    assert np.isnan([found[name] for name in found if name.endswith("error_deg")]).all()
