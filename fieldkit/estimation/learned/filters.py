"""Many Kalman filters side by side: one for each hypothesis about the exchange, the layer and the gusts.

Given a hypothesis, temperatures depend linearly on everything else that is unknown: the stores of each layer
warm by the net flux, and that is linear in a normal times the gain, in gusts, longwave, air. The flux depends
on the temperature itself, so it is taken at the measured one and corrected to first order for the
difference: noise of the camera stays noise and does not turn into heat.

Where two unknowns multiply each other (share of diffuse light and normal), the product is taken to first
order around a given state. The probability of the data given a hypothesis falls out on the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldkit.estimation.learned.inputs import Logged, MinuteInputs
from fieldkit.estimation.learned.layout import GUSTS, Layout
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.layer_modes import RATES_PER_S, layer_modes

MINUTE_S = 60.0
GUST_MINUTES: FloatArray = np.array([2.0, 6.0, 20.0])
GUST_SHARES: FloatArray = np.sqrt(GUST_MINUTES ** (2.0 / 3.0) / np.sum(GUST_MINUTES ** (2.0 / 3.0)))
"""Standard deviations of the gusts' parts over that of all: together nearly f**(-5/3), as turbulence has."""
SLOW_MINUTES = 30.0
COMMON_MINUTES = 20.0
AIR_MINUTES = 30.0
SMOOTHED = float(np.sqrt(2.0))
"""Standard deviation of a drive over that of the process which follows it with the same time constant."""
AIR_CHANGE_K = 1.5
"""Change of an air temperature that is not logged, over `AIR_MINUTES`."""
AIR_NOISE_K = 0.1
LEVEL_SD_K = 15.0
PAST_MINUTES: FloatArray = np.array([0.0, 4.0, 12.0, 36.0, 108.0, 300.0])
"""Bounds of the bins of time before the first minute in which the net flux was one unknown number each."""
NORMAL_UP = 0.95
NORMAL_UP_SD = 0.15
LOG_TWO_PI = float(np.log(2.0 * np.pi))
_LOSSY: FloatArray = RATES_PER_S[1:]
FADE: FloatArray = np.concatenate([[1.0, 1.0], np.exp(-_LOSSY * MINUTE_S)])
"""Share of the level and of each store that is left after a minute."""
FILL: FloatArray = np.concatenate([[0.0, MINUTE_S], (1.0 - FADE[2:]) / _LOSSY])
"""Seconds of flux that a minute leaves in them."""
MEAN: FloatArray = np.concatenate([[1.0, 1.0], (1.0 - FADE[2:]) / (_LOSSY * MINUTE_S)])
"""Their mean over a minute without flux, as a share of the first value."""
MEAN_FILL: FloatArray = np.concatenate([[0.0, MINUTE_S / 2.0], (1.0 - MEAN[2:]) / _LOSSY])
"""The same of what a minute's flux adds, in seconds."""


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """What the filters differ in, (p,) each.

    `exchange` and `gust` [W m-2 K-1], `inertia` [J m-2 K-1 s-1/2], `depth_m` [m]; `unrest` scales all slow
    processes.
    """

    exchange: FloatArray
    inertia: FloatArray
    depth_m: FloatArray
    gust: FloatArray
    unrest: FloatArray


@dataclass(frozen=True, slots=True)
class Innovations:
    """How far each region was from its prediction: standardised (p, regions), in kelvin; NaN unmeasured."""

    standardised: FloatArray
    kelvin: FloatArray


