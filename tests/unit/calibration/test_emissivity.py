"""Days whose truth is known; sensitivities from the formula of one pair (GUM, JCGM 100)."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from fieldkit.calibration.band import CameraBand, own_part_k
from fieldkit.calibration.emissivity import (
    DEFAULT_SHARED_UNCERTAINTIES,
    Pairs,
    SharedUncertainties,
    fit_emissivity,
    mirrored_temperature_k,
)
from fieldkit.calibration.foil import FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD
from fieldkit.calibration.uncertainty import effective_freedom
from fieldkit.model.errors import CalibrationError
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS
from fieldkit.physics.radiance import brightness_temperature_k
from fieldkit.recording.simulated_scene import FOIL_ALBEDO
from fieldkit.simulation import Facet, MeasuredSky, Scene
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from fieldkit.weather import packaged_day
from tests.harness.emissivity_days import OUTLINE, days, drawn_free_days, free_days, make_day

NO_ERROR = SharedUncertainties(*(0.0,) * 7)


def pairs(surface_c=(35.0, 45.0, 55.0), *, emissivity=0.90, sky_c=-40.0, noise_k=0.1) -> Pairs:
    """What faultless instruments read."""
    surface = np.asarray(surface_c) + CELSIUS_ZERO_K
    sky, sd = np.full(surface.size, sky_c + CELSIUS_ZERO_K), np.full(surface.size, noise_k)
    return Pairs(brightness_temperature_k(surface, emissivity, sky), surface, sky, sd, sd)


@pytest.mark.parametrize("emissivity", [0.70, 0.90, 0.98])
@pytest.mark.parametrize("reflected", ["fixed", "free"])
def test_faultless_pairs_give_the_emissivity_and_the_reflected_temperature(emissivity, reflected):
    found = fit_emissivity(pairs(emissivity=emissivity), NO_ERROR, reflected=reflected)
    assert found.value == pytest.approx(emissivity, abs=1e-5)
    assert found.reflected_k == pytest.approx(233.15, abs=0.2)
    assert found.freedom == (2 if reflected == "fixed" else 1)


@pytest.mark.parametrize(
    ("name", "shared", "effect"),
    [
        # u(eps) = eps M'(T) u / |M(T) - M(T_refl)| and its like for camera and sky, at 45 °C, -40 °C, 0.90
        ("thermometer calibration", replace(NO_ERROR, thermometer_k=0.5), 0.008),
        ("probe to skin temperature", replace(NO_ERROR, probe_to_skin_k=1.5), 0.023),
        ("camera offset", replace(NO_ERROR, camera_k=1.15), 0.020),
        ("reflected temperature", replace(NO_ERROR, reflected_k=5.0), 0.003),
        ("air in between", replace(NO_ERROR, transmission=0.004), 0.004),
    ],
)
def test_each_line_of_the_budget_has_its_known_size_and_the_largest_is_named(name, shared, effect):
    found = fit_emissivity(pairs((45.0, 45.0, 45.0), noise_k=0.01), shared)
    line = next(one for one in found.budget if one.name == name)
    assert abs(line.effect) == pytest.approx(effect, abs=0.0015)
    assert found.largest.name == name
    assert found.expanded == pytest.approx(2 * np.hypot(line.effect, found.budget[0].effect), rel=1e-6)


def test_tape_stands_in_for_a_thermometer_and_the_cameras_offset_mostly_cancels():
    truth, offset = pairs(emissivity=0.92), 1.0
    tape_seen = brightness_temperature_k(truth.contact_k, 0.95, truth.reflected_k) + offset
    surface = own_part_k(tape_seen, 0.95, truth.reflected_k)
    given = replace(truth, apparent_k=truth.apparent_k + offset, contact_k=surface)
    tape = {"tape_emissivity": 0.95, "tape_emissivity_sd": 0.01}
    found = fit_emissivity(given, SharedUncertainties(camera_k=1.0), **tape)
    assert found.value == pytest.approx(0.92, abs=0.002)
    assert "tape" in found.largest.name
    assert found.standard_uncertainty == pytest.approx(0.92 / 0.95 * 0.01, rel=0.3)
    assert not any("thermometer" in line.name for line in found.budget)


@pytest.mark.parametrize("reflected", ["fixed", "free"])
@pytest.mark.parametrize("emissivity", [0.90, 0.95, 0.98])
@pytest.mark.parametrize("name", ["reflected temperature", "camera offset"])
def test_with_a_tape_the_budget_says_what_working_it_all_out_again_would(emissivity, reflected, name):
    truth = pairs(emissivity=emissivity)
    tape_seen = brightness_temperature_k(truth.contact_k, 0.95, truth.reflected_k)

    def found(camera_k: float = 0.0, sky_k: float = 0.0):
        sky = truth.reflected_k + sky_k
        given = replace(
            truth, apparent_k=truth.apparent_k + camera_k, reflected_k=sky,
            contact_k=own_part_k(tape_seen + camera_k, 0.95, sky),
        )  # fmt: skip
        return fit_emissivity(given, reflected=reflected, tape_emissivity=0.95, tape_emissivity_sd=0.01)

    again = found(sky_k=5.0) if name == "reflected temperature" else found(camera_k=0.3)
    line = next(one for one in found().budget if one.name == name)
    assert line.effect == pytest.approx(again.value - found().value, abs=2e-5)


def test_a_cameras_constants_r_and_o_fall_out_and_its_band_is_used():
    """R1 14364.633, B 1385.4, F 1, O -5753 are of a FLIR camera's file."""
    plain, full = CameraBand(1385.4), CameraBand(1385.4, 1.0, 14364.633 / 0.0106, -5753.0)
    one, other = (fit_emissivity(pairs(), NO_ERROR, band=band).value for band in (plain, full))
    assert one == pytest.approx(other, abs=1e-6)
    assert one == pytest.approx(0.90, abs=0.01)  # the flat band made them


