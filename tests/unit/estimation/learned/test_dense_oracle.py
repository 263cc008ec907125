"""The filters against one dense system: all minutes, stores and noises of short windows solved at once.

The dense solution knows neither stores nor recursion. Temperatures are convolutions of net fluxes with the
layer's response, processes are their covariances over the minutes, and the whole is one call of
`np.linalg.solve` (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eqs. 2.25 and 2.30).
Products of unknowns are taken to first order around the same fixed state on both sides. Two windows with a
gap between them share what lasts, as blocks that appear in both.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR
from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.learned import prior_state as constants
from fieldkit.estimation.learned import surface
from fieldkit.estimation.learned.filters import Filters, Start
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, minutes_between
from fieldkit.estimation.learned.layout import GUSTS, Layout
from fieldkit.estimation.learned.noise import Noise
from fieldkit.estimation.learned.prior_state import prior_sds
from fieldkit.estimation.surface_kinds import KINDS
from fieldkit.model.samples import Quality
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.layer_modes import RATES_PER_S, layer_modes
from tests.harness.drawn import drawn_world

MINUTES = 30
BOARD = slice(12, 16)
DRAWN = Hypotheses(*(np.array([one]) for one in (17.0, 640.0, 0.04, 1.4, 1.2)))
LASTING = ("gain", "wind")
OF_SESSION = ("diffuse", "circumsolar", "brightening", "longwave", "air", "air_drift")
NOISE = Noise(0.04, 0.08)
LATER_NOISE = Noise(0.06, 0.05)
PAST_ALIKE = constants.PAST_ALIKE ** np.array([[abs(i - k) for k in range(5)] for i in range(5)])
"""Correlation of fluxes before the first minute, as of a process that is relaxing from bin to bin."""
LEVEL_SD = np.radians(0.3)
"""Of a reference's direction, as the settings have it where nothing is stated."""
LATER_EXCHANGE = 2.0
"""Around which a later session's exchange over the first one's is taken, W m-2 K-1."""


class FrozenModel(surface.SurfaceModel):
    """Takes products of unknowns around a fixed state (n,) and fluxes at measured temperatures."""

    fixed: np.ndarray

    def _linearise(self, minute, sources, mean, taken_k):
        return super()._linearise(minute, sources, self.fixed[np.newaxis], minute.temperature_k[np.newaxis])

    def light(self, minute, mean, covariance):
        return super().light(minute, self.fixed[np.newaxis], np.zeros((1, self.fixed.size, self.fixed.size)))

    def flux_of(self, minute, region):
        """Net flux of a region as a row (n,) and a constant, at its measured temperature."""
        flux = self.flux(minute, self.light(minute, None, None), minute.temperature_k[np.newaxis])
        return flux.rows[0, region], flux.constant[0, region]


class LinearFilters(Filters):
    """Takes no measurement for a jump, which no linear system can say."""

    def _begin(self, first, logged, around, noise):
        super()._begin(first, logged, around, noise)
        fixed = self.mean[0].copy()
        for target, axes in enumerate(self.layout.facing):  # leaning to the sun, so that all terms count
            fixed[self.layout.normal(target)] -= 0.1 * axes[1]
        if self.ends:
            fixed[self.layout.place("session_exchange")] = LATER_EXCHANGE
        self.model = FrozenModel(self.layout, DRAWN, self._settings, logged, fixed, noise)
        self.model.fixed = fixed

    def update(self, design, measured, variance, jumps=None):
        return super().update(design, measured, variance)


def response(modes, time_s):
    """Integral over time of the warming after a unit step, K s per W/m2; 0 before the step."""
    t = np.maximum(time_s, 0.0)
    total = modes.resistance[0] * t
    for rate, weight in zip(RATES_PER_S, modes.weights[0], strict=True):
        total = total + weight * (
            0.5 * t**2 if rate == 0.0 else t / rate - (1.0 - np.exp(-rate * t)) / rate**2
        )
    return total


def by_minute(modes, begin_s, end_s, minutes):
    """Mean warming of each minute after 1 W/m2 from `begin_s` to `end_s`; without the resistance's spike."""
    edges = 60.0 * np.arange(minutes + 1)
    return np.diff(response(modes, edges - begin_s) - response(modes, edges - end_s)) / 60.0


