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


@dataclass(frozen=True, slots=True)
class _Terms:
    """Mean temperature and net flux of each region as ``row . state + constant``.

    Rows (p, regions, n), constants (p, regions).
    """

    temperature: FloatArray
    constant: FloatArray
    flux: FloatArray
    flux_constant: FloatArray

    def temperature_k(self, state: FloatArray) -> FloatArray:
        return _along(self.temperature, state) + self.constant

    def inflow(self, state: FloatArray) -> FloatArray:
        return _along(self.flux, state) + self.flux_constant


def _along(rows: FloatArray, state: FloatArray) -> FloatArray:
    """``row . state`` of rows (p, r, n) and states (p, n)."""
    return np.asarray(np.matmul(rows, state[..., np.newaxis])[..., 0])


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
        # kept: large arrays that are allocated every minute cost as much as what is computed in them
        self._product = np.empty_like(self.covariance[:PASSED])
        flows = self._filled.shape[1]
        self._left = np.empty((count, layout.regions + 2 * flows, layout.size))
        self._right = np.empty_like(self._left)
        self._left[:, layout.regions : layout.regions + flows] = self._right[:, -flows:] = self._filled.T

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
        sources = self._sources(minute)
        # first at the last prediction, then at this one, which knows of a cloud, and unlike the measurement
        # nothing of its noise
        for _ in range(2):
            terms = self._terms(minute, sources, self._taken_k)
            self._taken_k = terms.temperature_k(self.mean)
        seen, gain, crossed = self._correct(minute, terms)
        self._taken_k = terms.temperature_k(self.mean)
        self._fill(terms, gain, crossed)
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

    def _terms(
        self, minute: MinuteInputs, sources: tuple[FloatArray, FloatArray], taken_k: FloatArray
    ) -> _Terms:
        """Mean temperature and net flux of each region under each hypothesis.

        The flux is taken at `taken_k` (p, regions) and corrected to first order.
        """
        flux, at_zero = self._fluxes(minute, sources, taken_k)
        steepness = self._steepness(taken_k)
        quick = (self._resistance + self._weights @ MEAN_FILL)[:, np.newaxis]
        damping = 1.0 / (1.0 + quick * steepness)
        temperature = quick[..., np.newaxis] * flux
        beam, moment = self.layout.shared("beam"), self.layout.shared("moment")
        temperature[:, :, moment] = quick * flux[:, :, beam]
        for region in range(self.layout.regions):
            temperature[:, region, self.layout.stores(region)] += self._weights * MEAN
        temperature *= damping[..., np.newaxis]
        constant = damping * quick * (at_zero + steepness * taken_k)
        flux -= steepness[..., np.newaxis] * temperature
        return _Terms(temperature, constant, flux, at_zero + steepness * (taken_k - constant))

    def _fluxes(
        self, minute: MinuteInputs, sources: tuple[FloatArray, FloatArray], taken_k: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Net flux of each region at temperatures `taken_k`: rows (p, regions, n), constants (p, regions)."""
        place = self.layout.shared
        flux = np.tile(sources[0], (len(self.mean), 1, 1))
        over_air, exchange = taken_k - minute.air_k, self.hypotheses.exchange[:, np.newaxis]
        for name in (*GUSTS, "slow_gust"):
            flux[:, :, place(name)] -= over_air
        for name in ("air", "air_change"):
            flux[:, :, place(name)] += exchange
        emitted = self.settings.surface.emissivity_broadband * STEFAN_BOLTZMANN * taken_k**4
        return flux, sources[1] - emitted - exchange * over_air

    def _views(self) -> tuple[FloatArray, FloatArray]:
        """Rows (regions, n, 3) and (regions, n): normals times the gain, and their vertical components."""
        layout = self.layout
        normals = np.zeros((layout.regions, layout.size, 3))
        for region, known in enumerate(layout.known):
            normals[region, layout.shared("gain")] = known
        for target, axes in enumerate(layout.facing):
            normals[layout.references + target, layout.normal(target)] = axes.T
        return normals, normals[..., 2]

    def _sources(self, minute: MinuteInputs) -> tuple[FloatArray, FloatArray]:
        """Fluxes into each region that are the same under all hypotheses, ``row . state + constant``.

        Absorbed sunlight, longwave and fluxes without a cause: rows (regions, n), constants (regions,).
        """
        layout, place, now = self.layout, self.layout.shared, self._around
        view, shaded, upwards = layout.sky_views, minute.shaded, self._upwards
        lit, sky = minute.sunlit * (1.0 - shaded), 1.0 - HIDDEN * shaded
        towards = self._normals @ minute.sun
        towards_now, upwards_now = towards @ now, upwards @ now
        beam = lit * (towards_now > 0.0) * (minute.sun[2] > 0.0)
        height = max(minute.sun[2], LOWEST_SUN)
        share = now[place("circumsolar")] * minute.circumsolar
        diffuse = sky * minute.diffuse * (1.0 + now[place("diffuse")])
        dome = view * diffuse * (1.0 - share) / 2.0
        # the ground around a region is in the same shadow of the horizon
        hidden = (1.0 - minute.sunlit) * (minute.reflected - self.settings.ground_albedo * minute.diffuse)
        reflected = sky * (minute.reflected - hidden) / 2.0
        # what hides the sky is taken to be as warm as the ground
        grey = self.settings.surface.emissivity_broadband
        down = view * minute.longwave_down + (1.0 - view) * minute.longwave_ground
        tilted = grey * (down - minute.longwave_ground) / 2.0 / now[place("gain")]
        rows = ((minute.direct + diffuse * share / height) * beam)[:, np.newaxis] * towards
        rows += (dome - reflected + tilted)[:, np.newaxis] * upwards
        rows[:, place("gain")] += dome + reflected
        constant = grey * (down + minute.longwave_ground) / 2.0
        # products of two unknowns, to first order around what was known at the last draw
        around, above = beam * towards_now / height, view * (now[place("gain")] + upwards_now) / 2.0
        by_name = {
            "diffuse": sky * minute.diffuse * (share * around + (1.0 - share) * above),
            "circumsolar": diffuse * minute.circumsolar * (around - above),
        }
        for name, slope in by_name.items():
            rows[:, place(name)] += slope
            constant -= slope * now[place(name)]
        rows[:, place("beam")] += beam * np.maximum(towards_now, 0.0)
        rows[:, place("edge")] += minute.is_edge * np.maximum(towards_now, 0.0)
        rows[:, place("common_flux")] += 1.0
        rows[:, place("longwave")] += grey * view
        rows[:, place("board")] += shaded
        for target in range(layout.targets):
            rows[layout.references + target, layout.bed_flux(target)] += 1.0
        return rows, constant

    def _steepness(self, taken_k: FloatArray) -> FloatArray:
        """Loss of heat per kelvin (p, regions), W m-2 K-1."""
        gusts = sum(self.mean[:, self.layout.shared(name)] for name in (*GUSTS, "slow_gust"))
        radiated = 4.0 * self.settings.surface.emissivity_broadband * STEFAN_BOLTZMANN * taken_k**3
        return np.asarray(radiated + np.maximum(self.hypotheses.exchange + gusts, 0.0)[:, np.newaxis])

    def _correct(self, minute: MinuteInputs, terms: _Terms) -> tuple[Innovations, FloatArray, FloatArray]:
        """Update the mean by the measured temperatures of the regions.

        The covariance waits for `_fill`, so that it passes through memory once a minute: returned are the
        root (p, s, n) of what the measurements take from it, and its product with the fluxes
        (p, regions, n) after them.
        """
        layout = self.layout
        seen = np.flatnonzero(minute.measured)
        standardised, kelvin = np.full((2, *terms.constant.shape), np.nan)
        rows = terms.temperature.copy()
        rows[:, :, layout.shared("camera")] += 1.0
        for region in range(1, layout.regions):
            rows[:, region, layout.offset(region)] += 1.0
            rows[:, region, layout.drift(region)] += minute.hours
        rows = rows[:, seen]
        innovation = minute.temperature_k[seen] - terms.constant[:, seen] - _along(rows, self.mean)
        both = np.concatenate([rows, terms.flux], axis=1) @ self.covariance
        shared, crossed = both[:, : seen.size], both[:, seen.size :]
        spread = shared @ rows.transpose(0, 2, 1) + self.settings.noise_k**2 * np.eye(seen.size)
        root = np.linalg.cholesky(spread)
        whitening = np.linalg.inv(root)
        white, half_gain = _along(whitening, innovation), whitening @ shared
        self.mean += np.einsum("prn,pr->pn", half_gain, white)
        determinant = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        self.log_likelihood += -0.5 * (white**2).sum(axis=1) - determinant - 0.5 * seen.size * LOG_TWO_PI
        standardised[:, seen], kelvin[:, seen] = white, innovation
        crossed = crossed - (terms.flux @ half_gain.transpose(0, 2, 1)) @ half_gain
        return Innovations(standardised, kelvin), half_gain, crossed

    def _fill(self, terms: _Terms, half_gain: FloatArray, crossed: FloatArray) -> None:
        """Into the next minute: stores fade and take the minute's flux, processes relax."""
        drive = list(self.layout.smooth.values())
        targets, decay = self._filled, self._decay
        driven = self.covariance[:, drive] - half_gain[:, :, drive].transpose(0, 2, 1) @ half_gain
        crossed = np.concatenate([crossed, driven], axis=1)
        among = np.concatenate([crossed @ terms.flux.transpose(0, 2, 1), crossed[:, :, drive]], axis=2)
        moved = np.concatenate([terms.inflow(self.mean), self.mean[:, drive]], axis=1)
        self.mean *= decay
        self.mean += moved @ targets.T
        self._pass_covariance(half_gain * decay, crossed * decay, among)
        for place, variance in self._fresh.items():
            self.covariance[:, place, place] += variance

    def _pass_covariance(self, taken: FloatArray, crossed: FloatArray, among: FloatArray) -> None:
        """Covariance a minute later: faded, less what was measured, plus what flowed in.

        ``taken' taken`` is subtracted, ``targets added`` and its transpose are added, in one product.
        """
        first = self.layout.regions - taken.shape[1]
        left, right = self._left[:, first:], self._right[:, first:]
        added = slice(taken.shape[1], taken.shape[1] + crossed.shape[1])
        right[:, : added.start] = taken
        np.negative(taken, out=left[:, : added.start])
        np.matmul(0.5 * among, self._filled.T, out=right[:, added])
        right[:, added] += crossed
        left[:, added.stop :] = right[:, added]
        fading = np.multiply.outer(self._decay, self._decay)
        for begin in range(0, len(taken), PASSED):
            part = slice(begin, begin + PASSED)
            changed = np.matmul(
                left[part].transpose(0, 2, 1), right[part], out=self._product[: len(left[part])]
            )
            self.covariance[part] *= fading
            self.covariance[part] += changed

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
PASSED = 16
"""Covariances that pass through memory together: they and their change stay in the processor's cache."""


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
