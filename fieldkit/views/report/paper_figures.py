"""The paper's Figs. 12 and 13 as SVG text, for one session or several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fieldkit.estimation.statistics import ErrorSpan
from fieldkit.views import words
from fieldkit.views.report import canvas
from fieldkit.views.report.series import FloatArray


def measured_against_modelled(
    measured_k: Mapping[str, FloatArray], modelled_k: Mapping[str, FloatArray], rmse_k: float
) -> str:
    """The paper's Fig. 12: one point per minute and bed about the line of equality."""
    figure, (axes,) = canvas.panels(1, 4.6)
    everything = []
    for index, (name, measured) in enumerate(measured_k.items()):
        x, y = modelled_k[name] - words.ZERO_CELSIUS_K, measured - words.ZERO_CELSIUS_K
        both = np.isfinite(x) & np.isfinite(y)
        everything += [x[both], y[both]]
        axes.plot(
            x[both],
            y[both],
            linestyle="none",
            marker=canvas.marker(index),
            markersize=3.5,
            alpha=0.7,
            markeredgewidth=0,
            color=canvas.colour(index),
            label=name,
        )
    values = np.concatenate(everything)
    ends = [float(np.min(values)) - 1.0, float(np.max(values)) + 1.0]
    axes.plot(ends, ends, color="black", linewidth=1)
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.set_xlabel("modelled by eq. (7), °C")
    axes.set_ylabel("measured, °C")
    axes.text(0.97, 0.04, f"RMSE {rmse_k:.2f} K", transform=axes.transAxes, ha="right")
    canvas.legend(axes)
    return canvas.svg(figure)


def errors_over_local_time(errors: Mapping[str, Sequence[ErrorSpan]], zone: str) -> str:
    """The paper's Fig. 13: mean absolute tilt error per stretch of the day, bars of one SD.

    Spans are in nanoseconds since local midnight; `zone` names whose midnight.
    """
    from matplotlib.ticker import MultipleLocator

    figure, (axes,) = canvas.panels(1, 3.4)
    for index, (name, spans) in enumerate(errors.items()):
        aside_h = (index - (len(errors) - 1) / 2) / 60  # a minute apart: bars do not hide each other
        axes.errorbar(
            [span.middle_ns / 3.6e12 + aside_h for span in spans],
            [span.mean for span in spans],
            yerr=[span.sd for span in spans],
            marker=canvas.marker(index),
            linestyle=canvas.dashes(index),
            markersize=5,
            capsize=3,
            color=canvas.colour(index),
            label=name,
        )
    axes.set_ylabel("absolute tilt error, °")
    axes.set_ylim(bottom=0)
    first, last = axes.get_xlim()
    step_h = 0.25 if last - first < 1.5 else 1.0 if last - first < 6 else 2.0
    axes.xaxis.set_major_locator(MultipleLocator(step_h))
    axes.xaxis.set_major_formatter(lambda hour, _position: f"{int(hour):02d}:{round(hour % 1 * 60):02d}")
    axes.set_xlabel(f"local time ({zone})")
    canvas.legend(axes)
    return canvas.svg(figure)
