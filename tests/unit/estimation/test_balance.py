"""Least-squares rows: noise and systematic uncertainties, against the paper's Table 1 by hand."""

from dataclasses import replace

import numpy as np
import pvlib
import pytest

from fieldkit.estimation.balance import LIGHT, Rows, least_squares_rows
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.daylight import extraterrestrial
from fieldkit.physics.facet import normal
from fieldkit.physics.slab import Slab

MINUTES = 61
DIRECT_W_M2, REFERENCE_K, TARGET_K = 800.0, 300.0, 310.0
SIGMA_SB = 5.670374419e-8
EXCHANGE_W_M2_K = 1000.0 * 1.21 * 0.015  # Table 1: C_p, rho, C_H U
STEEPNESS = 4.0 * 0.90 * SIGMA_SB * TARGET_K**3 + EXCHANGE_W_M2_K
ABSORBED = 0.80 * DIRECT_W_M2
SETTINGS = EstimatorSettings(model="paper", noise_k=0.1, offset_sd_k=0.25, drift_sd_k_per_h=0.4)


@pytest.fixture
def history():
    """An hour of three references and a target that are each of one temperature."""
    minute = 25_000_000 + np.arange(MINUTES)
    sun = np.tile(normal(40.0, 180.0), (MINUTES, 1))
    kelvin = np.tile([REFERENCE_K, REFERENCE_K, REFERENCE_K, TARGET_K], (MINUTES, 1))
    return History(minute, minute * MINUTE_NS, sun, kelvin, np.full(MINUTES, DIRECT_W_M2))


def made(history: History, references: int = 1, **changes: object) -> Rows:
    kinds = [RegionKind.REFERENCE] * references + [RegionKind.TARGET]
    columns = RegionColumns(tuple(Region(f"r{i}", kind, ((0.0, 0.0),)) for i, kind in enumerate(kinds)))
    used = replace(history, temperature_k=history.temperature_k[:, [*range(references), 3]])
    return least_squares_rows(used, 0, columns, replace(SETTINGS, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("references", [1, 3])
def test_noise_is_that_of_the_target_and_of_the_mean_of_the_references(history, references):
    expected = 0.1 * np.sqrt(1.0 + 1.0 / references) * STEEPNESS / ABSORBED
    assert made(history, references).sigma == pytest.approx(np.full((MINUTES, 1), expected), rel=1e-9)


def test_light_that_changes_by_a_tenth_in_a_minute_doubles_the_variance(history):
    light = np.full(MINUTES, DIRECT_W_M2)
    light[10:] = 1.1 * DIRECT_W_M2
    steady = made(history).sigma[0, 0]
    found = made(replace(history, dni_w_m2=light)).sigma[:, 0] * light / DIRECT_W_M2 / steady
    assert found[5] == pytest.approx(1.0)
    assert found[9] ** 2 == pytest.approx(2.0)
    assert found[10] ** 2 == pytest.approx(1.0 + (0.1 / 1.1 / 0.1) ** 2)
    assert found[11] == pytest.approx(1.0)


def test_an_offset_and_a_drift_in_kelvin_per_hour_are_systematic_effects_in_every_row(history):
    offset, drift, _ = made(history).systematics[:, :, 0] * ABSORBED / STEEPNESS  # back to kelvin
    assert offset == pytest.approx(np.full(MINUTES, 0.25))
    assert drift[-1] - drift[0] == pytest.approx(0.4)  # over one hour
    assert drift.mean() == pytest.approx(0.0, abs=1e-12)


def test_an_uncertain_layer_is_the_difference_that_another_layer_would_make(history):
    warmer_k = np.outer(np.arange(MINUTES) ** 1.5 / 60.0, [0, 0, 0, 1])
    warming = replace(history, temperature_k=history.temperature_k + warmer_k)
    slab = Slab(depth_m=0.03)
    full = {"model": "full", "slab": slab, "conductivity_sd": 0.3, "capacity_sd": 0.2}
    found = made(warming, **full)
    conductivity, capacity = 1.3 * slab.conductivity_w_m_k, 1.2 * slab.heat_capacity_j_m3_k
    others = replace(slab, conductivity_w_m_k=conductivity), replace(slab, heat_capacity_j_m3_k=capacity)
    for effect, other in zip(found.systematics[3:, :, 0], others, strict=True):
        moved = made(warming, **{**full, "slab": other}).y[:, 0] - found.y[:, 0]
        assert np.abs(moved).max() > 1e-4
        assert effect == pytest.approx(moved, abs=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1.2])
def test_a_row_is_the_papers_eq_6_over_its_light(history, scale):
    found = made(history, scale=scale)
    lost = 0.90 * SIGMA_SB * (TARGET_K**4 - REFERENCE_K**4) + EXCHANGE_W_M2_K * (TARGET_K - REFERENCE_K)
    expected = lost / (ABSORBED * scale) + np.cos(np.radians(40.0))
    assert found.y == pytest.approx(np.full((MINUTES, 1), expected), rel=1e-9)
    assert found.per_kelvin == pytest.approx(np.full((MINUTES, 1), STEEPNESS / (ABSORBED * scale)), rel=1e-9)


def test_uncertain_light_is_what_another_sky_and_ground_would_send_after_pvlib(history):
    """Of a plane less a level one: even sky to Hay and Davies', theirs to Perez', more albedo."""
    diffuse, tilt, azimuth = 90.0, 35.0, 120.0
    used = replace(history, dhi_w_m2=np.full(MINUTES, diffuse))
    changes = dict(zip(LIGHT, made(used, model="full").light_effects(normal(tilt, [azimuth])), strict=True))
    top = extraterrestrial(history.time_ns)
    ghi = DIRECT_W_M2 * np.cos(np.radians(40.0)) + diffuse
    prior, light = Prior(), (40.0, 180.0, DIRECT_W_M2, ghi, diffuse, top)

    def over_level(sky: str, albedo: float = 0.2) -> np.ndarray:
        options = {"albedo": albedo, "model": sky, "airmass": None}
        steep, level = (
            pvlib.irradiance.get_total_irradiance(angle, azimuth, *light, **options)["poa_global"]
            for angle in (tilt, 0.0)
        )
        return np.asarray(steep - level)

    beam = DIRECT_W_M2 + diffuse * (DIRECT_W_M2 / top) / np.cos(np.radians(40.0))
    expected = {
        "circumsolar": (over_level("haydavies") - over_level("isotropic"))
        * np.hypot(0.5, prior.circumsolar_sd),
        "brightening": (over_level("perez") - over_level("haydavies"))
        * np.hypot(prior.brightening_share, prior.brightening_sd),
        "ground albedo": over_level("haydavies", 0.3) - over_level("haydavies"),
    }
    for name, w_m2 in expected.items():
        assert changes[name][0] * beam == pytest.approx(w_m2, rel=0.01), name