def relaxing(sd, time_min, minutes):
    """Covariance of an Ornstein-Uhlenbeck process over minutes."""
    apart = np.abs(np.subtract.outer(np.arange(minutes), np.arange(minutes)))
    return sd**2 * np.exp(-apart / time_min)


def following(sd, time_min, minutes):
    """Covariance of what follows such a process with the same time constant, started as the prior is."""
    left = np.exp(-1.0 / time_min)
    drive = relaxing(sd, time_min, minutes)
    path = np.zeros((minutes, minutes + 1))  # by its own start and the drive of each minute
    path[0, 0] = 1.0
    for minute in range(1, minutes):
        path[minute] = left * path[minute - 1]
        path[minute, minute] += 1.0 - left
    joint = np.zeros((minutes + 1, minutes + 1))
    joint[1:, 1:] = drive
    joint[0, 0] = sd**2 / 2.0
    joint[0, 1:] = joint[1:, 0] = sd**2 / 2.0 * left ** np.arange(minutes)
    return path @ joint @ path.T


def unlike(noise):
    """How unlike regions are in what lasts, by the hypothesis and what each does alone."""
    return np.hypot(DRAWN.unrest[0], 0.25) * np.hypot(1.0, noise.own_k / 0.1)


def known(has_air, settings):
    """Longwave and diffuse light are measured, no probes."""
    return Logged(has_air, True, 0.0, True, 0.0, settings.prior.camera_offset_sd_k, np.zeros(()))


def own_kind(settings, layout, region):
    """The kind of a region's surface; that of the references has no spread of its own."""
    kind = settings.kinds.get(f"bed{region - 1}")
    if kind is not None:
        return KINDS[kind]
    alike = {"exchange_log_sd": 0.0, "inertia_log_sd": 0.0}
    return replace(KINDS["sand"], exchange_w_m2_k=settings.prior.exchange_w_m2_k, **alike)


def own_exchange(settings, layout, region):
    """Of a region: as much over that of the references as its kind's over the prior's."""
    own = own_kind(settings, layout, region).exchange_w_m2_k
    return own / settings.prior.exchange_w_m2_k * DRAWN.exchange[0]


def own_modes(settings, layout, region):
    """Of a region's layer."""
    slab, own = settings.slab, own_kind(settings, layout, region)
    inertia, depth = np.sqrt(own.conductivity_w_m_k * own.heat_capacity_j_m3_k), own.depth_m
    if f"bed{region - 1}" not in settings.kinds:
        inertia, depth = slab.thermal_inertia, slab.depth_m
    inertia, depth = DRAWN.inertia * inertia / slab.thermal_inertia, DRAWN.depth_m * depth / slab.depth_m
    return layer_modes(inertia, depth, slab.heat_capacity_j_m3_k)


class Unknowns:
    """Named blocks of unknowns with a prior."""

    def __init__(self):
        self.blocks, self.size = {}, 0
        self.means, self.covariances = [], []

    def block(self, name, mean, covariance):
        covariance = np.atleast_2d(covariance)
        self.blocks[name] = slice(self.size, self.size + len(covariance))
        self.size += len(covariance)
        self.means.append(np.broadcast_to(mean, len(covariance)))
        self.covariances.append(covariance)

    def lasting(self, layout, settings, has_air):
        """Blocks of what all sessions share."""
        prior = settings.prior
        means = {"gain": settings.scale, "wind": prior.wind_w_m2_k_per_m_s}
        sds = prior_sds(settings, known(has_air, settings))
        for name in LASTING:
            self.block(name, means[name], sds[name] ** 2)
        self.block("off_level", 0.0, (settings.scale * LEVEL_SD) ** 2 * np.eye(2))
        for target, axes in enumerate(layout.facing):
            up, own = axes[2] > 0.0, own_kind(settings, layout, layout.region(target))
            horizontal = own.normal_horizontal_sd * np.sqrt(2.0 if axes.shape[1] == 2 else 1.0)
            sd = np.where(up, 0.15, horizontal)
            mean, covariance = np.where(up, np.sqrt(1.0 - 2.0 * 0.25**2), 0.0), np.diag(sd**2)
            if target < layout.stated:  # beside the gain times the stated normal
                along = np.outer(*2 * [layout.known[1 + target] @ axes])
                mean, covariance = 0.0, LEVEL_SD**2 * (np.eye(len(along)) - along) + 0.25 * along
            self.block(f"normal{target}", mean, covariance)
            response = np.hypot(unlike(NOISE) * prior.own_inertia_sd, own.inertia_log_sd)
            self.block(f"own_response{target}", 0.0, response**2)