FOUR = pairs((35.0, 40.0, 45.0, 50.0))


def in_fahrenheit(given: Pairs) -> Pairs:
    """The thermometer's numbers of °F taken for °C."""
    return replace(given, contact_k=(given.contact_k - CELSIUS_ZERO_K) * 1.8 + 32.0 + CELSIUS_ZERO_K)


def applied_twice(given: Pairs) -> Pairs:
    """Corrected by the camera, then again."""
    return replace(given, apparent_k=own_part_k(given.contact_k, 0.90, given.reflected_k))


@pytest.mark.parametrize(
    ("given", "options", "said", "fix"),
    [
        (pairs((45.0, 50.0)), {}, "2 steady pairs", "3 temperatures"),
        (pairs((20.0, 24.0, 30.0), sky_c=18.0), {}, "from what it reflects", "heat the sample"),
        (pairs((22.0, 24.0, 26.0), sky_c=18.0), {"shared": NO_ERROR}, "not 10 K", "heat the sample"),
        (pairs((40.0, 44.0, 48.0)), {"reflected": "free"}, "spans 8 K", "foil"),
        (pairs(noise_k=8.0), {}, "not determined", "scatter of the pairs"),
        (pairs(()), {}, "0 steady", "3 temperatures"),
        (replace(pairs(), reflected_k=np.full(3, np.nan)), {}, "this band", "check band"),
        (in_fahrenheit(pairs()), {}, "0.90", ""),
        (applied_twice(pairs()), {"shared": NO_ERROR}, "is impossible", "camera applies none"),
        (replace(FOUR, contact_k=np.add(FOUR.contact_k, (0.0, 4.0, -4.0, 0.0))), {}, "chi-square 39.", ""),
    ],
)
def test_what_data_do_not_determine_is_refused_with_what_would(given, options, said, fix):
    with pytest.raises(CalibrationError) as refused:
        fit_emissivity(given, **options)
    assert said in refused.value.message
    assert fix in str(refused.value.fix)
    assert refused.value.exit_code == 8


