"""Synthetic emissivity days: surfaces of the simulated field, and all that a day's instruments get wrong.

How warm the sand is, and how much heat goes into it (a probe one grain too deep is colder by that), comes
from the scene under a measured winter sky and a clear summer one. On every day the truth, the number of
pairs and each instrument's error are drawn anew; the fit is told only how large errors usually are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from fieldkit.calibration.band import own_part_k
from fieldkit.calibration.emissivity import Pairs, SharedUncertainties
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.radiance import band_radiance, band_temperature, brightness_temperature_k
from fieldkit.physics.slab import conducted_flux
from fieldkit.simulation import ClearSky, Facet, MeasuredSky, Scene
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from fieldkit.weather import packaged_day

STEADY_K_MIN = 0.1
CAMERA_K, PLACEMENT_K, NOISE_K, FOIL_K, AIR = 0.3, 0.15, 0.05, 5.0, 0.004
PROBE_K = 0.3  # one millimetre, give or take one, at 0.3 K/mm
SAND_W_M_K = 0.25
DEEPEST_M = 0.002
SUMMER_NS = int(np.datetime64("2017-08-30T00:00", "ns").astype(np.int64))  # 09:00 in Japan
OUTLINE = ((10.0, 10.0), (40.0, 10.0), (40.0, 40.0))


@dataclass(frozen=True)
class Surface:
    """Steady minutes of one bed: temperature (m,) in K, and heat flux into the sand (m,) in W/m2."""

    temperature_k: FloatArray
    flux_w_m2: FloatArray


@dataclass(frozen=True)
class Day:
    """One day: the truth, what was read, what the fit is told about errors."""

    emissivity: float
    surface_k: FloatArray
    sky_k: float
    pairs: Pairs
    shared: SharedUncertainties

    @property
    def expected_sd(self) -> float:
        """Uncertainty from the true temperatures by the formula of one pair, errors all shared."""
        surface = float(np.mean(self.surface_k))
        per_k = [float(band_radiance(t + 0.5) - band_radiance(t - 0.5)) for t in (surface, self.sky_k)]
        signal = abs(float(band_radiance(surface) - band_radiance(self.sky_k)))
        contact = np.hypot(self.shared.thermometer_k, self.shared.probe_to_skin_k)
        effects = (
            self.emissivity * per_k[0] * contact,
            per_k[0] * self.shared.camera_k,
            (1.0 - self.emissivity) * per_k[1] * self.shared.reflected_k,
        )
        return float(np.hypot(np.hypot(*effects[:2]), effects[2]) / signal)


@lru_cache(maxsize=1)
def surfaces() -> tuple[Surface, ...]:
    """Beds of three depths and two tilts, of a winter's day in Alamosa and a summer's in Japan."""
    beds = tuple(
        Facet(f"{tilt}-{depth_m}", OUTLINE, tilt, 180.0, depth_m=depth_m)
        for tilt in (0.0, 20.0)
        for depth_m in (0.02, 0.05, 0.30)
    )
    weather = packaged_day()
    scenes = (
        Scene(weather.site, MeasuredSky(weather), beds, ALAMOSA_NOON_NS - 240 * MINUTE_NS, 8 * 3600.0),
        Scene(Site(35.56, 139.40, 9.0), ClearSky(), beds, SUMMER_NS, 8 * 3600.0),
    )
    return tuple(surface for scene in scenes for surface in _steady(scene))


FreeCase = Literal["measured", "still", "sky 5 K", "sky 10 K", "probe", "clock"]
FLUX_SWING_W_M2 = 130.0  # from the coldest pair to the warmest, as on the simulated field in summer
MEASURED_DRIFT_K = (0.3, 1.9, 5.5, 1.8, 3.2)
"""How much a sky of 8-14 um warmed by day with the ground, half of it from the coldest minute to the warmest:
SURFRAD Alamosa 2015-12-31 and 2016-01-01 and Table Mountain 2017-01-05 (overcast, snow), ARM SGP E14
2019-06-01 and E39 2023-06-01, by regression on the ground's temperature from upwelling longwave."""
MEASURED_SWING_W_M2 = 90.0  # of the heat flux into the ground, the same of both ARM days
CLOCK_S, DRIFT_K_MIN = 90.0, 0.1  # the largest shift not refused, of a probe that just counts as steady


def free_days(count: int, case: FreeCase, seed: int = 5) -> Iterator[Day]:
    """Days without a foil, the surface over 18-40 K, of which one `case` says what drifts.

    The sky is colder or warmer by 5 or 10 K at the warmest pair and the other way at the coldest; the probe
    lies up to two millimetres deep in sand whose heat flow grows with its temperature. On ``measured`` days
    both drift as was measured. With a wrong ``clock`` each pair compares two moments 90 s apart.
    """
    random = np.random.default_rng(seed)
    for _ in range(count):
        emissivity, sky_k = random.uniform(0.85, 0.98), random.uniform(223.15, 263.15)
        span_k, warmest_k = random.uniform(18.0, 40.0), random.uniform(300.0, 330.0)
        share = np.concatenate([[0.0, 1.0], random.uniform(0.0, 1.0, 10)])
        drift_k = {"sky 5 K": 5.0, "sky 10 K": 10.0}.get(case, 0.0) * random.choice([-1.0, 1.0])
        swing_w_m2 = {"probe": FLUX_SWING_W_M2, "measured": MEASURED_SWING_W_M2}.get(case, 0.0)
        deep_k = random.uniform(0.0, DEEPEST_M) * swing_w_m2 / SAND_W_M_K
        if case == "measured":
            drift_k = float(random.choice(MEASURED_DRIFT_K))  # the sky is the warmer, the warmer the ground
        late_k = CLOCK_S / 60.0 * DRIFT_K_MIN * random.uniform(-1.0, 1.0, share.size) * (case == "clock")
        day = make_day(
            random, emissivity=float(emissivity), surface_k=warmest_k - span_k * share,
            probe_error_k=late_k - deep_k * (1.0 - share),
            sky_k=sky_k + drift_k * (1.0 - 2.0 * share), thermometer_k=0.3, shared=SharedUncertainties(),
        )  # fmt: skip
        nothing = np.full(share.size, 150.0)
        yield replace(day, pairs=replace(day.pairs, reflected_k=nothing))


