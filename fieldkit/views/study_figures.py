"""Figures of the studies as SVG text: 5 to 10 and 12 to 14 of the paper.

Arrays in, SVG text out; nothing is computed here but axes. In the tables the horizontal axis is the
slope's azimuth from north, clockwise, and the vertical axis its tilt, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.estimation.statistics import ErrorSpan
from fieldkit.model.arrays import FloatArray
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.views import plotting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def radiation_table(
    table: FloatArray, tilts: FloatArray, azimuths: FloatArray, measured: float | None = None
) -> str:
    """Fig. 5: irradiance on a slope minus that on flat ground, W/m2, (tilts, azimuths).

    Fig. 6: the same with all slopes that explain one `measured` difference.
    """
    figure, axes = _mesh(table, tilts, azimuths, "coolwarm", "difference to flat ground, W/m²")
    if measured is not None:
        axes.contour(azimuths, tilts, table, levels=[measured], colors="black", linewidths=2)
        axes.set_title(f"contour of {measured:.1f} W/m²", fontsize=plotting.FONT_PT)
    return plotting.svg(figure)


def contours(
    tables: Mapping[str, FloatArray],
    tilts: FloatArray,
    azimuths: FloatArray,
    measured: Sequence[float],
    truth: tuple[float, float] | None,
) -> str:
    """Figs. 7 and 14: one contour per time; `truth` (tilt, azimuth) is where they should meet."""
    figure, axes = _figure()
    for index, ((name, table), value) in enumerate(zip(tables.items(), measured, strict=True)):
        if table.min() < value < table.max():
            axes.contour(
                azimuths, tilts, table, levels=[value], colors=plotting.colour(index), linewidths=1.8
            )
        axes.plot([], [], color=plotting.colour(index), label=name)
    if truth is not None:
        axes.plot(
            [truth[1]], [truth[0]], marker="+", markersize=14, color="black", linestyle="none", label="truth"
        )
    axes.legend(**plotting.LEGEND)
    _slope_axes(axes)
    return plotting.svg(figure)


def scores(score_map: FloatArray, tilts: FloatArray, azimuths: FloatArray) -> str:
    """Fig. 8: contour score of each slope."""
    return plotting.svg(_mesh(score_map, tilts, azimuths, "viridis", "score")[0])


def cumulative(errors: Mapping[str, FloatArray]) -> str:
    """Fig. 9: share of slopes estimated within an absolute tilt error, one line per start."""
    figure, axes = _figure()
    for index, (name, values) in enumerate(errors.items()):
        finite = np.sort(values[np.isfinite(values)])
        share = np.arange(1, finite.size + 1) / values.size
        axes.plot(finite, share, color=plotting.colour(index), label=name)
    widest = max((float(np.nanpercentile(values, 97)) for values in errors.values()), default=1.0)
    axes.set(xlim=(0.0, max(widest, 0.1)), ylim=(0.0, 1.0))
    axes.axhline(0.9, color="0.6", linestyle=":")
    axes.set_xlabel("absolute tilt error, degrees")
    axes.set_ylabel("cumulative probability")
    axes.legend(loc="lower right", **plotting.LEGEND)
    return plotting.svg(figure)


def directions(errors: Mapping[str, tuple[FloatArray, FloatArray]]) -> str:
    """Fig. 10: mean absolute tilt error by direction of the slope, north up, clockwise."""
    from matplotlib.figure import Figure

    with plotting.figure_style():
        figure = Figure(figsize=(5.4, 4.8), layout="constrained")
        axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    for index, (name, (centres, values)) in enumerate(errors.items()):
        around = np.radians(np.append(centres, centres[0]))
        axes.plot(around, np.append(values, values[0]), color=plotting.colour(index), label=name)
    axes.legend(loc="upper left", bbox_to_anchor=(0.95, 1.1), **plotting.LEGEND)
    return plotting.svg(figure)


def measured_against_modelled(
    measured_k: Mapping[str, FloatArray], modelled_k: Mapping[str, FloatArray], rmse_k: float
) -> str:
    """The paper's Fig. 12: one point per minute and bed about the line of equality."""
    figure, (axes,) = plotting.panels(1, 4.6)
    everything = []
    for index, (name, temperature_k) in enumerate(measured_k.items()):
        x, y = modelled_k[name] - CELSIUS_ZERO_K, temperature_k - CELSIUS_ZERO_K
        both = np.isfinite(x) & np.isfinite(y)
        everything += [x[both], y[both]]
        style = plotting.marks(index, name) | {"markersize": 3.5, "alpha": 0.7, "markeredgewidth": 0}
        plotting.mark_part(index, axes.plot(x[both], y[both], linestyle="none", **style))
    values = np.concatenate(everything)
    ends = [float(np.min(values)) - 1.0, float(np.max(values)) + 1.0]
    axes.plot(ends, ends, color="black", linewidth=1)
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.set_xlabel("modelled by eq. (7), °C")
    axes.set_ylabel("measured, °C")
    axes.text(0.97, 0.04, f"RMSE {rmse_k:.2f} K", transform=axes.transAxes, ha="right")
    plotting.legend(axes)
    return plotting.svg(figure)


def errors_over_local_time(errors: Mapping[str, Sequence[ErrorSpan]], zone: str) -> str:
    """The paper's Fig. 13: mean absolute tilt error per interval of the day, bars of one SD.

    Spans are in nanoseconds since local midnight; `zone` names whose midnight.
    """
    from matplotlib.ticker import MultipleLocator

    figure, (axes,) = plotting.panels(1, 3.4)
    for index, (name, spans) in enumerate(errors.items()):
        aside_h = (index - (len(errors) - 1) / 2) / 60  # a minute apart: bars do not hide each other
        bars = axes.errorbar(
            [span.middle_ns / 3.6e12 + aside_h for span in spans],
            [span.mean for span in spans],
            yerr=[span.sd for span in spans],
            markersize=5,
            capsize=3,
            **plotting.line(index, name) | plotting.marks(index, name),
        )
        plotting.mark_part(index, bars.get_children())
    axes.set_ylabel("absolute tilt error, °")
    axes.set_ylim(bottom=0)
    first, last = axes.get_xlim()
    step_h = 0.25 if last - first < 1.5 else 1.0 if last - first < 6 else 2.0
    axes.xaxis.set_major_locator(MultipleLocator(step_h))
    plotting.clock_ticks(axes)
    axes.set_xlabel(f"local time ({zone})")
    plotting.legend(axes)
    return plotting.svg(figure)


def _figure() -> tuple[Figure, Axes]:
    figure, (axes,) = plotting.panels(1, 3.4)
    axes.grid(visible=False)
    return figure, axes


def _mesh(
    table: FloatArray, tilts: FloatArray, azimuths: FloatArray, colours: str, label: str
) -> tuple[Figure, Axes]:
    """A figure of a value by tilt and azimuth."""
    figure, axes = _figure()
    mesh = axes.pcolormesh(azimuths, tilts, table, cmap=colours, rasterized=True)
    with plotting.figure_style():
        figure.colorbar(mesh, label=label)
    _slope_axes(axes)
    return figure, axes


def _slope_axes(axes: Axes) -> None:
    axes.set(xlim=(0, 360), xlabel="direction, degrees from north", ylabel="tilt, degrees")
    axes.set_xticks(range(0, 361, 60))