class Dense:
    """One session: its own blocks among the unknowns, their effect on fluxes, temperatures and readings.

    `ended` is the state (n,) at the end of the session before, along which the gain changes.
    """

    def __init__(self, unknowns, model, noise, minutes, settings, has_air, ended=None):
        self.unknowns, self.model, self.noise = unknowns, model, noise
        self.minutes, self.settings, self.ended = minutes, settings, ended
        self.layout, self.count = model.layout, len(minutes)
        self._constants(has_air)
        self._changing(has_air)
        self.blocks = dict(unknowns.blocks)

    def block(self, *about):
        self.unknowns.block(*about)

    def _constants(self, has_air):
        layout, settings, prior = self.layout, self.settings, self.settings.prior
        means = {"circumsolar": prior.circumsolar_share, "brightening": prior.brightening_share}
        sds = prior_sds(settings, known(has_air, settings))
        for name in OF_SESSION:
            self.block(name, means.get(name, 0.0), sds[name] ** 2)
        later = 0.0 if self.ended is None else 1.0
        exchange = prior.exchange_log_sd * DRAWN.exchange[0]
        self.block("session_exchange", 0.0, later * exchange**2)
        self.block("gain_change", 0.0, later * 0.03**2)
        self.block("board", 0.0, surface.BOARD_SD_W_M2**2)
        for target in range(layout.targets):
            own = own_kind(settings, layout, layout.region(target))
            share = np.hypot(unlike(self.noise) * prior.own_exchange, own.exchange_log_sd)
            lasting = share * own_exchange(settings, layout, layout.region(target))
            self.block(f"own_exchange{target}", 0.0, lasting**2)
        for region in range(layout.regions):
            first_k = self.minutes[0].temperature_k[region]
            self.block(f"level{region}", first_k, constants.LEVEL_SD_K**2)
            self.block(f"past{region}", 0.0, prior.bed_past_flux_sd_w_m2**2 * PAST_ALIKE)
            if region:
                self.block(f"offset{region}", 0.0, settings.offset_sd_k**2)
                self.block(f"drift{region}", 0.0, settings.drift_sd_k_per_h**2)
        self.block("past", 0.0, prior.past_flux_sd_w_m2**2 * PAST_ALIKE)

    def _changing(self, has_air):
        prior, n, drawn = self.settings.prior, self.count, DRAWN
        gust, unrest = drawn.gust[0], np.sqrt(2.0) * drawn.unrest[0]
        strengths = constants.GUST_MINUTES ** (1.0 / 3.0)
        for name, minutes, share in zip(GUSTS, constants.GUST_MINUTES, strengths, strict=True):
            sd = gust * share / np.sqrt((strengths**2).sum())
            self.block(name, 0.0, relaxing(sd, minutes, n))
        # an air that nobody logs changes by the same flux at any exchange and unrest
        by_flux = constants.AIR_CHANGE_K * prior.exchange_w_m2_k / drawn.exchange[0] / drawn.unrest[0]
        air_k = constants.AIR_NOISE_K if has_air else by_flux
        slow = {
            "slow_gust": (prior.slow_gust_sd * prior.exchange_w_m2_k, constants.SLOW_MINUTES),
            "common_flux": (prior.common_flux_sd_w_m2, constants.COMMON_MINUTES),
            "air_change": (air_k, constants.AIR_MINUTES),
        }
        for target in range(self.layout.targets):
            region = self.layout.region(target)
            usual = prior.exchange_w_m2_k / drawn.exchange[0]
            own = prior.own_slow_exchange * usual * own_exchange(self.settings, self.layout, region)
            slow[f"slow_exchange{target}"] = (own, constants.SLOW_MINUTES)
            fading = constants.DRYING_W_M2 * np.exp(-np.arange(n) / constants.DRYING_MINUTES)
            self.block(f"drying{target}", 0.0, np.outer(fading, fading))
        for name, (sd, minutes) in slow.items():
            self.block(name, 0.0, following(unrest * sd, minutes, n))
        for region in range(self.layout.regions):
            self.block(f"own{region}", 0.0, relaxing(self.noise.own_k, 4.0, n))
        change = np.array([minute.direct_change for minute in self.minutes])
        direct = np.array([minute.direct for minute in self.minutes])
        self.block("beam", 0.0, np.diag((prior.beam_change_share * change) ** 2))
        self.block("moment", 0.0, np.diag((surface.MOMENT_SHARE * change) ** 2))
        self.block("camera", 0.0, prior.camera_noise_k**2 * np.eye(n))
        self.block("edge", 0.0, np.diag((surface.EDGE_SHARE * direct) ** 2))

    def _places(self, minute):
        """Which unknown stands at which place of the filter's state, as pairs."""
        layout = self.layout
        for name in (*LASTING, *OF_SESSION, "session_exchange", "board"):
            yield layout.place(name), self.blocks[name].start
        for name in (*GUSTS, "slow_gust", "common_flux", "air_change", "beam", "edge"):
            yield layout.place(name), self.blocks[name].start + minute
        for target in range(layout.targets):
            for place, name in (
                (layout.slow_exchange(target), "slow_exchange"),
                (layout.drying(target), "drying"),
            ):
                yield place, self.blocks[f"{name}{target}"].start + minute
            yield layout.own_exchange(target), self.blocks[f"own_exchange{target}"].start
            normal, block = layout.normal(target), self.blocks[f"normal{target}"]
            yield from zip(range(normal.start, normal.stop), range(block.start, block.stop), strict=True)
        yield from ((layout.level.start + axis, self.blocks["off_level"].start + axis) for axis in (0, 1))

    def _without_losses(self, region):
        """Net flux (minutes, unknowns) and (minutes,) at the measured temperature."""
        rows, constant = np.zeros((self.count, self.unknowns.size)), np.zeros(self.count)
        for number, minute in enumerate(self.minutes):
            flux, constant[number] = self.model.flux_of(minute, region)
            for place, unknown in self._places(number):
                rows[number, unknown] = flux[place]
            for target in range(self.layout.stated):
                along = self.layout.known[1 + target] @ self.layout.facing[target]
                rows[number, self.blocks["gain"].start] += flux[self.layout.normal(target)] @ along
            if self.ended is not None:
                scaled = self.layout.gain_and_normals
                rows[number, self.blocks["gain_change"].start] = flux[scaled] @ self.ended[scaled]
        return rows, constant

    def temperatures(self, region):
        """Mean temperature of each minute by the unknowns, (minutes, unknowns) and (minutes,)."""
        n, fixed, about = self.count, self.model.fixed, (self.settings, self.layout, region)
        modes = own_modes(*about)
        kernel = by_minute(modes, 0.0, 60.0, n)
        # the resistance acts at once: its share in the minute after is nothing
        conducted = sum(np.diag(np.full(n - lag, kernel[lag]), -lag) for lag in range(n))
        rows, constant = self._without_losses(region)
        taken_k = np.array([minute.temperature_k[region] for minute in self.minutes])
        emissivity = self.settings.surface.emissivity_broadband
        steepness = 4.0 * emissivity * STEFAN_BOLTZMANN * taken_k**3
        by_wind = fixed[self.layout.place("wind")] * np.array([one.wind_change for one in self.minutes])
        further = fixed[self.layout.place("session_exchange")] + by_wind
        losses = np.diag(steepness + own_exchange(*about) * (1.0 + further / DRAWN.exchange[0]))
        free = conducted @ rows
        free[:, self.blocks[f"level{region}"]] += 1.0
        known = conducted @ (constant + losses @ taken_k)
        for number, (late, early) in enumerate(pairwise(constants.PAST_MINUTES)):
            past = by_minute(modes, -60.0 * early, -60.0 * late, n)
            # as the first flux, the less the longer ago, beside what is unknown
            share = constants.PAST_SHARE * np.exp(-0.5 * (late + early) / constants.PAST_HOLDS_MIN)
            like_first = share * past
            free += np.outer(like_first, rows[0])
            known += like_first * constant[0]
            free[:, self.blocks["past"].start + number] += past
            free[:, self.blocks[f"past{region}"].start + number] += past
        moment, beam = self.blocks["moment"].start, self.blocks["beam"].start
        each = np.arange(n)
        free[each, moment + each] += kernel[0] * rows[each, beam + each]
        if region:
            level_k = fixed[self.layout.stores(region).start]
            free[:, self.blocks[f"own_response{region - 1}"].start] += taken_k - level_k
        # T = free + R (c - L (T - taken))
        both = np.linalg.solve(np.eye(n) + conducted @ losses, np.column_stack([free, known]))
        return both[:, :-1], both[:, -1]

    def readings(self):
        """Design (m, unknowns), readings (m,) less their constants, and their white variances (m,)."""
        design, residual = [], []
        for region in range(self.layout.regions):
            rows, constant = self.temperatures(region)
            if region:
                rows[:, self.blocks[f"offset{region}"].start] += 1.0
                rows[:, self.blocks[f"drift{region}"].start] += [minute.hours for minute in self.minutes]
            own = self.blocks[f"own{region}"].start
            rows[np.arange(self.count), own + np.arange(self.count)] += 1.0
            camera = self.blocks["camera"].start
            rows[np.arange(self.count), camera + np.arange(self.count)] += 1.0
            read = np.array([minute.measured[region] for minute in self.minutes])
            kelvin = np.array([minute.temperature_k[region] for minute in self.minutes])
            design.append(rows[read])
            residual.append((kelvin - constant)[read])
        variance = np.full(sum(map(len, residual)), self.noise.white_k**2)
        return np.concatenate(design), np.concatenate(residual), variance