def drawn_free_days(count: int, tape: bool, seed: int = 7) -> Iterator[Day]:
    """Days without a foil on which every error, also the drifts, is drawn as large as is stated.

    With `tape` its emissivity is 0.95, known to 0.01, and its temperature stands in for a thermometer: it
    reflects the same sky, and the camera sees it through the same air.
    """
    random = np.random.default_rng(seed)
    told = SharedUncertainties()
    for _ in range(count):
        share = np.concatenate([[0.0, 1.0], random.uniform(0.0, 1.0, 10)])
        surface_k = random.uniform(300.0, 330.0) - random.uniform(20.0, 40.0) * share
        position = 2.0 * (surface_k - surface_k.mean()) / np.ptp(surface_k)
        sky_k = random.uniform(223.15, 263.15) + told.sky_drift_k * random.standard_normal() * position
        gradient_k = told.probe_to_skin_k * random.standard_normal()
        gradient_k = gradient_k + told.probe_gradient_k * random.standard_normal() * position
        emissivity = float(random.uniform(0.85, 0.98))
        state = random.bit_generator.state
        day = make_day(
            random, emissivity=emissivity, surface_k=surface_k, probe_error_k=gradient_k, sky_k=sky_k,
            thermometer_k=told.thermometer_k, shared=told,
        )  # fmt: skip
        contact_k = day.pairs.contact_k
        if tape:
            beside = np.random.default_rng()
            beside.bit_generator.state = state  # the same camera and air
            of_tape = 0.95 + 0.01 * random.standard_normal()
            seen = make_day(
                beside, emissivity=of_tape, surface_k=surface_k, probe_error_k=0.0, sky_k=sky_k,
                thermometer_k=0.0, shared=told,
            )  # fmt: skip
            noisy_k = seen.pairs.apparent_k + NOISE_K * random.standard_normal(share.size)
            contact_k = own_part_k(noisy_k, 0.95, np.full(share.size, 150.0))
        yield replace(
            day, pairs=replace(day.pairs, contact_k=contact_k, reflected_k=np.full(share.size, 150.0))
        )


def _steady(scene: Scene) -> Iterator[Surface]:
    minutes = np.arange(480)
    curves = np.array([scene.at(scene.start_ns + int(m) * MINUTE_NS).surface_k for m in minutes]).T
    for facet, curve in zip(scene.facets, curves, strict=False):
        flux = conducted_flux(facet.stack[0], curve, 60.0)
        steady = np.abs(np.gradient(curve)) < STEADY_K_MIN
        steady[:60] = False  # the flux does not know what was before
        yield Surface(curve[steady], flux[steady])


def days(count: int, seed: int = 1) -> Iterator[Day]:
    """Days with emissivity 0.85-0.98, a sky of -60 to +20 °C, 3-20 pairs, a thermometer of 0.3-1 K."""
    random = np.random.default_rng(seed)
    beds = surfaces()
    for _ in range(count):
        bed = beds[int(random.integers(len(beds)))]
        at = random.choice(bed.temperature_k.size, int(random.integers(3, 21)), replace=False)
        buried_m = random.uniform(0.0, DEEPEST_M)
        yield make_day(
            random,
            emissivity=float(random.uniform(0.85, 0.98)),
            surface_k=bed.temperature_k[at],
            probe_error_k=-bed.flux_w_m2[at] * buried_m / SAND_W_M_K,
            sky_k=float(random.uniform(213.15, 293.15)),
            thermometer_k=float(random.uniform(0.3, 1.0)),
            shared=None,
        )


def make_day(
    random: np.random.Generator,
    *,
    emissivity: float,
    surface_k: FloatArray,
    probe_error_k: FloatArray | float,
    sky_k: FloatArray | float,
    thermometer_k: float,
    shared: SharedUncertainties | None,
) -> Day:
    """One day with these truths; instrument errors are drawn."""
    told = shared or SharedUncertainties(CAMERA_K, thermometer_k, PROBE_K, FOIL_K, AIR)
    count = surface_k.size
    seen = brightness_temperature_k(surface_k, emissivity, sky_k)
    through = 1.0 + told.transmission * random.standard_normal()
    seen = band_temperature(band_radiance(seen) * through)
    apparent = seen + told.camera_k * random.standard_normal() + NOISE_K * random.standard_normal(count)
    calibration = thermometer_k * random.standard_normal()
    contact = surface_k + probe_error_k + calibration + PLACEMENT_K * random.standard_normal(count)
    foil = np.full(count, sky_k + told.reflected_k * random.standard_normal())
    sds = np.full(count, NOISE_K), np.full(count, PLACEMENT_K)
    return Day(emissivity, surface_k, float(np.mean(sky_k)), Pairs(apparent, contact, foil, *sds), told)