class Filters:
    """A bank of filters, `mean` (p, n) and `covariance` (p, n, n), with `log_likelihood` (p,).

    Products of two unknowns are linear only near some state (n,): `around`, else the prior's.
    """

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        settings: EstimatorSettings,
        first: MinuteInputs,
        logged: Logged,
        around: FloatArray | None = None,
    ) -> None:
        self.layout = layout
        self.hypotheses = hypotheses
        self.settings = settings
        modes = layer_modes(hypotheses.inertia, hypotheses.depth_m, settings.slab.heat_capacity_j_m3_k)
        self._resistance = modes.resistance
        self._weights = np.column_stack([np.ones_like(modes.resistance), modes.weights])
        self._logged = logged
        count = hypotheses.exchange.size
        self.log_likelihood: FloatArray = np.zeros(count)
        self._normals, self._upwards = self._views()
        prior_mean = _prior_mean(layout, settings, first, logged)
        self._around = _possible(layout, prior_mean if around is None else around)
        self.mean: FloatArray = np.tile(prior_mean, (count, 1))
        self._taken_k = np.tile(first.temperature_k, (count, 1))
        self.covariance: FloatArray = _prior_covariance(layout, settings, hypotheses, logged)

    @cached_property
    def _decay(self) -> FloatArray:
        """Share (n,) of each place that is left after a minute."""
        layout = self.layout
        decay = np.ones(layout.size)
        for region in range(layout.regions):
            decay[layout.stores(region)] = FADE
        for place, (_, minutes) in self._processes.items():
            decay[place] = np.exp(-1.0 / minutes)
        for place, drive in layout.smooth.items():
            decay[place] = decay[drive]
        for name in ("beam", "moment", "edge", "camera"):
            decay[layout.shared(name)] = 0.0
        return decay

    @cached_property
    def _processes(self) -> dict[int, tuple[FloatArray, float]]:
        return _processes(self.layout, self.settings.prior, self.hypotheses, self._logged)

    def step(self, minute: MinuteInputs) -> Innovations:
        """One minute: its noise enters, its measurements correct, its fluxes fill the stores."""
        self._shake(minute)
        light = self._all_light(minute)
        temperature, at_zero, _, _ = self._terms(minute, light, self._taken_k)
        # once more at the prediction, which knows of a cloud, and unlike the measurement nothing of its noise
        predicted_k = np.einsum("prn,pn->pr", temperature, self.mean) + at_zero
        temperature, at_zero, flux, flux_at_zero = self._terms(minute, light, predicted_k)
        seen = self._correct(minute, temperature, at_zero)
        self._taken_k = np.einsum("prn,pn->pr", temperature, self.mean) + at_zero
        self._fill(flux, flux_at_zero)
        return seen

    def _shake(self, minute: MinuteInputs) -> None:
        """Set the variances of what lasts one minute, and of the board while there is none."""
        change, prior = minute.direct_change, self.settings.prior
        fresh = {
            "beam": prior.beam_change_share * change,
            "moment": MOMENT_SHARE * change,
            "edge": EDGE_SHARE * minute.direct,
            # a shutter or the housing's warmth moves all regions together
            "camera": self.settings.noise_k,
        }
        for name, sd in fresh.items():
            place = self.layout.shared(name)
            self.covariance[:, place, place] = sd**2
        if not minute.shaded.any():
            board = self.layout.shared("board")
            self.mean[:, board] = 0.0
            self.covariance[:, board] = self.covariance[:, :, board] = 0.0
            self.covariance[:, board, board] = BOARD_SD_W_M2**2

    def _all_light(self, minute: MinuteInputs) -> tuple[FloatArray, FloatArray]:
        """Absorbed sunlight of each region as ``row . state + constant``."""
        count = self.hypotheses.exchange.size
        flux = np.zeros((count, self.layout.regions, self.layout.size))
        at_zero = np.zeros((count, self.layout.regions))
        for region in range(self.layout.regions):
            self._light(minute, region, flux[:, region], at_zero[:, region])
        return flux, at_zero

    def _terms(
        self, minute: MinuteInputs, light: tuple[FloatArray, FloatArray], taken_k: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean temperature and net flux of each region as ``row . state + constant``.

        The flux is taken at `taken_k` (p, regions) and corrected to first order.
        """
        layout = self.layout
        flux, at_zero = light[0].copy(), light[1].copy()
        for region in range(layout.regions):
            self._heat(minute, region, taken_k[:, region], flux[:, region], at_zero[:, region])
        steepness = self._steepness(taken_k)
        quick = (self._resistance + self._weights @ MEAN_FILL)[:, np.newaxis]
        damping = 1.0 / (1.0 + quick * steepness)
        temperature = quick[..., np.newaxis] * flux
        beam, moment = layout.shared("beam"), layout.shared("moment")
        temperature[:, :, moment] = quick * flux[:, :, beam]
        for region in range(layout.regions):
            temperature[:, region, layout.stores(region)] += self._weights * MEAN
        temperature *= damping[..., np.newaxis]
        constant = damping * quick * (at_zero + steepness * taken_k)
        flux -= steepness[..., np.newaxis] * temperature
        at_zero += steepness * (taken_k - constant)
        return temperature, constant, flux, at_zero

    def _views(self) -> tuple[FloatArray, FloatArray]:
        """Rows (regions, n, 3) and (regions, n): normals times the gain, and their vertical components."""
        layout = self.layout
        normals = np.zeros((layout.regions, layout.size, 3))
        for region, known in enumerate(layout.known):
            normals[region, layout.shared("gain")] = known
        for target, axes in enumerate(layout.facing):
            normals[layout.references + target, layout.normal(target)] = axes.T
        return normals, normals[..., 2]

    def _light(self, minute: MinuteInputs, region: int, row: FloatArray, constant: FloatArray) -> None:
        """Absorbed sunlight, (p, n) row and (p,) constant, added in place."""
        place, now = self.layout.shared, self._around
        sunlit, view = minute.sunlit[region], self.layout.sky_views[region]
        lit, sky = sunlit * (1.0 - minute.shaded[region]), 1.0 - HIDDEN * minute.shaded[region]
        towards, upwards = self._normals[region] @ minute.sun, self._upwards[region]
        towards_now, upwards_now = now @ towards, now @ upwards
        beam = lit * (towards_now > 0.0) * (minute.sun[2] > 0.0)
        height = max(minute.sun[2], LOWEST_SUN)
        share = now[place("circumsolar")] * minute.circumsolar
        diffuse = sky * minute.diffuse * (1.0 + now[place("diffuse")])
        dome = view * diffuse * (1.0 - share) / 2.0
        # the ground around a region is in the same shadow of the horizon
        hidden = (1.0 - sunlit) * (minute.reflected - self.settings.ground_albedo * minute.diffuse)
        reflected = sky * (minute.reflected - hidden) / 2.0
        row += (minute.direct + diffuse * share / height) * beam * towards + (dome - reflected) * upwards
        row[:, place("gain")] += dome + reflected
        # products of two unknowns, to first order around what was known at the last draw
        around, above = beam * towards_now / height, view * (now[place("gain")] + upwards_now) / 2.0
        by_name = {
            "diffuse": sky * minute.diffuse * (share * around + (1.0 - share) * above),
            "circumsolar": diffuse * minute.circumsolar * (around - above),
        }
        for name, slope in by_name.items():
            row[:, place(name)] += slope
            constant -= slope * now[place(name)]
        row[:, place("beam")] += beam * max(towards_now, 0.0)
        if minute.is_edge[region]:
            row[:, place("edge")] += max(towards_now, 0.0)

    def _heat(
        self, minute: MinuteInputs, region: int, taken_k: FloatArray, row: FloatArray, constant: FloatArray
    ) -> None:
        """Longwave, exchange with the air and the fluxes without a cause, added in place."""
        layout, grey = self.layout, self.settings.surface.emissivity_broadband
        exchange, over_air = self.hypotheses.exchange, taken_k - minute.air_k
        view = layout.sky_views[region]
        # what hides the sky is taken to be as warm as the ground
        down = view * minute.longwave_down + (1.0 - view) * minute.longwave_ground
        constant += grey * (down + minute.longwave_ground) / 2.0
        constant -= grey * STEFAN_BOLTZMANN * taken_k**4 + exchange * over_air
        tilted = grey * (down - minute.longwave_ground) / 2.0
        row += tilted / self._around[layout.shared("gain")] * self._upwards[region]
        for name in (*GUSTS, "slow_gust"):
            row[:, layout.shared(name)] -= over_air
        for name in ("air", "air_change"):
            row[:, layout.shared(name)] += exchange
        row[:, layout.shared("common_flux")] += 1.0
        row[:, layout.shared("longwave")] += grey * view
        row[:, layout.shared("board")] += minute.shaded[region]
        if region >= layout.references:
            row[:, layout.bed_flux(region - layout.references)] += 1.0

    def _steepness(self, taken_k: FloatArray) -> FloatArray:
        """Loss of heat per kelvin (p, regions), W m-2 K-1."""
        gusts = sum(self.mean[:, self.layout.shared(name)] for name in (*GUSTS, "slow_gust"))
        radiated = 4.0 * self.settings.surface.emissivity_broadband * STEFAN_BOLTZMANN * taken_k**3
        return np.asarray(radiated + np.maximum(self.hypotheses.exchange + gusts, 0.0)[:, np.newaxis])

    def _correct(self, minute: MinuteInputs, temperature: FloatArray, at_zero: FloatArray) -> Innovations:
        """Update by the measured temperatures of the regions."""
        layout = self.layout
        seen = np.flatnonzero(minute.measured)
        standardised, kelvin = np.full((2, *at_zero.shape), np.nan)
        rows = temperature.copy()
        rows[:, :, layout.shared("camera")] += 1.0
        for region in range(1, layout.regions):
            rows[:, region, layout.offset(region)] += 1.0
            rows[:, region, layout.drift(region)] += minute.hours
        rows = rows[:, seen]
        innovation = minute.temperature_k[seen] - at_zero[:, seen] - np.einsum("prn,pn->pr", rows, self.mean)
        shared = rows @ self.covariance
        spread = shared @ rows.transpose(0, 2, 1) + self.settings.noise_k**2 * np.eye(seen.size)
        root = np.linalg.cholesky(spread)
        white = np.linalg.solve(root, innovation[..., np.newaxis])[..., 0]
        half_gain = np.linalg.solve(root, shared)
        self.mean += np.einsum("prn,pr->pn", half_gain, white)
        self.covariance -= half_gain.transpose(0, 2, 1) @ half_gain
        determinant = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        self.log_likelihood += -0.5 * (white**2).sum(axis=1) - determinant - 0.5 * seen.size * LOG_TWO_PI
        standardised[:, seen], kelvin[:, seen] = white, innovation
        return Innovations(standardised, kelvin)

    def _fill(self, flux: FloatArray, at_zero: FloatArray) -> None:
        """Into the next minute: stores fade and take the minute's flux, processes relax."""
        drive = list(self.layout.smooth.values())
        targets, decay = self._filled, self._decay
        crossed = np.concatenate([flux @ self.covariance, self.covariance[:, drive]], axis=1)
        among = np.concatenate([crossed @ flux.transpose(0, 2, 1), crossed[:, :, drive]], axis=2)
        inflow = np.einsum("prn,pn->pr", flux, self.mean) + at_zero
        moved = np.concatenate([inflow, self.mean[:, drive]], axis=1)
        self.mean *= decay
        self.mean += moved @ targets.T
        added = targets @ (crossed * decay + 0.5 * among @ targets.T)
        self.covariance *= np.multiply.outer(decay, decay)
        self.covariance += added
        self.covariance += added.transpose(0, 2, 1)
        for place, variance in self._fresh.items():
            self.covariance[:, place, place] += variance

    @cached_property
    def _filled(self) -> FloatArray:
        """Where each flux goes, and what each drive moves (n, regions + drives)."""
        layout = self.layout
        filled = np.zeros((layout.size, layout.regions + len(layout.smooth)))
        for region in range(layout.regions):
            filled[layout.stores(region), region] = FILL
        for column, place in enumerate(layout.smooth, start=layout.regions):
            filled[place, column] = 1.0 - self._decay[place]
        return filled

    @cached_property
    def _fresh(self) -> dict[int, FloatArray]:
        """Variance that a minute adds to what drives each process."""
        return {place: sd**2 * (1.0 - self._decay[place] ** 2) for place, (sd, _) in self._processes.items()}


MOMENT_SHARE = 0.2
"""The surface's mean over a minute depends on when the light changed; as a share of the change."""
DIRECT_SD = 0.07
"""Relative, of direct light that is a reading less an assumed share of diffuse light."""
ALBEDO_SD = 0.0625
"""Relative, of the absorptance of sand whose albedo is 0.20 within 0.05."""
GUESSED = 2.0
"""How much less certain longwave is where neither it nor the air was measured."""
EDGE_SHARE = 0.3
"""Direct light of a minute in which a board came or went, as a standard deviation around one half."""
BOARD_SD_W_M2 = 60.0
"""Longwave of a board instead of the sky's, and the skylight that comes in below it."""
HIDDEN = 0.7
"""Share of the sky that a board hides."""
LOWEST_SUN = 0.05


def _processes(
    layout: Layout, prior: Prior, hypotheses: Hypotheses, logged: Logged
) -> dict[int, tuple[FloatArray, float]]:
    """Standard deviation (p,) and time constant in minutes of what relaxes and is driven by chance, by place.

    A smooth process follows its drive with the same time constant. Chance moves it over tens of minutes but
    not from one to the next; otherwise quiet minutes would be taken for a high inertia.
    """
    unrest = SMOOTHED * hypotheses.unrest
    processes = {
        layout.shared("slow_gust_drive"): (unrest * prior.slow_gust_sd * hypotheses.exchange, SLOW_MINUTES),
        layout.shared("common_flux_drive"): (unrest * prior.common_flux_sd_w_m2, COMMON_MINUTES),
        layout.shared("air_change_drive"): (
            unrest * (AIR_NOISE_K if logged.air else AIR_CHANGE_K),
            AIR_MINUTES,
        ),
    }
    for name, share, minutes in zip(GUSTS, GUST_SHARES, GUST_MINUTES, strict=True):
        processes[layout.shared(name)] = (share * hypotheses.gust, float(minutes))
    for target in range(layout.targets):
        processes[layout.bed_flux_drive(target)] = (unrest * prior.bed_flux_sd_w_m2, SLOW_MINUTES)
    return processes


def _prior_mean(
    layout: Layout, settings: EstimatorSettings, first: MinuteInputs, logged: Logged
) -> FloatArray:
    mean = np.zeros(layout.size)
    for region in range(layout.regions):
        mean[layout.stores(region).start] = first.temperature_k[region]
    mean[layout.shared("gain")] = settings.scale
    # to a camera that reads high the air would be warmer by as much
    mean[layout.shared("air")] = logged.camera_k
    mean[layout.shared("circumsolar")] = settings.prior.circumsolar_share
    for target in range(layout.targets):
        mean[layout.normal(target)] = settings.scale * NORMAL_UP * layout.facing[target][2]
    return mean


def _possible(layout: Layout, state: FloatArray) -> FloatArray:
    """A state whose gain and skylight can be."""
    possible = state.copy()
    limits = {"gain": (0.5, 2.0), "circumsolar": (0.0, 1.0), "diffuse": (-0.5, 1.0)}
    for name, (low, high) in limits.items():
        place = layout.shared(name)
        possible[place] = min(max(possible[place], low), high)
    return possible


def prior_sds(settings: EstimatorSettings, logged: Logged) -> dict[str, float]:
    """Prior standard deviations of the constants that all regions share, by name."""
    prior = settings.prior
    air_sd_k = prior.air_sd_k if logged.air else prior.air_unlogged_sd_k
    is_guessed = not (logged.longwave or logged.air)
    return {
        "gain": float(np.hypot(gain_sd(settings), 0.0 if logged.diffuse else DIRECT_SD)),
        "diffuse": prior.diffuse_sd if logged.diffuse else prior.diffuse_unmeasured_sd,
        "circumsolar": prior.circumsolar_sd,
        "longwave": prior.longwave_sd_w_m2 * (GUESSED if is_guessed else 1.0),
        "air": float(np.hypot(air_sd_k, logged.camera_sd_k)),
    }


def gain_sd(settings: EstimatorSettings) -> float:
    """Prior standard deviation of the gain: as stated, or a calibrated meter's factor and the albedo."""
    calibrated = float(np.hypot(settings.factor_sd, ALBEDO_SD))
    return min(settings.prior.gain_sd, calibrated) if settings.factor_sd > 0.0 else settings.prior.gain_sd


def _prior_covariance(
    layout: Layout, settings: EstimatorSettings, hypotheses: Hypotheses, logged: Logged
) -> FloatArray:
    """Prior covariance (p, n, n), the stores by past fluxes and an unknown level."""
    prior = settings.prior
    variance = np.zeros((hypotheses.exchange.size, layout.size))
    for name, sd in prior_sds(settings, logged).items():
        variance[:, layout.shared(name)] = sd**2
    processes = _processes(layout, prior, hypotheses, logged)
    for place, (spread, _) in processes.items():
        variance[:, place] = spread**2
    for target in range(layout.targets):
        vertical = layout.facing[target][2]
        sds = np.where(vertical > 0.0, NORMAL_UP_SD, prior.normal_horizontal_sd)
        variance[:, layout.normal(target)] = sds**2
    for region in range(1, layout.regions):
        variance[:, layout.offset(region)] = settings.offset_sd_k**2
        variance[:, layout.drift(region)] = settings.drift_sd_k_per_h**2
    covariance = np.zeros((*variance.shape, layout.size))
    covariance[:, range(layout.size), range(layout.size)] = variance
    offsets = slice(layout.offset(1), layout.offset(layout.regions - 1) + 1)
    covariance[:, offsets, offsets] += logged.emissivities_k2
    for place, drive in layout.smooth.items():
        covariance[:, place, place] = variance[:, drive] / 2.0
        covariance[:, place, drive] = covariance[:, drive, place] = variance[:, drive] / 2.0
    past = _past_fills()
    shared = (past * prior.past_flux_sd_w_m2**2) @ past.T
    own = (past * prior.bed_past_flux_sd_w_m2**2) @ past.T
    for one in range(layout.regions):
        for other in range(layout.regions):
            covariance[:, layout.stores(one), layout.stores(other)] = shared + (one == other) * own
        level = layout.stores(one).start
        covariance[:, level, level] += LEVEL_SD_K**2
    return covariance


def _past_fills() -> FloatArray:
    """What a unit flux of each past bin has left in the stores, (level and stores, bins), seconds."""
    bounds_s = 60.0 * PAST_MINUTES
    rates = RATES_PER_S[1:, np.newaxis]
    left = (np.exp(-rates * bounds_s[:-1]) - np.exp(-rates * bounds_s[1:])) / rates
    return np.vstack([np.zeros(left.shape[1]), np.diff(bounds_s), left])
