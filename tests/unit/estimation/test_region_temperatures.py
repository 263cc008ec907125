"""What is only known of an emissivity widens the region by what it is in kelvin, over kelvin per degree."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.region_temperatures import (
    difference_covariance_k2,
    difference_k,
    remove_offsets,
    shifted_temperatures,
)
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.radiance import brightness_temperature_k, kelvin_per_emissivity, surface_temperature_k
from tests.harness.last_minute import history_of

CORNERS = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))
FLAT, BED = Region("flat", RegionKind.REFERENCE, CORNERS), Region("b15", RegionKind.TARGET, CORNERS)
TAPE = replace(BED, name="tape", emissivity=0.95)


def test_the_published_sensitivity():
    """At 45 °C and 0.90: -0.63 K per hundredth under a sky of -40 °C, -0.25 K under 20 °C."""
    assert 0.01 * kelvin_per_emissivity(318.15, 0.90, 233.15) == pytest.approx(-0.63, abs=0.01)
    assert 0.01 * kelvin_per_emissivity(318.15, 0.90, 293.15) == pytest.approx(-0.25, abs=0.02)


def test_regions_of_one_emissivity_move_together_and_one_of_its_own_alone():
    settings = EstimatorSettings(emissivity_sd=0.01, own_emissivity_sd={"tape": 0.02})
    kelvin = np.array([[295.0, 305.0, 305.0]])
    common, own = shifted_temperatures(kelvin, (FLAT, BED, TAPE), settings)
    seen = brightness_temperature_k(kelvin, 0.90, settings.reflected_temperature_k)
    again = surface_temperature_k(seen, 0.91, settings.reflected_temperature_k)
    assert common[0, :2] == pytest.approx(again[0, :2], abs=0.02)
    assert common[0, 2] == 305.0
    assert own[0, :2].tolist() == [295.0, 305.0]
    assert own[0, 2] < 305.0 - 0.8


def test_nothing_moves_where_no_uncertainty_is_stated():
    assert list(shifted_temperatures(np.full((3, 2), 300.0), (FLAT, BED), EstimatorSettings())) == []


hours: dict[object, History] = {}  # by the beds, which alone enter the bins


def slopes(yard, **more):
    """The slopes after an hour, no other systematic uncertainty stated but the paper model's own."""
    settings = EstimatorSettings(
        azimuth="known", exchange_sd=0.0, drift_sd_k_per_h=0.0, conductivity_sd=0.0, capacity_sd=0.0,
        **{"model": "paper", "scale_sd": 0.0, "offset_sd_k": 0.0, **more},
    )  # fmt: skip
    if yard.beds not in hours:
        hours[yard.beds] = history_of(yard, yard.samples(60), settings)
    return {slope.region: slope for slope in SlopeChain(yard.beds, settings).at(hours[yard.beds]).slopes}


def half_width(found):
    return (found.tilt_high_deg - found.tilt_low_deg) / 2.0


def with_its_own_emissivity(yard):
    beds = (replace(bed, emissivity=0.90) if bed.name == "b17" else bed for bed in yard.beds)
    return replace(yard, beds=tuple(beds))


@pytest.mark.parametrize("model", ["paper", "full"])
def test_a_beds_own_uncertain_emissivity_costs_what_an_offset_of_its_kelvin_costs(yard, model):
    bed_k = surface_temperature(800.0 * 0.8, 400.0, 303.15, SurfaceParameters())  # some 640 W/m2 on it
    kelvin = 0.004 * abs(float(kelvin_per_emissivity(bed_k, 0.90, 233.15)))
    yard = with_its_own_emissivity(yard)
    stated = ({}, {"own_emissivity_sd": {"b17": 0.004}}, {"offset_sd_k": kelvin})
    alone, uncertain, offset = (slopes(yard, model=model, **more) for more in stated)
    assert half_width(uncertain["b08"]) == pytest.approx(half_width(alone["b08"]), abs=1e-9)
    assert uncertain["b17"].tilt_deg == pytest.approx(alone["b17"].tilt_deg, abs=1e-9)
    assert half_width(uncertain["b17"]) > 1.5 * half_width(alone["b17"])
    assert half_width(uncertain["b17"]) == pytest.approx(half_width(offset["b17"]), rel=0.1)


