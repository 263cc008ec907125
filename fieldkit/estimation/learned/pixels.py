"""Pixels by the learned model: each is one more target, of which the regions have taught all but the slope.

A pixel's temperature less the reference's is over the minutes, with what is common to all surfaces gone::

    dT = R (gain V (n - n_ref) - F) - r + e

R: warming of the layer by a flux, V: light and longwave by a normal, F: heat that the pixel loses more, by
the exchange of each minute; r: what the reference's temperature is off; e: noise and everything that a region
may do alone, with the covariance that the filters give it (`prior_state`). The targets of known slope show
exchange and r; with e whitened, the rows of all pixels share one design (generalised least squares; C. E.
Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press, 2006, section 2.7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.learned.bank import JUMP_SDS
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import logged_inputs, minutes_between
from fieldkit.estimation.learned.layout import GUSTS, Layout
from fieldkit.estimation.learned.noise import noise_of
from fieldkit.estimation.learned.prior_state import prior_covariance, prior_mean, processes
from fieldkit.estimation.learned.surface import SurfaceModel
from fieldkit.estimation.region_temperatures import remove_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray, SingleArray
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Region
from fieldkit.physics.constants import STEFAN_BOLTZMANN

JUMP_K = 10.0
"""Standard deviation of the temperature in a jump.

Judged: because it is so much more than any noise that what it was then is no evidence any more.
"""
LEAST_GUST = 1e-3
"""Independent change of the exchange from minute to minute, which keeps its covariance invertible.

Judged: because it is a thousandth of the gusts' usual strength.
"""
LEAST_EXCHANGE = 1.0
"""However little wind there is. [W m-2 K-1]

Judged: because a pixel that gives nothing to the air would have no bound of its warmth but radiation.
"""


@dataclass(frozen=True, slots=True)
class PixelRows:
    """Rows of unit variance of k minutes, ``design n = by_temperature dT + by_loss F + constant``.

    `reference_k` and `exchange_w_m2_k` (n,) are of each frame: mean of the references, heat exchange with the
    air; `emissivity` is broadband. The rows are by the unit normal, `design` (k, 3), by temperature and heat
    loss over the reference, (k, n), and `constant` (k,). `towards_sun` (3,) is the mean unit vector to the
    sun, `scale_sd` the relative uncertainty of the light that one pixel absorbs.
    """

    reference_k: FloatArray
    exchange_w_m2_k: FloatArray
    emissivity: float
    design: FloatArray
    by_temperature: SingleArray
    by_loss: SingleArray
    constant: SingleArray
    towards_sun: FloatArray
    scale_sd: float

    def values(self, over_k: SingleArray) -> SingleArray:
        """``design n`` of pixels (k, pixels), by their temperatures over the reference's (n, pixels)."""
        level = self.reference_k[:, np.newaxis].astype(np.float32)
        kelvin = level + over_k
        # a difference of fourth powers, without that of two large numbers
        emitted = over_k * (level + kelvin) * (level * level + kelvin * kelvin)
        loss = np.float32(self.emissivity * STEFAN_BOLTZMANN) * emitted
        loss += self.exchange_w_m2_k[:, np.newaxis].astype(np.float32) * over_k
        return self.by_temperature @ over_k + self.by_loss @ loss + self.constant[:, np.newaxis]


