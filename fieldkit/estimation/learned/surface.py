"""Model of the surface: what the temperatures of a minute are, and what flows into the ground, by the state.

Given a hypothesis, temperatures depend linearly on everything else that is unknown: the stores of each layer
warm by the net flux, and that is linear in a normal times the gain, in gusts, longwave, air. The flux depends
on the temperature itself, so it is taken at a predicted one and corrected to first order for the difference:
noise of the camera stays noise and does not turn into heat. Where two unknowns multiply each other (share of
diffuse light and normal), the product is taken to first order around a given state.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.distributions import normal_cdf
from fieldkit.estimation.learned.bank import Affine, Transition
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs
from fieldkit.estimation.learned.layout import GUSTS, Layout
from fieldkit.estimation.learned.noise import Noise
from fieldkit.estimation.learned.prior_state import DRYING_MINUTES, air_change_k, processes
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.shade_evidence import HIDDEN
from fieldkit.estimation.surface_kinds import Unlike
from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.layer_modes import RATES_PER_S, layer_modes

MINUTE_S = 60.0
_LOSSY: FloatArray = RATES_PER_S[1:]
FADE: FloatArray = np.concatenate([[1.0, 1.0], np.exp(-_LOSSY * MINUTE_S)])
"""Share of the level and of each store that is left after a minute."""
FILL: FloatArray = np.concatenate([[0.0, MINUTE_S], (1.0 - FADE[2:]) / _LOSSY])
"""Seconds of flux that a minute leaves in them."""
MEAN: FloatArray = np.concatenate([[1.0, 1.0], (1.0 - FADE[2:]) / (_LOSSY * MINUTE_S)])
"""Their mean over a minute without flux, as a share of the first value."""
MEAN_FILL: FloatArray = np.concatenate([[0.0, MINUTE_S / 2.0], (1.0 - MEAN[2:]) / _LOSSY])
"""The same of what a minute's flux adds, in seconds."""
MOMENT_SHARE = 0.2
"""The surface's mean over a minute depends on when the light changed; as a share of the change.

Judged: because a change at once, at any time of the minute alike, would be 1/sqrt(12) = 0.29, and most take
longer.
"""
EDGE_SHARE = 0.3
"""Direct light of a minute in which a board came or went, as a standard deviation around one half.

A board that comes at any time of the minute alike: 1/sqrt(12) = 0.29.
"""
BOARD_SD_W_M2 = 60.0
"""Longwave of a board instead of the sky's, and the skylight that comes in below it.

Judged: because a board that is 10 K warmer or colder radiates 60 W/m2 more or less, 4 sigma T**3 x 10 K.
"""
LOWEST_SUN = 0.05
"""Sine of the sun's elevation, 3 degrees, below which skylight around the sun grows no more.

Judged: because it is divided by the sine, which the sun's own width and the horizon's haze keep from zero.
"""
_ROOT_TWO_PI = float(np.sqrt(2.0 * np.pi))
_LEAST_SD = 1e-4
"""Least deviation of a cosine; keeps ratios to it finite where a reference's slope is exactly known."""


class Light(NamedTuple):
    """The sun on regions (p, regions), of a cosine times the gain that is known to within an sd.

    `share` is the probability that the sun stands above the surface, `mean` and `sd` those of the lit cosine,
    whose part without the linear one is `left`.
    """

    share: FloatArray
    mean: FloatArray
    left: FloatArray
    sd: FloatArray