def test_what_is_blacker_than_soils_is_a_remark():
    assert fit_emissivity(pairs(emissivity=1.0, sky_c=-20.0)).remarks


def test_more_scatter_leaves_more_effective_degrees_of_freedom_to_the_fit():
    quiet, loud = (fit_emissivity(pairs(noise_k=noise)) for noise in (0.05, 1.5))
    freedom = [effective_freedom(fit.budget, fit.freedom) for fit in (loud, quiet)]
    assert freedom[0] < 30 < freedom[1]
    assert DEFAULT_SHARED_UNCERTAINTIES.probe_to_skin_k == quiet.largest.uncertainty


def test_the_truth_lies_inside_the_stated_interval_as_often_as_it_says():
    """k = 2 of a normal error is 95 %; with 300 days 95 +- 1.3 % is one standard deviation."""
    inside, refused, undetermined = [], [], []
    for day in days(300, seed=11):
        try:
            found = fit_emissivity(day.pairs, day.shared)
            inside.append(abs(found.value - day.emissivity) <= found.expanded)
            refused.append(False)
        except CalibrationError:
            refused.append(True)
        undetermined.append(day.expected_sd)
    sd, no = np.array(undetermined), np.array(refused)
    assert 0.92 <= np.mean(inside) <= 0.98
    assert np.mean(no[sd < 0.025]) <= 0.01
    assert np.mean(no[sd > 0.10]) >= 0.95