class PixelModel:
    """A pixel and the reference over m minutes without a gap, of which n have a frame.

    `history` holds minutes with a frame and a reference, those before the map's included, as warmth is
    remembered; its columns `regions` have at least one reference and one target. `chosen` (n,) are the
    minutes of the map, `normals` unit normals of the targets with a slope, by name: they show the exchange of
    each minute.
    """

    def __init__(
        self,
        history: History,
        regions: Sequence[Region],
        chosen: BoolArray,
        normals: Mapping[str, FloatArray],
        settings: EstimatorSettings,
        learnt: Learnt,
    ) -> None:
        # azimuths of regions are not those of pixels
        settings = replace(settings, azimuth="free")
        self._history, self._settings = remove_offsets(history, regions, settings), settings
        self._columns = RegionColumns(tuple(regions))
        self._chosen, self._normals = chosen, normals
        self._learnt = {parameter.name: parameter for parameter in learnt.parameters}
        self._layout = Layout.of(self._columns, self._columns.targets, settings)
        self._minutes = minutes_between(self._history, 0, len(history), self._layout, settings)
        self._frames: IntArray = history.minute - history.minute[0]
        steps = np.arange(len(self._minutes), dtype=np.float64)
        self._apart: FloatArray = np.abs(np.subtract.outer(steps, steps))
        self._take_model()
        own = _relaxing(self._apart, *_of(self._processes[self._layout.own(0)]))
        self._noise: FloatArray = settings.noise_k**2 * np.eye(len(steps)) + own
        self._find_jumps()

    def _take_model(self) -> None:
        """The filters' model and priors with what was learnt as the one hypothesis."""
        layout, settings, minutes = self._layout, self._settings, self._minutes
        quantities = logged_inputs(self._history, 0, layout, self._columns.regions, settings)
        noise, drawn = noise_of(minutes, settings.noise_k), self._hypothesis()
        around = prior_mean(layout, settings, minutes[0], quantities)
        for name in ("gain", "diffuse", "circumsolar"):
            around[layout.place(name)] = self._learnt[name].value
        self._surface = SurfaceModel(layout, drawn, settings, quantities, around, noise)
        self._processes = processes(layout, settings.prior, drawn, quantities, noise)
        self._prior: FloatArray = prior_covariance(layout, settings, drawn, quantities, noise)[0]
        self._own_gain_sd = float(settings.prior.own_gain_sd * noise.unlike(drawn.unrest)[0])
        self._warming, self._fading = self._surface.warming(len(minutes))

    def _hypothesis(self) -> Hypotheses:
        values = {name: np.array([parameter.value]) for name, parameter in self._learnt.items()}
        return Hypotheses(
            exchange=values["exchange"],
            inertia=values["thermal_inertia"],
            depth_m=values["depth"] / 100.0,
            gust=values["gusts"],
            # no learnt parameter: the prior's median
            unrest=np.ones(1),
        )

    def rows(self) -> PixelRows:
        """The rows of a pixel, by the exchange that the targets show."""
        shared, unknown = self._shared_effects
        change, reference = np.split(shared, 2)
        chosen, settings, at = self._chosen, self._settings, self._frames[self._chosen]
        effect = self._effect(self._typical_over_k)
        whitening = _whitening(self._alone(self._typical_over_k) + effect @ unknown @ effect.T, at)
        between = _interpolation(self._frames, len(self._minutes))
        design = whitening @ self._design[at]
        seen, gain = np.eye(len(self._frames))[chosen], self._learnt["gain"]
        by_loss = whitening @ (self._warming[at] @ between)
        towards = self._history.sun[chosen].mean(axis=0)
        return PixelRows(
            reference_k=self._reference_k[self._frames],
            exchange_w_m2_k=(self._exchange + change)[self._frames],
            emissivity=settings.surface.emissivity_broadband,
            design=design,
            by_temperature=(whitening @ seen).astype(np.float32),
            by_loss=by_loss.astype(np.float32),
            constant=(design @ self._reference_normal + whitening @ reference[at]).astype(np.float32),
            towards_sun=towards / np.linalg.norm(towards),
            scale_sd=float(np.hypot(gain.sd / gain.value, self._own_gain_sd)),
        )

    # --- what the targets show of the exchange and of the reference

    @cached_property
    def _shared_effects(self) -> tuple[FloatArray, FloatArray]:
        """Shared by all pixels: mean (2 m,) and covariance (2 m, 2 m), by the targets of known slope.

        First the exchange of each minute over that of all, then what the reference's temperature, with the
        heat lost by it, is off. Gaussian smoothing: the amplitudes are those that the session taught.
        """
        information = np.linalg.inv(self._shared_prior)
        towards = np.zeros(len(information))
        for over_k, remainder, at in self._targets:
            whitening = _whitening(self._alone(over_k), at)
            effect = whitening @ self._effect(over_k)[at]
            information += effect.T @ effect
            towards += effect.T @ (whitening @ remainder[at])
        covariance = np.linalg.inv(information)
        return covariance @ towards, covariance

    @property
    def _shared_prior(self) -> FloatArray:
        """Covariance (2 m, 2 m) of what is shared before the targets show it."""
        return np.asarray(block_diag(self._gusts, self._passing))

    def _effect(self, over_k: FloatArray) -> FloatArray:
        """Design (m, 2 m) by which what is shared enters a target's temperature."""
        return -np.hstack([self._warming * over_k, np.eye(len(over_k))])

    def _find_jumps(self) -> None:
        """Add noise where a target or the reference left its prediction: a shadow, as the filters take it."""
        _, own_minutes = self._processes[self._layout.own(0)]
        for over_k, remainder, at in self._targets:
            effect = self._effect(over_k)
            scatter = self._alone(over_k) + effect @ self._shared_prior @ effect.T
            errors = _whitening(scatter, at) @ remainder[at]
            for jump in at[np.abs(errors) > JUMP_SDS].tolist():
                # from then on, as the region's own deviations fade
                fades = np.exp(-self._apart[jump] / own_minutes) * (np.arange(len(remainder)) >= jump)
                self._noise += JUMP_K**2 * np.outer(fades, fades)

    @cached_property
    def _targets(self) -> list[tuple[FloatArray, FloatArray, IntArray]]:
        """Targets of known slope: temperature over the reference (m,), what is left of it, and when."""
        targets = []
        for place in range(self._layout.region(0), self._layout.regions):
            column = self._layout.columns[place]
            slope = self._normals.get(self._columns.regions[column].name)
            if slope is None:
                continue
            over_k = self._temperature_k[:, place] - self._reference_k
            by_light = self._design @ (slope - self._reference_normal)
            remainder = over_k + self._warming @ self._loss(over_k) - by_light
            measured = self._chosen & np.isfinite(self._history.temperature_k[:, column])
            targets.append((over_k, remainder, self._frames[measured]))
        return targets

    @cached_property
    def _gusts(self) -> FloatArray:
        """Prior covariance (m, m) of what the exchange of all surfaces does over the minutes."""
        layout, by_place = self._layout, self._processes
        wind_sd = self._settings.prior.wind_sd_w_m2_k_per_m_s
        covariance = wind_sd**2 * np.outer(self._wind_change, self._wind_change)
        for name in GUSTS:
            covariance += _relaxing(self._apart, *_of(by_place[layout.place(name)]))
        covariance += _following(self._apart, *_of(by_place[layout.place("slow_gust_drive")]))
        return np.asarray(covariance + LEAST_GUST**2 * np.eye(len(covariance)))

    @cached_property
    def _exchange(self) -> FloatArray:
        """Exchange (m,) before the targets show that of each minute: the learnt one, and by the wind."""
        by_wind = self._settings.prior.wind_w_m2_k_per_m_s * self._wind_change
        return np.asarray(np.maximum(self._learnt["exchange"].value + by_wind, LEAST_EXCHANGE))

    @property
    def _wind_change(self) -> FloatArray:
        return np.array([minute.wind_change for minute in self._minutes])

    # --- a target against the reference

    @cached_property
    def _temperature_k(self) -> FloatArray:
        """Temperatures of the regions (m, regions), straight between those measured."""
        kelvin = self._history.temperature_k[:, self._layout.columns]
        steps, is_finite = np.arange(len(self._minutes)), np.isfinite(kelvin).T
        bridged = [
            np.interp(steps, self._frames[is_], column[is_])
            for is_, column in zip(is_finite, kelvin.T, strict=True)
        ]
        return np.column_stack(bridged)

    @property
    def _reference_k(self) -> FloatArray:
        return self._temperature_k[:, 0]

    @property
    def _reference_normal(self) -> FloatArray:
        return np.asarray(self._layout.known[0])

    @property
    def _typical_over_k(self) -> FloatArray:
        """Temperature over the reference (m,) for which the scatter of pixels is that of the targets."""
        over_k = self._temperature_k[:, self._layout.region(0) :] - self._reference_k[:, np.newaxis]
        return np.asarray(np.sqrt((over_k**2).mean(axis=1)))

    @cached_property
    def _design(self) -> FloatArray:
        """Warming (m, 3) by the components of a unit normal."""
        absorbed = np.array([self._surface.by_normal(minute) for minute in self._minutes])
        return np.asarray(self._learnt["gain"].value * self._warming @ absorbed)

    def _loss(self, over_k: FloatArray) -> FloatArray:
        emissivity, kelvin = self._settings.surface.emissivity_broadband, self._reference_k + over_k
        emitted = emissivity * STEFAN_BOLTZMANN * (kelvin**4 - self._reference_k**4)
        return np.asarray(emitted + self._exchange * over_k)

    # --- its scatter

    def _alone(self, over_k: FloatArray) -> FloatArray:
        """Covariance (m, m) of ``dT + R F`` by what a target does alone, so much over the reference."""
        layout, target, kelvin = self._layout, self._layout.region(0), self._reference_k + over_k
        hours = np.array([minute.hours for minute in self._minutes])
        offset, drift = (self._prior[place, place] for place in (layout.offset(target), layout.drift(target)))
        read = self._lost @ (offset + drift * np.outer(hours, hours)) @ self._lost.T
        over_air = kelvin - np.array([minute.air_k for minute in self._minutes])
        flux = self._own_exchange * np.outer(over_air, over_air)
        place, warmed = layout.own_response(0), kelvin - kelvin[0]
        response = self._prior[place, place] * np.outer(warmed, warmed)
        return np.asarray(self._passing + read + self._warming @ flux @ self._warming.T + response)

    @property
    def _passing(self) -> FloatArray:
        """Covariance (m, m) of any region's noise, own deviations and warmth from before, K2."""
        here, there = self._layout.stores(0), self._layout.stores(self._layout.regions - 1)
        # the covariance of two regions is what both share, and no difference between them
        before = self._prior[here, here] - self._prior[here, there]
        return np.asarray(self._lost @ self._noise @ self._lost.T + self._fading @ before @ self._fading.T)

    @cached_property
    def _lost(self) -> FloatArray:
        """Matrix (m, m) from a deviation of temperature to that with the heat lost by it."""
        emissivity = self._settings.surface.emissivity_broadband
        steepness = 4.0 * emissivity * STEFAN_BOLTZMANN * self._reference_k**3 + self._exchange
        return np.asarray(np.eye(len(steepness)) + self._warming * steepness)

    @cached_property
    def _own_exchange(self) -> FloatArray:
        """Covariance (m, m) of a target's own exchange, (W m-2 K-1)2."""
        layout = self._layout
        lasting = layout.own_exchange(0)
        slow = _following(self._apart, *_of(self._processes[layout.slow_exchange_drive(0)]))
        return np.asarray(slow + self._prior[lasting, lasting])


def _whitening(covariance: FloatArray, at: IntArray) -> FloatArray:
    """Matrix (k, k) that makes what scatters so at these places independent and of unit variance."""
    root = np.linalg.cholesky(covariance[np.ix_(at, at)])
    return np.asarray(solve_triangular(root, np.eye(len(root)), lower=True))


def _interpolation(places: IntArray, size: int) -> FloatArray:
    """Matrix (size, n) from values at n places to those of all, straight in between."""
    steps = np.arange(size)
    return np.column_stack([np.interp(steps, places, unit) for unit in np.eye(places.size)])


def _of(process: tuple[FloatArray, float]) -> tuple[float, float]:
    sd, minutes = process
    return float(sd[0]), minutes


def _relaxing(apart: FloatArray, sd: float, minutes: float) -> FloatArray:
    """Covariance of an Ornstein-Uhlenbeck process over times apart."""
    return np.asarray(sd**2 * np.exp(-apart / minutes))


def _following(apart: FloatArray, sd: float, minutes: float) -> FloatArray:
    """Covariance of what follows such a process with the same time constant: Matern's of order 3/2."""
    return np.asarray(sd**2 / 2.0 * (1.0 + apart / minutes) * np.exp(-apart / minutes))