def solved(unknowns, sessions):
    """Posterior mean (unknowns,), covariance, and log-likelihood of all readings of the sessions."""
    parts = [session.readings() for session in sessions]
    design = np.concatenate(
        [np.pad(rows, ((0, 0), (0, unknowns.size - rows.shape[1]))) for rows, *_ in parts]
    )
    mean = np.concatenate(unknowns.means)
    residual = np.concatenate([values for _, values, _ in parts]) - design @ mean
    covariance = np.zeros((unknowns.size, unknowns.size))
    start = 0
    for one in unknowns.covariances:
        block = slice(start, start := start + len(one))
        covariance[block, block] = one
    shared = design @ covariance
    spread = shared @ design.T + np.diag(np.concatenate([variance for *_, variance in parts]))
    solution = np.linalg.solve(spread, np.column_stack([residual, shared]))
    log_likelihood = -0.5 * (residual @ solution[:, 0] + np.linalg.slogdet(2.0 * np.pi * spread)[1])
    return mean + shared.T @ solution[:, 0], covariance - shared.T @ solution[:, 1:], log_likelihood


def window(seed, day, azimuth, start_h=12.0, kinds=None, known_bed=False):
    """Minutes of two beds and the reference with a board over one and frames missing; layout, settings."""
    world = drawn_world(seed, day, minutes=MINUTES, start_h=start_h, known_bed=known_bed)
    regions = world.regions[:3]
    history = world.history
    flags = np.zeros((MINUTES, 4), np.int64)
    flags[BOARD, 2] = int(Quality.SHADED)
    kelvin = history.temperature_k.copy()
    kelvin[20:23, 1] = np.nan
    kelvin[BOARD, 2] -= 3.0  # without cooling a shade would be left out
    history = replace(history, region_flags=flags, temperature_k=kelvin)
    settings = replace(world.settings, azimuth=azimuth, model="learned", kinds=kinds or {})
    columns = RegionColumns(regions)
    layout = Layout.of(columns, columns.targets, settings)
    return layout, minutes_between(history, 0, MINUTES, layout, settings), settings


