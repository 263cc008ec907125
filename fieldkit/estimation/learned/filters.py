"""Many Kalman filters side by side: one for each hypothesis about the exchange, the layer and the gusts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fieldkit.estimation.learned.bank import Affine, Innovation, KalmanBank, Transition
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.noise import OWN_K, Noise
from fieldkit.estimation.learned.prior_state import (
    DAY_TO_DAY,
    past_of_first_flux,
    prior_covariance,
    prior_mean,
)
from fieldkit.estimation.learned.surface import SurfaceModel
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray

LEAST_EXCHANGE = 0.5
"""Least exchange of a further session, W m-2 K-1, whose own is a normal number without a bound.

Judged: because still air over level ground at night gives no less.
"""


class Start(NamedTuple):
    """First minute of a session and what it logs; the state (n,) to linearise around, and regions' noise."""

    first: MinuteInputs
    logged: Logged
    around: FloatArray | None = None
    noise: Noise | None = None


class Filters(KalmanBank):
    """The bank that follows a surface minute by minute; `log_likelihood` (p,) of all that was measured.

    Products of two unknowns are linear only near some state (n,): that of the `Start`, else the prior's. Its
    noise is what each region does alone. `ends` are the means (p, n) with which sessions before ended.
    """

    def __init__(
        self, layout: Layout, hypotheses: Hypotheses, settings: EstimatorSettings, start: Start
    ) -> None:
        self.layout = layout
        self.hypotheses = hypotheses
        self.ends: list[FloatArray] = []
        self.log_likelihood: FloatArray = np.zeros(hypotheses.exchange.size)
        self._settings = settings
        self._begin(*start)
        self._fill_stores(start.first)

    @property
    def exchange(self) -> FloatArray:
        """Heat exchange of the present session (p,), W m-2 K-1."""
        further = self.mean[:, self.layout.place("session_exchange")]
        return np.maximum(self.hypotheses.exchange + further, LEAST_EXCHANGE)

    def begin_session(self, start: Start) -> None:
        """Begin a further session: what lasts is known as before, everything else as before any data."""
        self.ends.append(self.mean)
        lasting = self.layout.lasting_places
        # the light meter's response to another sun, and dust: gain, and normals times the gain
        scaled = self.layout.gain_and_normals
        self.covariance[:, scaled[:, np.newaxis], scaled] += DAY_TO_DAY["gain"] ** 2 * (
            self.mean[:, scaled, np.newaxis] * self.mean[:, np.newaxis, scaled]
        )
        mean, covariance = self.mean[:, lasting], self.covariance[:, lasting[:, np.newaxis], lasting]
        self._begin(*start)
        self.mean[:, lasting] = mean
        self.covariance[:, lasting[:, np.newaxis], lasting] = covariance
        exchange = self.layout.place("session_exchange")
        # weather stays with its day: this session's exchange is as uncertain as the first one's was
        spread = self._settings.prior.exchange_log_sd * self.hypotheses.exchange
        self.covariance[:, exchange, exchange] = spread**2
        self._fill_stores(start.first)

    def _begin(
        self, first: MinuteInputs, logged: Logged, around: FloatArray | None, noise: Noise | None
    ) -> None:
        """The state before any data."""
        layout, hypotheses, settings = self.layout, self.hypotheses, self._settings
        self.noise: Noise = noise or Noise(settings.noise_k, OWN_K)
        mean = prior_mean(layout, settings, first, logged)
        covariance = prior_covariance(layout, settings, hypotheses, logged, self.noise)
        self.mean: FloatArray = np.tile(mean, (len(covariance), 1))
        self.covariance: FloatArray = covariance
        self.model: SurfaceModel = SurfaceModel(
            layout, hypotheses, settings, logged, mean if around is None else around, self.noise
        )
        for place, variance in self.model.passing(first).items():
            self.covariance[:, place, place] = variance
        self._taken_k: FloatArray = np.tile(first.temperature_k, (len(covariance), 1))
        self._flux: Affine | None = None

    def _fill_stores(self, first: MinuteInputs) -> None:
        """Fill the stores by fluxes before the first minute that were like its own."""
        flux = self.model.flux(first, self.model.light(first, self.mean, self.covariance), self._taken_k)
        constant = np.ones(self.layout.size)
        into = past_of_first_flux(self.layout)
        self.predict(Transition(constant, into, flux, slice(0)), np.zeros_like(self.mean))

    def step(self, minute: MinuteInputs) -> Innovation:
        """Predict a minute from the one before, and correct the states by its temperatures."""
        model = self.model
        if self._flux is not None:  # before the first minute lies the prior
            self.predict(model.transition(minute, self._flux), model.noise(minute))
        light = model.light(minute, self.mean, self.covariance)
        temperature, self._flux = model.equations(minute, light, self.mean, self._taken_k)
        measured_k = np.where(minute.measured, minute.temperature_k, np.nan)
        variance = self.noise.white_k**2 + model.grazing_k2(minute, light, self.mean, self._taken_k)
        readings, jumps = model.readings(minute, temperature), self.layout.own_places
        innovation = self.update(readings, measured_k, variance, jumps)
        # of the surface, by the state: the measured one would carry the camera's noise into the fluxes
        self._taken_k = temperature.at(self.mean)
        self.log_likelihood = self.log_likelihood + innovation.log_likelihood
        return innovation
