"""Figures 5 to 10 and 14 of the paper, drawn anew as SVG text with matplotlib.

Inputs are arrays of `fieldkit.estimation.study`; nothing is computed here but axes. The
horizontal axis of the tables is the slope's direction from north, clockwise, the vertical
one its tilt, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.physics.facet import FloatArray
from fieldkit.views.report import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def radiation_table(table: FloatArray, tilts: FloatArray, azimuths: FloatArray) -> str:
    """Fig. 5: light on a slope less that on flat ground, W/m2, (tilts, azimuths)."""
    figure, axes = _figure()
    _table(figure, axes, table, tilts, azimuths)
    return canvas.svg(figure)


def contour_on_table(table: FloatArray, tilts: FloatArray, azimuths: FloatArray, measured: float) -> str:
    """Fig. 6: the same with all slopes that explain one measured difference."""
    figure, axes = _figure()
    _table(figure, axes, table, tilts, azimuths)
    axes.contour(azimuths, tilts, table, levels=[measured], colors="black", linewidths=2)
    axes.set_title(f"contour of {measured:.1f} W/m²", fontsize=11)
    return canvas.svg(figure)


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
            axes.contour(azimuths, tilts, table, levels=[value], colors=canvas.colour(index), linewidths=1.8)
        axes.plot([], [], color=canvas.colour(index), label=name)
    if truth is not None:
        axes.plot(
            [truth[1]], [truth[0]], marker="+", markersize=14, color="black", linestyle="none", label="truth"
        )
    axes.legend(frameon=False)
    _slope_axes(axes)
    return canvas.svg(figure)


def scores(votes: FloatArray, tilts: FloatArray, azimuths: FloatArray) -> str:
    """Fig. 8: votes per slope."""
    figure, axes = _figure()
    picture = axes.pcolormesh(azimuths, tilts, votes, cmap="viridis", rasterized=True)
    figure.colorbar(picture, label="score")
    _slope_axes(axes)
    return canvas.svg(figure)


def cumulative(errors: Mapping[str, FloatArray]) -> str:
    """Fig. 9: share of slopes estimated within an absolute tilt error, one curve per start."""
    figure, axes = _figure()
    for index, (name, values) in enumerate(errors.items()):
        known = np.sort(values[np.isfinite(values)])
        share = np.arange(1, known.size + 1) / values.size
        axes.plot(known, share, color=canvas.colour(index), label=name)
    widest = max((float(np.nanpercentile(values, 97)) for values in errors.values()), default=1.0)
    axes.set(xlim=(0.0, max(widest, 0.1)), ylim=(0.0, 1.0))
    axes.axhline(0.9, color="0.6", linestyle=":")
    axes.set_xlabel("absolute tilt error, degrees")
    axes.set_ylabel("cumulative probability")
    axes.legend(frameon=False, loc="lower right")
    return canvas.svg(figure)


def directions(errors: Mapping[str, tuple[FloatArray, FloatArray]]) -> str:
    """Fig. 10: mean absolute tilt error by direction of the slope, north up, clockwise."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(canvas.STYLE):
        figure = Figure(figsize=(5.4, 4.8), layout="constrained")
        axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    for index, (name, (centres, values)) in enumerate(errors.items()):
        around = np.radians(np.append(centres, centres[0]))
        axes.plot(
            around,
            np.append(values, values[0]),
            color=canvas.colour(index),
            label=name,
        )
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.95, 1.1))
    return canvas.svg(figure)


def _figure() -> tuple[Figure, Axes]:
    figure, (axes,) = canvas.panels(1, 3.4)
    axes.grid(visible=False)
    return figure, axes


def _table(figure: Figure, axes: Axes, table: FloatArray, tilts: FloatArray, azimuths: FloatArray) -> None:
    picture = axes.pcolormesh(azimuths, tilts, table, cmap="coolwarm", rasterized=True)
    figure.colorbar(picture, label="difference to flat ground, W/m²")
    _slope_axes(axes)


def _slope_axes(axes: Axes) -> None:
    axes.set(xlim=(0, 360), xlabel="direction, degrees from north", ylabel="tilt, degrees")
    axes.set_xticks(range(0, 361, 60))
