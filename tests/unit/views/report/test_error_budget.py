"""The budget's terms against steady facets whose whole radiation is balanced here, term by term."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.radiance import brightness_temperature_k, surface_temperature_k
from fieldkit.physics.slab import Slab
from fieldkit.physics.sun import sun_angles, sun_vectors
from fieldkit.views.report.error_budget import ErrorBudget, budget, cause_rows
from fieldkit.views.report.series import series

SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
NOON_NS = 1_512_961_200_000_000_000  # 11 Dec 2017, 12:00 JST
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
FLAT = Region("flat", RegionKind.REFERENCE, CORNERS, 0.0, 0.0)
BED = Region("bed", RegionKind.TARGET, CORNERS, 15.0, 180.0)
SIGMA = 5.670374419e-8
ALBEDO, EMISSIVITY, EXCHANGE = 0.20, 0.90, 18.15  # the paper's Table 1
DIRECT, SHARE, DOWN, AIR_K = 850.0, 0.15, 300.0, 283.15
NO_STORAGE = Slab(depth_m=1e-6)
SETTINGS = EstimatorSettings(model="paper", slab=NO_STORAGE, diffuse_fraction=SHARE, longwave_down_w_m2=DOWN)


def facet_k(tilt_deg, cos_incidence, cos_zenith, circumsolar, flat_k=None):
    """Steady temperature under direct, diffuse (Hay and Davies) and reflected light and long wave."""
    diffuse = SHARE / (1 - SHARE) * DIRECT * cos_zenith
    sky = (1 + math.cos(math.radians(tilt_deg))) / 2
    light = (
        DIRECT * cos_incidence
        + diffuse * (circumsolar * cos_incidence / cos_zenith + (1 - circumsolar) * sky)
        + 0.20 * (DIRECT * cos_zenith + diffuse) * (1 - sky)
    )
    ground = 0.0 if flat_k is None else EMISSIVITY * SIGMA * flat_k**4 + (1 - EMISSIVITY) * DOWN
    gain = (1 - ALBEDO) * light + EMISSIVITY * (sky * DOWN + (1 - sky) * ground)
    return brentq(lambda t: gain - EMISSIVITY * SIGMA * t**4 - EXCHANGE * (t - AIR_K), 200, 400, xtol=1e-10)


def minute_of(make_minute, bed, time_ns):
    """One minute in which flat and bed are steady under the whole sky."""
    ((east, north, up),) = sun_vectors(np.array([time_ns]), SITE)
    zenith, azimuth = sun_angles(np.array([time_ns]), SITE)
    tilt, bearing = math.radians(bed.tilt_deg), math.radians(bed.azimuth_deg)
    cosine = math.sin(tilt) * (math.sin(bearing) * east + math.cos(bearing) * north) + math.cos(tilt) * up
    circumsolar = DIRECT / 1406.0  # beam over extraterrestrial: 1361 W/m2 and 3.3 % nearer on 11 December
    flat_k = facet_k(0.0, up, up, circumsolar)
    bed_k = facet_k(bed.tilt_deg, cosine, up, circumsolar, flat_k)
    estimate = SlopeEstimate(
        time_ns, bed.name, SlopeState.OK, 15.0, 180.0, 14.0, 16.5, kelvin_per_degree=0.35
    )
    return make_minute(
        time_ns=time_ns,
        estimates=(estimate,),
        temperature_k={"flat": flat_k, bed.name: bed_k},
        dni_w_m2=DIRECT,
        sun_zenith_deg=float(zenith[0]),
        sun_azimuth_deg=float(azimuth[0]),
        flags=Quality.GOOD,
    )


def budget_of(minutes, bed=BED, settings=SETTINGS) -> ErrorBudget:
    columns = series(minutes, (FLAT, bed))
    return budget(columns, columns.targets[0], settings)


@pytest.mark.parametrize(
    ("tilt_deg", "azimuth_deg"), [(5.0, 180.0), (15.0, 180.0), (20.0, 90.0), (10.0, 0.0)]
)
def test_the_terms_add_up_to_what_eq_6_gets_wrong(make_minute, tilt_deg, azimuth_deg):
    bed = Region("bed", RegionKind.TARGET, CORNERS, tilt_deg, azimuth_deg)
    minutes = [minute_of(make_minute, bed, NOON_NS + step * 60_000_000_000) for step in range(3)]
    columns = series(minutes, (FLAT, bed))
    found = budget(columns, columns.targets[0], SETTINGS)

    middle = minutes[1]
    alpha, beta = EMISSIVITY * SIGMA / (1 - ALBEDO), EXCHANGE / (1 - ALBEDO)
    warm, base = middle.temperature_k["bed"], middle.temperature_k["flat"]
    by_eq_6 = alpha * (warm**4 - base**4) + beta * (warm - base)
    direct = columns.direct_on(tilt_deg, azimuth_deg)[1] - columns.direct_on(0.0, 0.0)[1]
    assert found.omitted_w_m2 == pytest.approx(by_eq_6 - direct, abs=0.02 * abs(by_eq_6) + 0.3)


def test_a_flat_bed_leaves_nothing_out(make_minute):
    bed = Region("bed", RegionKind.TARGET, CORNERS, 0.0, 180.0)
    minutes = [minute_of(make_minute, bed, NOON_NS + step * 60_000_000_000) for step in range(2)]
    assert budget_of(minutes, bed).omitted_w_m2 == pytest.approx(0.0, abs=1e-6)


def test_measured_sky_takes_the_place_of_the_assumed_one(make_minute):
    """No diffuse light, and longwave of a sky as warm as the ground: neither tells a slope from the flat."""
    assumed = [minute_of(make_minute, BED, NOON_NS)]
    ground = EMISSIVITY * SIGMA * assumed[0].temperature_k["flat"] ** 4
    warm_sky = ground / EMISSIVITY  # emitted and reflected together are what comes down
    measured = [replace(assumed[0], dhi_w_m2=0.0, longwave_down_w_m2=warm_sky)]
    before, after = budget_of(assumed), budget_of(measured)
    assert before.diffuse_w_m2 > 1.0
    assert abs(before.longwave_w_m2) > 1.0
    assert after.diffuse_w_m2 == 0.0
    assert after.longwave_w_m2 == pytest.approx(0.0, abs=1e-9)


def test_w_m2_per_degree_is_the_papers_geometry(make_minute):
    """South 15 degrees, 11 Dec, 12:00, S 800: 9.6 W/m2 per degree; 0.33 degrees cost 0.11 K (30 W/m2/K)."""
    minutes = [replace(minute_of(make_minute, BED, NOON_NS), dni_w_m2=800.0)]
    assert budget_of(minutes).w_m2_per_degree == pytest.approx(9.6, abs=0.05)


def test_a_bed_that_warms_faster_than_the_reference_looks_less_turned_to_the_sun(make_minute):
    minutes = [
        replace(
            make_minute(step, time_ns=NOON_NS + step * 60_000_000_000, estimates=()),
            temperature_k={"flat": 300.0, "bed": 305.0 + 0.02 * step},
        )
        for step in range(120)
    ]
    thin = Slab(depth_m=0.01)  # follows within minutes: flux is heat capacity times warming
    found = budget_of(minutes, settings=replace(SETTINGS, slab=thin))
    expected = -1.3e6 * 0.01 * 0.02 / 60 / (1 - ALBEDO)
    assert found.storage_w_m2 == pytest.approx(expected, rel=0.02)


def test_offset_scale_and_noise_in_degrees(make_minute):
    found = budget_of([minute_of(make_minute, BED, NOON_NS)])
    assert found.of_offset(0.35) == pytest.approx(1.0)
    assert found.of_scale(0.1) == pytest.approx(1.5)
    assert found.noise_deg == pytest.approx(1.25)


def test_what_calibrations_leave_uncertain_has_rows_of_its_own_in_degrees(make_minute):
    """A kelvin between bed and reference over 0.35 K per degree; 3 % of 15 degrees."""
    minute = minute_of(make_minute, BED, NOON_NS)
    found = budget_of([minute], settings=replace(SETTINGS, emissivity_sd=0.02, factor_sd=0.03))
    warm, base = (minute.temperature_k[name] for name in ("bed", "flat"))
    seen = [
        surface_temperature_k(brightness_temperature_k(kelvin, 0.90, 233.15), 0.92, 233.15)
        for kelvin in (warm, base)
    ]
    expected_k = abs((seen[0] - warm) - (seen[1] - base))
    assert found.emissivity_k == pytest.approx(expected_k, rel=0.1)
    emissivity, meter = calibrated_rows(found)
    assert emissivity == f"{found.emissivity_k / 0.35:.1f}° ({found.emissivity_k:.2f} K)"
    assert meter.endswith("° (3.0%)")
    assert float(meter[:3]) == pytest.approx(0.45, abs=0.051)
    assert calibrated_rows(budget_of([minute])) == []


def calibrated_rows(found: ErrorBudget) -> list[str]:
    return [str(row[1]) for row in cause_rows([found]) if "calibrated" in str(row[0])]
