"""Plots for a notebook: each draws on a matplotlib axis, the one given or a new one, and returns it.

The report's figures (`fieldkit.views.report.session_figures`) are sized for a page; these keep to what the
notebook has set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Site
from fieldkit.views import plotting

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class TiltSeries:
    """Tilt of a region over time with its likelihood region, degrees, NaN if unknown; `true_deg` if given."""

    tilt_deg: FloatArray
    low_deg: FloatArray
    high_deg: FloatArray
    true_deg: float


def new_axes(ax: Axes | None) -> Axes:
    """The axis given, or one of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def tilts(
    time_ns: IntArray, regions: Mapping[str, TiltSeries], site: Site | None, ax: Axes | None = None
) -> Axes:
    """Tilt of each region over time, its likelihood region shaded, the true tilt dashed."""
    axes = new_axes(ax)
    for index, (name, region) in enumerate(regions.items()):
        colour = plotting.colour(index)
        days, tilt, low, high = plotting.broken(time_ns, region.tilt_deg, region.low_deg, region.high_deg)
        axes.fill_between(days, low, high, color=colour, alpha=0.2, linewidth=0)
        axes.plot(days, tilt, color=colour, label=name)
        if np.isfinite(region.true_deg):
            axes.axhline(region.true_deg, color=colour, linestyle="--", linewidth=1.0)
    axes.set_ylabel("tilt, °")
    return over_time(axes, time_ns, site)


def lines(
    time_ns: IntArray,
    values: Mapping[str, ArrayLike],
    label: str,
    site: Site | None,
    ax: Axes | None = None,
) -> Axes:
    """Some time series of one quantity."""
    axes = new_axes(ax)
    for index, (name, series) in enumerate(values.items()):
        axes.plot(*plotting.broken(time_ns, series), **plotting.line(index, name))
    axes.set_ylabel(label)
    return over_time(axes, time_ns, site)


def over_time(axes: Axes, time_ns: IntArray, site: Site | None) -> Axes:
    """Label the time axis by the site's clocks, UTC without a site; add a legend of the labelled lines."""
    plotting.local_axis(axes, site, time_ns)
    if axes.get_legend_handles_labels()[1]:
        axes.legend()
    return axes


def tilt_map(
    tilt_deg: ArrayLike, outlines: Mapping[str, Sequence[tuple[float, float]]], ax: Axes | None = None
) -> Axes:
    """Tilt of every pixel, in camera pixels, with the regions' outlines and names."""
    axes = new_axes(ax)
    image = axes.imshow(np.asarray(tilt_deg), cmap="viridis", vmin=0.0)
    axes.figure.colorbar(image, ax=axes, label="tilt, °")
    for name, outline in outlines.items():
        x, y = np.transpose([*outline, outline[0]])
        axes.plot(x, y, color="white", linewidth=1.2)
        axes.annotate(
            name, (float(x.min()), float(y.min())), color="white", xytext=(2, 2), textcoords="offset points"
        )
    axes.set_xlabel("x, pixels")
    axes.set_ylabel("y, pixels")
    return axes