def test_an_emissivity_that_all_regions_share_mostly_cancels(yard):
    alone, shared = (half_width(slopes(yard, emissivity_sd=sd)["b17"]) for sd in (0.0, 0.01))
    own = half_width(slopes(with_its_own_emissivity(yard), own_emissivity_sd={"b17": 0.01})["b17"])
    assert alone < shared < alone + 0.5 * (own - alone)


def test_the_price_in_kelvin_is_that_of_the_difference_to_the_reference():
    settings = EstimatorSettings(emissivity_sd=0.02)
    both = difference_k(np.array([305.0, 295.0]), np.array([295.0, 295.0]), BED, FLAT, settings)
    each = 0.02 * kelvin_per_emissivity([305.0, 295.0], 0.90, settings.reflected_temperature_k)
    assert both == pytest.approx([abs(each[0] - each[1]), 0.0], abs=1e-9)
    alone = difference_k(
        np.array([305.0]), np.array([295.0]), TAPE, FLAT, replace(settings, own_emissivity_sd={"tape": 0.02})
    )
    assert alone[0] > both[0]


def test_differences_of_one_minute_vary_together_as_the_emissivities_say():
    settings = EstimatorSettings(emissivity_sd=0.02, own_emissivity_sd={"tape": 0.02})
    kelvin = np.array([295.0, 305.0, 300.0])
    found = difference_covariance_k2(kelvin, (FLAT, BED, TAPE), settings)
    for place, (bed, bed_k) in enumerate([(BED, 305.0), (TAPE, 300.0)]):
        alone = difference_k(np.array([bed_k]), kelvin[:1], bed, FLAT, settings)
        assert found[place, place] == pytest.approx(alone[0] ** 2, rel=1e-9)
    # the reference's error is in both differences, the bed's moves with it
    reference, bed = 0.02 * kelvin_per_emissivity(kelvin[:2], 0.90, settings.reflected_temperature_k)
    assert found[0, 1] == pytest.approx(-(bed - reference) * reference, rel=1e-9)
    assert not difference_covariance_k2(kelvin, (FLAT, BED, TAPE), EstimatorSettings()).any()


def test_a_light_meters_factor_is_as_much_a_scale_as_any(yard):
    one, other = (slopes(yard, **more)["b17"] for more in ({"factor_sd": 0.05}, {"factor_sd": 0.0}))
    assert half_width(one) > half_width(other)
    assert one.tilt_high_deg == slopes(yard, factor_sd=0.03, scale_sd=0.04)["b17"].tilt_high_deg


# --- known offsets are of brightness temperature, whatever the emissivity of a region


@pytest.mark.parametrize(("own", "used"), [(float("nan"), 0.90), (0.85, 0.85), (0.98, 0.98)])
def test_an_offset_of_brightness_leaves_nothing(own, used):
    settings = EstimatorSettings(model="paper", offsets_k={"b15": 1.0, "flat": 1.0})
    assert settings.surface.emissivity == 0.90
    reflected = settings.reflected_temperature_k
    regions = FLAT, replace(BED, emissivity=own)
    true = np.array([[295.0, 300.0], [296.0, 305.0]])
    seen = true.copy()
    seen[:, 1] = surface_temperature_k(
        brightness_temperature_k(true[:, 1], used, reflected) + 1.0, used, reflected
    )
    columns = {name: np.zeros(2) for name in History.__slots__}
    history = replace(History(**columns), temperature_k=seen)
    assert remove_offsets(history, regions, settings).temperature_k == pytest.approx(true, abs=1e-6)
    assert np.array_equal(history.temperature_k, seen)
