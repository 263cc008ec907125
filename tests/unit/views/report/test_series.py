import math

import numpy as np
import pytest

from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeState
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.sun import sun_angles
from fieldkit.views.report.series import modelled_temperature, series

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
HOURS_NS = [
    1_504_062_000_000_000_000 + hour * 3_600_000_000_000 for hour in range(4)
]  # 12 to 15 JST, 30 Aug 2017
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
FLAT = Region("flat", RegionKind.REFERENCE, CORNERS, 0.0, math.nan)
B10 = Region("b10", RegionKind.TARGET, CORNERS, 10.0, 180.0)
# Eq. (7) with the paper's Table 1, S 800 W/m2, air 303.15 K, long wave 400 W/m2, geometric sun: worked
# out apart from this program, to 10 uK.
MEASURED_K = [325.23205, 324.02574, 321.34508, 317.34486]
REFERENCE_K = [323.60330, 322.50984, 320.08268, 316.46441]


@pytest.fixture
def hours(make_minute):
    """The four hours of the golden numbers as minutes."""
    zenith, azimuth = sun_angles(np.array(HOURS_NS), PAPER_SITE)
    return [
        make_minute(
            time_ns=time_ns,
            estimates=(),
            temperature_k={"flat": REFERENCE_K[i], "b10": MEASURED_K[i]},
            dni_w_m2=800.0,
            sun_zenith_deg=float(zenith[i]),
            sun_azimuth_deg=float(azimuth[i]),
        )
        for i, time_ns in enumerate(HOURS_NS)
    ]


def test_eq_7_with_the_reference_standing_in_for_air_and_sky_gives_the_golden_temperatures(hours):
    columns = series(hours, (FLAT, B10))
    modelled = modelled_temperature(columns, columns.targets[0], SurfaceParameters())
    assert modelled == pytest.approx(MEASURED_K, abs=2e-4)  # 0.003 degrees of sun


@pytest.mark.parametrize("regions", [(FLAT, Region("b10", RegionKind.TARGET, CORNERS)), (B10,)])
def test_without_a_slope_or_a_reference_there_is_no_modelled_temperature(hours, regions):
    columns = series(hours, regions)
    assert np.isnan(modelled_temperature(columns, columns.targets[0], SurfaceParameters())).all()


def test_sun_vector_is_that_of_the_angles(hours):
    columns = series(hours[:1], (FLAT, B10))
    # SPA, 30 Aug 2017 03:00 UTC at the paper's site; 0.003 degrees
    assert columns.sun[0] == pytest.approx([-0.072789, -0.446187, 0.891975], abs=5e-5)


def test_minutes_come_out_in_order_of_time(make_minute, regions):
    columns = series([make_minute(2, tilt_deg=12.0), make_minute(0, tilt_deg=10.0)], regions)
    assert np.all(np.diff(columns.time_ns) > 0)
    assert columns.targets[0].tilt_deg == pytest.approx([10.0, 12.0])


def test_held_slopes_are_shown_but_count_for_no_error(make_minute, regions):
    minutes = [make_minute(0), make_minute(1, state=SlopeState.HELD_CLOUD, flags=Quality.CLOUD)]
    columns = series(minutes, regions)
    bed = columns.targets[0]
    assert bed.tilt_deg == pytest.approx([15.5, 15.5])
    assert np.isnan(bed.estimated_tilt_deg).tolist() == [False, True]
    assert bed.final_estimate.state is SlopeState.HELD_CLOUD
    assert columns.cloudy.tolist() == [False, True]


def test_a_region_without_an_estimate_is_nan(make_minute, regions):
    columns = series([make_minute(0, estimates=())], regions)
    assert np.isnan(columns.targets[0].tilt_deg).all()
    assert columns.targets[0].last is None