@pytest.mark.parametrize("count", [75, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", ["measured", "still", "sky 5 K", "probe", "clock"])
def test_without_a_foil_the_interval_allows_for_a_sky_that_drifts_and_a_probe_that_follows_the_heat(
    case, count
):
    """On days with the drifts that were measured k = 2 holds the truth on 96 of a hundred."""
    inside = []
    for day in free_days(count, case):
        with suppress(CalibrationError):
            found = fit_emissivity(day.pairs, day.shared, reflected="free")
            inside.append(abs(found.value - day.emissivity) <= found.expanded)
    assert len(inside) >= 0.97 * count  # the others leave more than 0.05 of doubt
    assert np.mean(inside) >= 0.92
    if case == "measured":
        assert np.mean(inside) <= 0.985


@pytest.mark.parametrize("count", [150, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("tape", [False, True])
def test_without_a_foil_the_stated_interval_is_neither_too_wide_nor_too_narrow(tape, count):
    """With a tape the drift of the sky counted as if the tape reflected no sky: three times too wide."""
    options = {"tape_emissivity": 0.95, "tape_emissivity_sd": 0.01} if tape else {}
    off = []
    for day in drawn_free_days(count, tape):
        with suppress(CalibrationError):
            found = fit_emissivity(day.pairs, day.shared, reflected="free", **options)
            off.append((found.value - day.emissivity) / found.standard_uncertainty)
    assert len(off) > 0.97 * count
    assert 0.92 <= np.mean(np.abs(off) <= 2.0) <= 0.985
    assert 0.75 <= np.std(off) <= 1.1


def test_the_budget_of_a_free_mirror_says_what_a_drifting_sky_would_do():
    """A sky 3 K warmer with the warmest sand, colder with the coldest, worked out from the truth."""
    surface, half = np.linspace(300.0, 330.0, 7), np.linspace(-1.0, 1.0, 7)
    sd = np.full(7, 0.05)
    given = [
        Pairs(brightness_temperature_k(surface, 0.90, 253.15 + drift), surface, np.full(7, 150.0), sd, sd)
        for drift in (0.0, 3.0 * half)
    ]
    still, drifting = (fit_emissivity(one, reflected="free") for one in given)
    line = next(one for one in still.budget if one.name == "drift of the sky")
    assert line.uncertainty == DEFAULT_SHARED_UNCERTAINTIES.sky_drift_k == 3.0
    # once more as much as the reflectance is itself in doubt with it
    assert line.effect == pytest.approx(drifting.value - still.value, rel=0.4)
    no_drift = SharedUncertainties(sky_drift_k=0.0, probe_gradient_k=0.0)
    stated = fit_emissivity(given[0], no_drift, reflected="free")
    assert stated.expanded < 0.5 * still.expanded


def test_a_foil_that_follows_the_sky_needs_no_row_for_its_drift():
    given = pairs()
    followed = replace(given, reflected_k=given.reflected_k + np.array([-5.0, 0.0, 5.0]))
    assert not any("drift" in line.name for line in fit_emissivity(followed).budget)
    assert any("drift" in line.name for line in fit_emissivity(given).budget)


def test_what_a_foil_emits_itself_does_not_pass_for_a_warmer_sky():
    """A foil of 0.04 at 280 K under a sky of 225 K reads 0.04 M(280) + 0.96 M(225)."""
    seen = brightness_temperature_k(280.0, 0.04, 225.0)
    assert seen == pytest.approx(228.3, abs=0.1)
    assert mirrored_temperature_k(seen, 280.0, 0.04) == pytest.approx(225.0, abs=0.01)
    assert mirrored_temperature_k(seen, 280.0, 0.0) == pytest.approx(seen, abs=0.01)


@pytest.mark.parametrize("emissivity", [0.75, 0.85, 0.95])
def test_the_foil_method_has_no_bias_on_the_simulated_field(emissivity):
    """Every noise taken away. The foil's own emission made it -0.002 to -0.008 on every day."""
    day = packaged_day()
    sand = Facet("sand", OUTLINE, emissivity=emissivity, emissivity_broadband=emissivity)
    foil = replace(sand, name="foil", albedo=FOIL_ALBEDO, emissivity=0.04, emissivity_broadband=0.04)
    scene = Scene(day.site, MeasuredSky(day), (sand, foil), ALAMOSA_NOON_NS, 4 * 3600.0)
    moments = [scene.at(scene.start_ns + minute * MINUTE_NS) for minute in range(0, 240, 20)]
    surface, seen, of_foil = np.array(
        [(one.surface_k[0], one.brightness_k[0], one.brightness_k[1]) for one in moments]
    ).T
    sd = np.full(surface.size, 0.05)
    mirror = mirrored_temperature_k(of_foil, seen, FOIL_EMISSIVITY)
    found = fit_emissivity(Pairs(seen, surface, mirror, sd, sd), foil_emissivity_sd=FOIL_EMISSIVITY_SD)
    assert found.value == pytest.approx(emissivity, abs=0.0015)
    assert any("foil" in line.name for line in found.budget)
    naive = fit_emissivity(Pairs(seen, surface, of_foil, sd, sd))
    assert naive.value < emissivity - 0.0015


def test_the_median_error_of_a_good_day_is_below_a_hundredth():
    random = np.random.default_rng(3)
    good = SharedUncertainties(camera_k=0.3, thermometer_k=0.5, probe_to_skin_k=0.0)
    errors = []
    for _ in range(100):
        day = make_day(
            random, emissivity=float(random.uniform(0.85, 0.98)), surface_k=318.15 + random.uniform(-6, 6, 8),
            probe_error_k=0.0, sky_k=233.15, thermometer_k=0.5, shared=good,
        )  # fmt: skip
        errors.append(abs(fit_emissivity(day.pairs, good).value - day.emissivity))
    assert np.median(errors) <= 0.01


def test_an_emissivity_above_1_within_its_uncertainty_says_what_to_write():
    """fieldkit.toml takes at most 1, so its record cannot be named there."""
    found = fit_emissivity(replace(pairs(emissivity=1.0), contact_k=pairs().contact_k - 0.3))
    assert 1.0 < found.value < 1.0 + found.expanded
    assert found.remarks[-1].endswith("write surface.emissivity = 1.0")
