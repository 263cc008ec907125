"""What a recording for an emissivity reports and when it ends, on synthetic probes and frames."""

import math
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fieldkit.calibrate.emissivity_live import SteadyView, apart
from fieldkit.calibrate.guidance import probe_depth_mm, remedy, seconds_to_next, tilt_effect
from fieldkit.calibrate.measurement import ReadingCollector
from fieldkit.calibration.emissivity import SharedUncertainties, fit_emissivity
from fieldkit.calibration.steady_pairs import Readings
from fieldkit.config import load_config
from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.energy_balance import irradiance_difference
from fieldkit.physics.radiance import brightness_temperature_k, surface_temperature_k
from tests.unit.calibrate.test_measurement import frame, made, reading
from tests.unit.calibration.test_emissivity import pairs

SETTINGS = EstimatorSettings()
CORNERS = [[1, 1], [20, 1], [20, 20]]
BEDS = [
    {"name": "flat", "kind": "reference", "points_px": CORNERS, "tilt_deg": 0.0},
    {"name": "b25", "points_px": CORNERS, "tilt_deg": 25.0, "azimuth_deg": 180.0},
]
FLAT = Region("flat", RegionKind.REFERENCE, (), 0.0, 180.0)
STEEP = Region("b25", RegionKind.TARGET, (), 25.0, 180.0)
FIT = fit_emissivity(pairs())


def minute(dni_w_m2: float = 900.0, **kelvin: float) -> Minute:
    sun = {"sun_zenith_deg": 55.0, "sun_azimuth_deg": 180.0}
    light = {"illuminance_lx": math.nan, "dni_w_m2": dni_w_m2, "irradiance_model": "given", **sun}
    return Minute(0, (), kelvin, {}, {}, **light, contact_k=(), flags=Quality.GOOD, events=())


def plateau(start_s: int, kelvin: float, view: SteadyView) -> None:
    """Twelve minutes of a surface and a probe that stay where they are."""
    seen_k = float(brightness_temperature_k(kelvin, 0.9, 240.0))
    for second in range(start_s, start_s + 720, 5):
        if second % 20 == 0:
            view.show(frame(second, sand=seen_k, foil=240.0))
        view.show(reading(second, kelvin, kelvin, 290.0))


class Watched:
    """A view of a measurement, and what it reported."""

    def __init__(self, tmp_path, **options: Any) -> None:
        path = tmp_path / "fieldkit.toml"
        path.write_text(campaign_toml({**SIMULATED, "region": BEDS}), encoding="utf-8")
        self.lines, self.progress, self.ended = list[str](), list[dict[str, Any]](), threading.Event()
        self.view = SteadyView(
            ReadingCollector(made(**options)), load_config(path), self.lines.append,
            lambda text, values: self.progress.append(dict(values)), self.ended.set,
        )  # fmt: skip


def test_temperatures_closer_than_five_kelvin_count_once():
    assert apart([300.0, 301.0, 304.9, 305.0, 309.0, 311.0]) == [300.0, 305.0, 311.0]


def test_the_recording_is_sealed_at_the_wanted_number_of_temperatures_and_not_before(tmp_path):
    watched = Watched(tmp_path, temperatures=3)
    view, warm = watched.view, minute(flat=300.0, b25=312.0)
    for number, kelvin in enumerate((300.0, 310.0), 1):
        plateau(900 * number, kelvin, view)
        view.show(warm)
        assert not watched.ended.is_set()
        assert f"{number} of 3" in watched.lines[-1]
    assert "36.9 °C" in watched.lines[-1] or "36.8 °C" in watched.lines[-1]
    assert "steady" in watched.lines[-1]
    view.show(warm)
    assert len(watched.progress) == 2  # nothing is new
    plateau(2700, 320.0, view)
    view.show(warm)
    assert watched.ended.is_set()
    assert "3 of 3" in watched.lines[-1]
    last = watched.progress[-1]
    assert (last["temperatures"], last["wanted"], last["region"]) == (3, 3, "b25")
    assert last["enough"] in ("yes", "no")
    assert last["emissivity"] == pytest.approx(0.9, abs=0.01)
    view.close()


def test_without_a_frame_the_recording_reports_what_is_missing(tmp_path):
    watched = Watched(tmp_path)
    watched.view.show(minute())
    assert "frames" in watched.lines[-1]
    assert not watched.ended.is_set()