class SurfaceModel:
    """Equations of all regions of a layout under p hypotheses; products around a state (n,)."""

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        settings: EstimatorSettings,
        logged: Logged,
        around: FloatArray,
        noise: Noise,
    ) -> None:
        self.layout = layout
        self.hypotheses = hypotheses
        self.settings = settings
        layers = {surface: self._layer(surface) for surface in dict.fromkeys(layout.unlike)}
        self._quick, self._weights = (
            np.stack([layers[surface][part] for surface in layout.unlike], axis=1) for part in (0, 1)
        )
        self._exchange = hypotheses.exchange[:, np.newaxis] * layout.exchanges
        self._processes = processes(layout, settings.prior, hypotheses, logged, noise)
        self._normals = self._views()
        self._around = _possible(layout, around)

    def _layer(self, unlike: Unlike) -> tuple[FloatArray, FloatArray]:
        """Warming within a minute by its own flux (p,), and by level and stores (p, STORES)."""
        drawn, capacity = self.hypotheses, self.settings.slab.heat_capacity_j_m3_k
        modes = layer_modes(drawn.inertia * unlike.inertia, drawn.depth_m * unlike.depth, capacity)
        weights = np.column_stack([np.ones_like(modes.resistance), modes.weights])
        # a minute's flux warms the surface at once, and its mean by what fills the stores meanwhile
        return modes.resistance + weights @ MEAN_FILL, weights

    # --- from one minute to the next

    def transition(self, minute: MinuteInputs, flux: Affine) -> Transition:
        """Into a minute, from the one with this flux: stores fade and take it, processes relax."""
        decay = self._decay.copy()
        decay[self.layout.place("board")] = float(minute.shaded.any())
        return Transition(decay, self._into, flux, self.layout.drives)

    def noise(self, minute: MinuteInputs) -> FloatArray:
        """Variances (p, n) that a minute begins with or adds."""
        variance = np.zeros((self.hypotheses.exchange.size, self.layout.size))
        for place, (sd, _) in self._processes.items():
            # x' = a x + w keeps its variance s^2 if w has s^2 (1 - a^2)
            variance[:, place] = sd**2 * (1.0 - self._decay[place] ** 2)
        for place, passing in self.passing(minute).items():
            variance[:, place] = passing
        if minute.air_returns:  # what was wrong with the guess is no error of the thermometer
            variance[:, self.layout.place("air")] = self.settings.prior.air_unlogged_sd_k**2
        if minute.air_stale_h > 0.0:
            drive = self.layout.place("air_change_drive")
            change = air_change_k(self.hypotheses, self.settings.prior, is_logged=False)
            variance[:, drive] = change**2 * (1.0 - self._decay[drive] ** 2)
        return variance

    def passing(self, minute: MinuteInputs) -> dict[int, float]:
        """Variances by place of what lasts one minute, and of the board while there is none."""
        change, prior = minute.direct_change, self.settings.prior
        sds = {
            "beam": math.hypot(prior.beam_change_share * change, minute.gap_sd),
            "moment": MOMENT_SHARE * change,
            "edge": EDGE_SHARE * minute.direct,
            # a shutter or the housing's warmth moves all regions together
            "camera": prior.camera_noise_k,
            "board": 0.0 if minute.shaded.any() else BOARD_SD_W_M2,
        }
        return {self.layout.place(name): sd**2 for name, sd in sds.items()}

    @cached_property
    def _decay(self) -> FloatArray:
        """Share (n,) of each place that is left after a minute."""
        layout = self.layout
        decay = np.ones(layout.size)
        for region in range(layout.regions):
            decay[layout.stores(region)] = FADE
        for place, (_, minutes) in self._processes.items():
            decay[place] = np.exp(-1.0 / minutes)
        decay[layout.smooth] = decay[layout.drives]
        for target in range(layout.targets):
            decay[layout.drying(target)] = np.exp(-1.0 / DRYING_MINUTES)
        # what one minute brings is not left in the next
        for name in ("beam", "moment", "edge", "camera"):
            decay[layout.place(name)] = 0.0
        return decay

    @cached_property
    def _into(self) -> FloatArray:
        """Stores that each flux fills, and what each drive moves (stores + smooth, regions + drives)."""
        layout = self.layout
        # what follows a drive d: x' = a x + (1 - a) d
        filled, moved = np.kron(np.eye(layout.regions), FILL[:, np.newaxis]), 1.0 - self._decay[layout.smooth]
        return np.block(
            [
                [filled, np.zeros((len(filled), moved.size))],
                [np.zeros((moved.size, layout.regions)), np.diag(moved)],
            ]
        )

    # --- within a minute

    def readings(self, minute: MinuteInputs, temperature: Affine) -> Affine:
        """Temperatures of the regions as the camera shows them."""
        layout, rows = self.layout, temperature.rows.copy()
        rows[:, :, layout.place("camera")] += 1.0
        for region in range(layout.regions):
            rows[:, region, layout.own(region)] += 1.0
        for region in range(1, layout.regions):
            rows[:, region, layout.offset(region)] += 1.0
            rows[:, region, layout.drift(region)] += minute.hours
        return Affine(rows, temperature.constant)

    def light(self, minute: MinuteInputs, mean: FloatArray, covariance: FloatArray) -> Light:
        """The sun on each region, by what each filter knows of its normal: max(0, x) of a normal x.

        Near grazing light is no linear function of the normal; the best line has the slope P(x > 0), as in
        statistical linearization (A. Gelb, Applied Optimal Estimation, MIT Press, 1974, section 6.2).
        """
        places = np.flatnonzero(self._normals.any(axis=(0, 2)))
        towards = (self._normals @ minute.sun)[:, places]
        about = mean[:, places] @ towards.T
        variance = np.sum((towards @ covariance[:, places[:, np.newaxis], places]) * towards, axis=2)
        sd = np.sqrt(np.maximum(variance, _LEAST_SD**2))
        ratio = np.clip(about / sd, -30.0, 30.0)
        share, bell = normal_cdf(ratio), np.exp(-0.5 * ratio**2) / _ROOT_TWO_PI
        # mean and mean square of max(0, x), with x of N(m, s^2) and r = m / s:
        # m P(r) + s p(r) and (m^2 + s^2) P(r) + m s p(r)
        lit = about * share + sd * bell
        second = (about**2 + sd**2) * share + about * sd * bell
        # variance that the line of slope `share` does not follow
        remainder = second - lit**2 - share**2 * sd**2
        return Light(share, lit, lit - share * about, np.sqrt(np.maximum(remainder, 0.0)))

    def by_normal(self, minute: MinuteInputs) -> FloatArray:
        """Light and longwave (3,) that a lit target, nowhere shaded, absorbs by its normal times the gain."""
        ones = np.ones((1, self.layout.regions))
        open_ = replace(minute, shaded=0.0 * ones[0], sunlit=ones[0])
        light = Light(ones, 0.0 * ones, 0.0 * ones, 0.0 * ones)
        return self._sources(open_, light).rows[0, self.layout.region(0), self.layout.normal(0)]

    def warming(self, minutes: int) -> tuple[FloatArray, FloatArray]:
        """Warming of the first region's layer, by the first hypothesis, over minutes.

        By 1 W/m2 in each minute, (minutes, minutes), and by the stores before the first, (minutes, STORES).
        """
        from scipy.linalg import toeplitz

        ages = np.arange(minutes)[:, np.newaxis]
        fading = self._weights[0, 0] * MEAN * FADE**ages
        # a minute's own flux warms at once, an earlier one by what its stores have left
        later = np.append(self._quick[0, 0], fading[:-1] @ FILL)
        return np.asarray(toeplitz(later, np.zeros(minutes))), np.asarray(fading)

    def grazing_k2(
        self, minute: MinuteInputs, light: Light, mean: FloatArray, taken_k: FloatArray
    ) -> FloatArray:
        """Variance (p, regions) of a minute's temperatures from light that no line follows, K2."""
        warmed = self._quick / (1.0 + self._quick * self._steepness(minute, mean, taken_k))
        direct = minute.direct * self.layout.absorbs * _beam(minute)
        return np.asarray((warmed * direct * light.sd) ** 2)

    def equations(
        self, minute: MinuteInputs, light: Light, mean: FloatArray, taken_k: FloatArray
    ) -> tuple[Affine, Affine]:
        """Mean temperature and net flux of each region in a minute, at states near `mean` (p, n).

        `taken_k` (p, regions) are temperatures to begin with.
        """
        sources = self._sources(minute, light)
        # first at the last prediction, then at this one, which knows of a cloud, and unlike the measurement
        # nothing of its noise
        for _ in range(2):
            temperature, flux = self._linearise(minute, sources, mean, taken_k)
            taken_k = temperature.at(mean)
        return temperature, flux

    def flux(self, minute: MinuteInputs, light: Light, taken_k: FloatArray) -> Affine:
        """Net flux of each region at temperatures `taken_k` (p, regions)."""
        return self._flux(minute, self._sources(minute, light), taken_k)

    def _linearise(
        self, minute: MinuteInputs, sources: Affine, mean: FloatArray, taken_k: FloatArray
    ) -> tuple[Affine, Affine]:
        """Mean temperature and net flux; the flux is taken at `taken_k` and corrected to first order."""
        flux = self._flux(minute, sources, taken_k)
        steepness, quick = self._steepness(minute, mean, taken_k), self._quick
        # the flux q - L (T - T0) warms the surface at once by T = R q + stores: solved for T
        damping = 1.0 / (1.0 + quick * steepness)
        rows = quick[..., np.newaxis] * flux.rows
        beam, moment = self.layout.place("beam"), self.layout.place("moment")
        # a mean that came too early or late is of the surface alone: the ground takes up the right flux
        rows[:, :, moment] = quick * flux.rows[:, :, beam]
        for region in range(self.layout.regions):
            rows[:, region, self.layout.stores(region)] += self._weights[:, region] * MEAN
        for target in range(self.layout.targets):
            region = self.layout.region(target)
            # another inertia is another share of what the layer has warmed so far
            warmed = taken_k[:, region] - mean[:, self.layout.stores(region).start]
            rows[:, region, self.layout.own_response(target)] += warmed
        rows *= damping[..., np.newaxis]
        constant = damping * quick * (flux.constant + steepness * taken_k)
        # the flux was taken at `taken_k`: what the surface loses for being off it
        lost = Affine(steepness[..., np.newaxis] * rows, steepness * (constant - taken_k))
        return Affine(rows, constant), Affine(flux.rows - lost.rows, flux.constant - lost.constant)

    def _flux(self, minute: MinuteInputs, sources: Affine, taken_k: FloatArray) -> Affine:
        """Net flux of each region at temperatures `taken_k` (p, regions)."""
        place = self.layout.place
        rows, further = sources.rows.copy(), self._around[place("session_exchange")] * self.layout.exchanges
        over_air, exchange = taken_k - minute.air_k, self._exchange
        by_wind = over_air * self.layout.exchanges
        for name in (*GUSTS, "slow_gust", "session_exchange"):
            rows[:, :, place(name)] -= by_wind
        rows[:, :, place("air_drift")] += (exchange + further) * minute.air_stale_h
        rows[:, :, place("wind")] -= by_wind * minute.wind_change
        for target in range(self.layout.targets):
            region = self.layout.region(target)
            for own in (self.layout.slow_exchange(target), self.layout.own_exchange(target)):
                rows[:, region, own] -= over_air[:, region]
            rows[:, region, self.layout.drying(target)] += 1.0
        for name in ("air", "air_change"):
            rows[:, :, place(name)] += exchange + further
        emitted = self.settings.surface.emissivity_broadband * STEFAN_BOLTZMANN * taken_k**4
        return Affine(rows, sources.constant - emitted - exchange * over_air)

    def _steepness(self, minute: MinuteInputs, mean: FloatArray, taken_k: FloatArray) -> FloatArray:
        """Loss of heat per kelvin (p, regions), W m-2 K-1."""
        layout = self.layout
        gusts = sum(mean[:, layout.place(name)] for name in (*GUSTS, "slow_gust"))
        session = mean[:, layout.place("session_exchange")]
        by_wind = minute.wind_change * mean[:, layout.place("wind")]
        common = self.hypotheses.exchange + session + gusts + by_wind
        own = np.zeros_like(taken_k)
        for first in (layout.slow_exchange(0), layout.own_exchange(0)):
            own[:, layout.region(0) :] += mean[:, first : first + layout.targets]
        radiated = 4.0 * self.settings.surface.emissivity_broadband * STEFAN_BOLTZMANN * taken_k**3
        # normal numbers have no bound, and below zero heat would flow uphill
        return np.asarray(radiated + np.maximum(common[:, np.newaxis] * layout.exchanges + own, 0.0))

    def _views(self) -> FloatArray:
        """Rows (regions, n, 3) that give each region's normal times the gain."""
        layout = self.layout
        normals = np.zeros((layout.regions, layout.size, 3))
        normals[0, layout.place("gain")] = layout.known[0]
        normals[0, layout.level] = layout.level_axes.T
        for target, axes in enumerate(layout.facing):
            normals[layout.region(target), layout.normal(target)] = axes.T
        return normals

    def _sources(self, minute: MinuteInputs, light: Light) -> Affine:
        """Fluxes into each region that do not depend on its temperature: rows (p, regions, n).

        Absorbed sunlight, longwave and fluxes without a cause.
        """
        layout, place, now = self.layout, self.layout.place, self._around
        view, shaded, upwards = layout.sky_views, minute.shaded, self._normals[..., 2]
        # what of the sky reaches a region, as light that it absorbs
        sky, upwards_now = layout.absorbs * (1.0 - HIDDEN * shaded), upwards @ now
        beam, height = _beam(minute), max(minute.sun[2], LOWEST_SUN)
        brightening = now[place("brightening")]
        share = now[place("circumsolar")] * minute.circumsolar + brightening * minute.brightening
        band = brightening * minute.horizon
        diffuse = sky * minute.diffuse * (1.0 + now[place("diffuse")])
        dome = view * diffuse * (1.0 - share) / 2.0
        # the ground around a region is in the same shadow of the horizon
        hidden = (1.0 - minute.sunlit) * (minute.reflected - self.settings.ground_albedo * minute.diffuse)
        reflected = sky * (minute.reflected - hidden) / 2.0
        # what hides the sky is taken to be as warm as the ground
        grey = self.settings.surface.emissivity_broadband
        down = view * minute.longwave_down + (1.0 - view) * minute.longwave_ground
        # longwave does not scale with the gain, but the state holds normals times the gain
        tilted = grey * (down - minute.longwave_ground) / 2.0 / now[place("gain")]
        level = (dome - reflected + tilted)[:, np.newaxis] * upwards
        level += (view * diffuse * band)[:, np.newaxis] * self._sideways
        # the sky's and the ground's halves (1 + n_z) / 2 and (1 - n_z) / 2, both times the gain
        level[:, place("gain")] += dome + reflected
        level[:, place("common_flux")] += 1.0
        level[:, place("longwave")] += grey * view
        level[:, place("board")] += shaded
        strength = (layout.absorbs * minute.direct + diffuse * share / height) * beam
        rows = level + (strength * light.share)[..., np.newaxis] * (self._normals @ minute.sun)
        constant = grey * (down + minute.longwave_ground) / 2.0 + strength * light.left
        # products of two unknowns, to first order around what was known at the last draw
        around, above = beam * light.mean / height, view * (now[place("gain")] + upwards_now) / 2.0
        aside = view * (self._sideways @ now)
        by_name = {
            "diffuse": sky * minute.diffuse * (share * around + (1.0 - share) * above + band * aside),
            "circumsolar": diffuse * minute.circumsolar * (around - above),
            "brightening": diffuse * (minute.brightening * (around - above) + minute.horizon * aside),
        }
        for name, slope in by_name.items():
            rows[:, :, place(name)] += slope
            constant = constant - slope * now[place(name)]
        rows[:, :, place("beam")] += layout.absorbs * beam * light.mean
        rows[:, :, place("edge")] += layout.absorbs * minute.is_edge * light.mean
        return Affine(rows, constant)

    @cached_property
    def _sideways(self) -> FloatArray:
        """Rows (regions, n) of the sine of each region's tilt times the gain, along its present azimuth."""
        flat = self._normals[..., :2]
        towards = flat.transpose(0, 2, 1) @ self._around
        length = np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        return np.asarray(np.einsum("rnk,rk->rn", flat, towards / length))


def _beam(minute: MinuteInputs) -> FloatArray:
    """Share of the direct light that reaches the regions if they face the sun (regions,)."""
    return np.asarray(minute.sunlit * (1.0 - minute.shaded) * (minute.sun[2] > 0.0))


def _possible(layout: Layout, state: FloatArray) -> FloatArray:
    """A state whose gain and skylight can be."""
    # judged: because products are taken to first order around it: half or twice the light, all skylight
    # around the sun or none, half or twice the skylight; beyond, the first order would be worse than none
    possible, share = state.copy(), (0.0, 1.0)
    limits = {"gain": (0.5, 2.0), "circumsolar": share, "brightening": share, "diffuse": (-0.5, 1.0)}
    for name, (low, high) in limits.items():
        place = layout.place(name)
        possible[place] = min(max(possible[place], low), high)
    return possible
