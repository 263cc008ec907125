"""Prediction errors of all minutes as the sums that are asked for: those of a day would fill the memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np

from fieldkit.estimation.learned.bank import Innovation
from fieldkit.model.arrays import FloatArray


def _zero() -> FloatArray:
    return np.zeros(1)  # of whatever shape the first minute has


@dataclass(frozen=True, slots=True)
class ErrorSums:
    """Sums over minutes of prediction errors, by hypothesis and region (p, m), or of one hypothesis (m,).

    `count` of those measured, their squares in kelvin (`kelvin`) and standardised (`squares`), and `products`
    of each standardised error with the one before, which is `last`; NaN is skipped.
    """

    minutes: int = 0
    count: FloatArray = field(default_factory=_zero)
    kelvin: FloatArray = field(default_factory=_zero)
    squares: FloatArray = field(default_factory=_zero)
    products: FloatArray = field(default_factory=_zero)
    last: FloatArray = field(default_factory=_zero)

    def plus(self, innovation: Innovation) -> ErrorSums:
        """The sums with one minute more."""
        kelvin, white = np.nan_to_num(innovation.difference), np.nan_to_num(innovation.standardised)
        return ErrorSums(
            self.minutes + 1,
            self.count + np.isfinite(innovation.standardised),
            self.kelvin + kelvin**2,
            self.squares + white**2,
            self.products + white * self.last,
            white,
        )

    def under(self, hypothesis: int) -> ErrorSums:
        """The sums of one hypothesis: a mixture has no prediction errors of its own."""
        sums = (getattr(self, column.name)[hypothesis] for column in fields(self)[1:])
        return ErrorSums(self.minutes, *sums)

    @property
    def rms_k(self) -> FloatArray:
        """Root mean square, in kelvin."""
        return np.asarray(np.sqrt(self.kelvin / np.maximum(self.count, 1)))

    @property
    def autocorrelation(self) -> FloatArray:
        """Correlation from minute to minute; 0 with fewer than three minutes."""
        is_enough = self.minutes >= 3
        return np.asarray(is_enough * self.products / np.maximum(self.squares, 1e-12))

    @property
    def misfit(self) -> FloatArray:
        """How much too small stated variances are; 1 for a region with fewer than ten minutes.

        Errors of a right model are white and of unit variance; with the mean square c and the correlation r
        from minute to minute it is ``c (1 + r) / (1 - r)``, the variance of the mean of an autoregressive
        process of order 1 (G. E. P. Box and G. M. Jenkins, Time Series Analysis, Holden-Day, 1970, section
        2.1). A model that is wrong can also fit by parameters that nothing has: see `readout.surprise`.
        """
        # below zero it would excuse a misfit, at one the quotient has no bound
        correlation = np.clip(self.autocorrelation, 0.0, 0.95)
        mean_square = self.squares / np.maximum(self.count, 1)
        return np.where(self.count < 10, 1.0, mean_square * (1.0 + correlation) / (1.0 - correlation))

    def chi_square(self, regions: int | slice = slice(None)) -> float:
        """Mean square of standardised errors over some regions; NaN if none was measured."""
        count = float(np.sum(self.count[regions]))
        return float(np.sum(self.squares[regions])) / count if count else math.nan