def tilt_deg(emissivity: float, seen_k: tuple[float, float]) -> float:
    """Tilt towards a sun 55 degrees from the zenith, by eq. (6) from what is seen of bed and ground."""
    bed_k, flat_k = (surface_temperature_k(kelvin, emissivity, 250.0) for kelvin in seen_k)
    share = float(irradiance_difference(bed_k, flat_k, SETTINGS.surface)) / 900.0
    return 55.0 - math.degrees(math.acos(math.cos(math.radians(55.0)) + share))


def test_an_uncertain_emissivity_is_worth_the_tilt_that_another_one_gives():
    settings = replace(SETTINGS, reflected_temperature_k=250.0)
    own = settings.surface.emissivity
    flat_k, bed_k = 300.0, 300.0
    while tilt_deg(own, seen := (float(brightness_temperature_k(bed_k, own, 250.0)), 297.0)) < 25.0:
        bed_k += 0.05
    flat_k = float(surface_temperature_k(seen[1], own, 250.0))
    region, _, degrees = tilt_effect(FIT, minute(flat=flat_k, b25=bed_k), [FLAT, STEEP], settings)
    nearby = abs(tilt_deg(own + 0.002, seen) - tilt_deg(own - 0.002, seen)) / 0.004
    assert region == "b25"
    # to first order: a kelvin of the ground counts as much as one of the warmer bed
    assert degrees == pytest.approx(nearby * FIT.expanded, rel=0.2)


@pytest.mark.parametrize(
    ("beds", "light"), [([FLAT], 900.0), ([STEEP], 900.0), ([FLAT, STEEP], 0.0), ([FLAT, STEEP], math.nan)]
)
def test_without_bed_reference_or_sun_no_tilt_is_stated(beds, light):
    assert math.isnan(tilt_effect(FIT, minute(light, flat=300.0, b25=310.0), beds, SETTINGS)[2])


def test_scatter_is_cured_by_time_and_what_is_shared_is_not():
    noisy = fit_emissivity(pairs(noise_k=1.0), SharedUncertainties(*(1e-4,) * 7))
    # twice as good takes four times the pairs: 3 more times 3, five minutes each
    assert "45 min" in remedy(noisy, 2.0)
    assert FIT.largest.name in remedy(FIT, 2.0)


def ramp(k_min: float) -> Readings:
    second = np.arange(0, 1200, 10)
    kelvin, nothing = 300.0 + k_min * second / 60.0, np.zeros(0)
    return Readings(nothing.astype(np.int64), nothing, nothing, second * 10**9, kelvin)


@pytest.mark.parametrize(
    ("k_min", "levels_k", "wait_min"),
    [
        (0.2, [300.0], 5.0 / 0.2 - 1190 / 60),
        (0.2, [300.0, 306.0], 11.0 / 0.2 - 1190 / 60),  # 305 K is too near to the second
        (-0.2, [300.0], 5.0 / 0.2 - 1190 / 60),
        (0.2, [], math.nan),
        (0.001, [300.0], math.nan),
        (0.0, [300.0], math.nan),
    ],
)
def test_the_time_to_the_next_temperature_follows_from_the_drift(k_min, levels_k, wait_min):
    assert seconds_to_next(ramp(k_min), levels_k) == pytest.approx(60.0 * wait_min, rel=1e-6, nan_ok=True)


def conducted(depth_mm: int) -> Readings:
    """A probe in sand whose surface a board shades for 40 min of every 80, by explicit finite differences."""
    sand, surface, probe = np.full(200, 300.0), [], []
    number = 0.25 / 1.3e6 / 1e-3**2  # of 1 mm and 1 s: 0.19, stable below 0.5
    for second in range(9600):
        sand[0] = 300.0 + 10.0 * (1 if second // 2400 % 2 == 0 else -1) * -math.expm1(-(second % 2400) / 400)
        sand[1:-1] += number * np.diff(sand, 2)
        surface.append(sand[0])
        probe.append(sand[depth_mm])
    at = np.arange(9600)
    return Readings(
        at[::30] * 10**9,
        np.array(surface)[::30],
        np.full(320, 233.0),
        at[::10] * 10**9,
        np.array(probe)[::10],
    )


@pytest.mark.parametrize(("depth_mm", "low", "high"), [(2, 0.0, 0.0), (10, 8.0, 14.0), (20, 15.0, 23.0)])
def test_a_probe_that_lags_is_too_deep(depth_mm, low, high):
    assert low <= probe_depth_mm(conducted(depth_mm), SETTINGS) <= high
