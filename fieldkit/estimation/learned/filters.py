"""Many Kalman filters side by side: one for each hypothesis about the exchange, the layer and the gusts."""

from __future__ import annotations

import numpy as np

from fieldkit.estimation.learned.bank import Affine, Innovation, KalmanBank
from fieldkit.estimation.learned.hypotheses import Hypotheses
from fieldkit.estimation.learned.inputs import Logged, MinuteInputs
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.noise import OWN_K, Noise
from fieldkit.estimation.learned.prior_state import prior_covariance, prior_mean
from fieldkit.estimation.learned.surface import SurfaceModel
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.facet import FloatArray


class Filters(KalmanBank):
    """The bank that follows a surface minute by minute; `log_likelihood` (p,) of all that was measured.

    Products of two unknowns are linear only near some state (n,): `around`, else the prior's. `noise` is what
    each region does alone.
    """

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        settings: EstimatorSettings,
        first: MinuteInputs,
        logged: Logged,
        around: FloatArray | None = None,
        noise: Noise | None = None,
    ) -> None:
        self.layout = layout
        self.hypotheses = hypotheses
        self.noise = noise or Noise(settings.noise_k, OWN_K)
        mean = prior_mean(layout, settings, first, logged)
        covariance = prior_covariance(layout, settings, hypotheses, logged, self.noise)
        super().__init__(np.tile(mean, (len(covariance), 1)), covariance)
        self.log_likelihood: FloatArray = np.zeros(len(covariance))
        self.model: SurfaceModel = SurfaceModel(
            layout, hypotheses, settings, logged, mean if around is None else around, self.noise
        )
        for place, variance in self.model.passing(first).items():
            self.covariance[:, place, place] = variance
        self._taken_k = np.tile(first.temperature_k, (len(covariance), 1))
        self._flux: Affine | None = None

    def step(self, minute: MinuteInputs) -> Innovation:
        """Predict a minute from the one before, and correct the states by its temperatures."""
        model = self.model
        if self._flux is not None:  # before the first minute lies the prior
            self.predict(model.transition(minute, self._flux), model.noise(minute))
        light = model.light(minute, self.mean, self.covariance)
        temperature, self._flux = model.equations(minute, light, self.mean, self._taken_k)
        measured_k = np.where(minute.measured, minute.temperature_k, np.nan)
        variance = self.noise.white_k**2 + model.grazing_k2(minute, light, self.mean, self._taken_k)
        found = self.update(model.readings(minute, temperature), measured_k, variance, self.layout.own_places)
        self._taken_k = temperature.at(self.mean)
        self.log_likelihood = self.log_likelihood + found.log_likelihood
        return found