def agree(filters, lasting, of_session, mean, covariance):
    """The filter's state is the dense solution, whose blocks of what lasts and of the session are given."""
    layout = filters.layout

    def scaled(name, place):
        """By the unknowns: the block of a normal or the gain with the change of the gain since."""
        rows = np.zeros((place.stop - place.start, mean.size))
        rows[:, lasting[name]] = np.eye(len(rows))
        rows[:, of_session["gain_change"].start] = filters.ends[-1][0, place] if filters.ends else 0.0
        return rows

    gain = slice(layout.place("gain"), layout.place("gain") + 1)
    by_unknowns = scaled("gain", gain)
    expected, variance = by_unknowns @ mean, by_unknowns @ covariance @ by_unknowns.T
    assert filters.mean[0, gain] == pytest.approx(expected, abs=1e-5 * np.sqrt(variance[0, 0]))
    assert filters.covariance[0, gain, gain] == pytest.approx(variance, rel=1e-5)
    for target, axes in enumerate(layout.facing):
        place, along = layout.normal(target), scaled(f"normal{target}", layout.normal(target))
        if target < layout.stated:
            along[:, lasting["gain"].start] = layout.known[1 + target] @ axes
        found, expected = (tilt_azimuth(axes @ one) for one in (filters.mean[0, place], along @ mean))
        assert found[0] == pytest.approx(expected[0], abs=1e-6)
        spread, wanted = filters.covariance[0, place, place], along @ covariance @ along.T
        np.testing.assert_allclose(spread, wanted, rtol=1e-5, atol=1e-6 * np.trace(wanted))
    for name in ("wind", *OF_SESSION, *(("session_exchange",) if filters.ends else ())):
        place, block = layout.place(name), {**lasting, **of_session}[name].start
        sd = np.sqrt(covariance[block, block])
        assert filters.mean[0, place] == pytest.approx(mean[block], abs=1e-5 * sd)
        assert np.sqrt(filters.covariance[0, place, place]) == pytest.approx(sd, rel=1e-5)


