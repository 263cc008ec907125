"""Measured and modelled ground over the hours of a record, as SVG text with matplotlib."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.confidence import CONFIDENCE, percent
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.facet import FloatArray
from fieldkit.views import plotting


def ground_temperatures(
    measured_k: FloatArray, modelled_k: FloatArray, half_width_k: FloatArray, fitted: NDArray[np.bool_]
) -> str:
    """Temperatures with their interval, and residuals below; fitted minutes are shaded.

    Arrays by the minute, (n,), kelvin.
    """
    figure, (above, below) = plotting.panels(2, 5.2)
    hours = np.arange(measured_k.size) / 60.0
    low, high = modelled_k - half_width_k, modelled_k + half_width_k
    sure = percent(CONFIDENCE)
    blue, orange = plotting.colour(0), plotting.colour(1)
    above.fill_between(
        hours,
        low - CELSIUS_ZERO_K,
        high - CELSIUS_ZERO_K,
        color=orange,
        alpha=0.3,
        linewidth=0,
        label=sure,
    )
    above.plot(hours, measured_k - CELSIUS_ZERO_K, color=blue, linewidth=0.8, label="measured")
    above.plot(hours, modelled_k - CELSIUS_ZERO_K, color=orange, linewidth=0.8, label="modelled")
    above.set_ylabel("ground, °C")
    below.fill_between(hours, -half_width_k, half_width_k, color=orange, alpha=0.3, linewidth=0)
    below.plot(hours, modelled_k - measured_k, color=blue, linewidth=0.8)
    below.set_ylabel("modelled − measured, K")
    below.set_xlabel("hours of the record")
    for axes in (above, below):
        axes.axvspan(
            *hours[np.flatnonzero(fitted)[[0, -1]]], color="0.85", alpha=0.5, linewidth=0, zorder=0,
            label="fitted" if axes is above else "",
        )  # fmt: skip
    plotting.legend(above)
    return plotting.svg(figure)