@pytest.mark.parametrize(
    ("seed", "day", "azimuth", "has_air", "kinds", "known_bed"),
    [
        (1, CLEAR, "known", True, {}, False),
        (2, CLEAR, "free", False, {}, False),
        (3, BROKEN_CLOUD, "known", False, {}, False),
        (4, BROKEN_CLOUD, "free", True, {}, True),
        (5, CLEAR, "free", True, {"bed1": "vegetation"}, False),
        (6, CLEAR, "known", False, {"bed0": "rock", "bed1": "snow"}, False),
        (7, CLEAR, "known", True, {}, True),
    ],
)
def test_filter_is_the_dense_solution(seed, day, azimuth, has_air, kinds, known_bed):
    layout, minutes, settings = window(seed, day, azimuth, kinds=kinds, known_bed=known_bed)
    filters = LinearFilters(layout, DRAWN, settings, Start(minutes[0], known(has_air, settings), noise=NOISE))
    unknowns = Unknowns()
    unknowns.lasting(layout, settings, has_air)
    dense = Dense(unknowns, filters.model, NOISE, minutes, settings, has_air)
    mean, covariance, log_likelihood = solved(unknowns, [dense])
    for minute in minutes:
        filters.step(minute)
    assert filters.log_likelihood[0] == pytest.approx(log_likelihood, rel=1e-6)
    agree(filters, dense.blocks, dense.blocks, mean, covariance)


@pytest.mark.parametrize(
    ("seed", "azimuth", "has_air", "kinds"),
    [(1, "known", (True, False), {}), (2, "free", (False, True), {"bed1": "rock"})],
)
def test_two_sessions_are_the_dense_solution_of_both(seed, azimuth, has_air, kinds):
    """A morning and an afternoon of one field, with other instruments and another noise."""
    layout, morning, settings = window(seed, CLEAR, azimuth, start_h=9.5, kinds=kinds)
    _, afternoon, _ = window(seed, CLEAR, azimuth, start_h=14.0)
    unknowns = Unknowns()
    unknowns.lasting(layout, settings, has_air[0])
    filters = LinearFilters(
        layout, DRAWN, settings, Start(morning[0], known(has_air[0], settings), noise=NOISE)
    )
    first = Dense(unknowns, filters.model, NOISE, morning, settings, has_air[0])
    for minute in morning:
        filters.step(minute)
    filters.begin_session(Start(afternoon[0], known(has_air[1], settings), noise=LATER_NOISE))
    ended = filters.ends[0][0]
    second = Dense(unknowns, filters.model, LATER_NOISE, afternoon, settings, has_air[1], ended)
    for minute in afternoon:
        filters.step(minute)
    mean, covariance, log_likelihood = solved(unknowns, [first, second])
    assert filters.log_likelihood[0] == pytest.approx(log_likelihood, rel=1e-6)
    agree(filters, first.blocks, second.blocks, mean, covariance)
