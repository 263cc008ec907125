"""Figures of a session over local time: temperatures, irradiance, slopes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.channels import is_air_temperature
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS
from fieldkit.views import plotting
from fieldkit.views.report.series import Series, TargetSeries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLOUD_COLOUR = "#B0B0B0"


def temperatures(columns: Series, channels: Sequence[str], site: Site) -> plotting.OverTime:
    """Surface temperature of each region, and the contact probes, over local time."""
    figure, (axes,) = plotting.panels(1, 3.0, plotting.WIDE_IN)
    for index, region in enumerate(columns.regions):
        celsius = columns.temperature_k[region.name] - CELSIUS_ZERO_K
        lines = axes.plot(*plotting.broken(columns.time_ns, celsius), **_line(index, region))
        plotting.mark_part(index, lines)
    for channel in np.flatnonzero(np.isfinite(columns.contact_k).any(axis=0)).tolist():
        if is_air_temperature(channels[channel]):
            continue
        axes.plot(
            plotting.days(columns.time_ns),
            columns.contact_k[:, channel] - CELSIUS_ZERO_K,
            linestyle="none",
            markersize=3,
            markerfacecolor="none",
            markevery=max(1, columns.time_ns.size // 24),
            **plotting.marks(channel, f"probe {channels[channel]}") | {"color": "#404040"},
        )
    axes.set_ylabel("surface temperature, °C")
    return over_time(figure, [axes], columns, site)


def irradiance(columns: Series, site: Site) -> plotting.OverTime:
    """Measured illuminance and the direct normal irradiance derived from it, each where there is any."""
    lines = [
        ("measured, klx", columns.illuminance_lx / 1000.0, plotting.colour(4)),
        ("derived DNI, W/m²", columns.irradiance_w_m2, plotting.colour(1)),
    ]
    finite_lines = [line for line in lines if np.isfinite(line[1]).any()]
    figure, panels = plotting.panels(len(finite_lines), 0.6 + 1.3 * len(finite_lines), plotting.WIDE_IN)
    for axes, (name, values, colour) in zip(panels, finite_lines, strict=True):
        axes.plot(*plotting.broken(columns.time_ns, values), color=colour)
        axes.set_ylabel(name)
    return over_time(figure, panels, columns, site, legend=False)


def tilts(columns: Series, site: Site) -> plotting.OverTime:
    """Tilt of each target with its likelihood region, the given tilt dashed; a panel per target."""
    figure, panels = _target_panels(columns)
    for index, (axes, target) in enumerate(zip(panels, columns.targets, strict=True)):
        bounds = target.tilt_deg, target.values("tilt_low_deg"), target.values("tilt_high_deg")
        _angle(axes, columns, target, bounds, target.region.tilt_deg, plotting.colour(index))
        axes.set_ylabel(f"{target.region.name} tilt, °")
    return over_time(figure, panels, columns, site, legend=False)


def azimuths(columns: Series, site: Site) -> plotting.OverTime:
    """Azimuth of each target with its likelihood region, unwound about the given or median azimuth."""
    figure, panels = _target_panels(columns)
    for index, (axes, target) in enumerate(zip(panels, columns.targets, strict=True)):
        azimuth, low, high = map(target.values, ("azimuth_deg", "azimuth_low_deg", "azimuth_high_deg"))
        centre = _centre_of(target, azimuth)
        middle = centre + _wrap(azimuth - centre)
        low, high = middle - (azimuth - low) % 360.0, middle + (high - azimuth) % 360.0
        bounds = middle, low, high
        _angle(axes, columns, target, bounds, target.region.azimuth_deg, plotting.colour(index))
        axes.yaxis.set_major_formatter(lambda value, _position: f"{value % 360:.0f}")
        axes.set_ylabel(f"{target.region.name} azim., °")
    return over_time(figure, panels, columns, site, legend=False)


def _target_panels(columns: Series) -> tuple[Figure, list[Axes]]:
    count = len(columns.targets)
    return plotting.panels(count, 0.6 + 1.2 * count, plotting.WIDE_IN)


Interval = tuple[FloatArray, FloatArray, FloatArray]
"""An angle by minute, and the low and high ends of its likelihood region, degrees."""


def _angle(
    axes: Axes, columns: Series, target: TargetSeries, angle: Interval, true_deg: float, colour: str
) -> None:
    """An angle by minute with its likelihood region, its unreliable minutes, the true one."""
    days, middle, low, high = plotting.broken(columns.time_ns, *angle)
    axes.fill_between(days, low, high, color=colour, alpha=0.22, linewidth=0)
    axes.plot(days, middle, color=colour, linewidth=1.6)
    _unreliable(axes, columns, target, angle[0])
    if np.isfinite(true_deg):
        axes.axhline(true_deg, color="black", linestyle=(0, (5, 3)), linewidth=1.2)


class FinalTilt(NamedTuple):
    """The final estimate of a target in a session, and the given tilt, degrees."""

    session: str
    estimate: SlopeEstimate
    given_deg: float


def final_tilts(tilts: Sequence[FinalTilt]) -> str:
    """Final tilts of several sessions one below the other, which a phone shows whole, as SVG text."""
    sessions = list(dict.fromkeys(tilt.session for tilt in tilts))
    figure, (axes,) = plotting.panels(1, 1.2 + 0.35 * len(sessions))
    targets = list(dict.fromkeys(tilt.estimate.region for tilt in tilts))
    for index, target in enumerate(targets):
        of_target = [tilt for tilt in tilts if tilt.estimate.region == target]
        aside = 0.6 * ((index + 0.5) / len(targets) - 0.5)  # bars below each other
        at = np.array([sessions.index(tilt.session) for tilt in of_target]) + aside
        ends = [
            (estimate.tilt_deg, estimate.tilt_low_deg, estimate.tilt_high_deg) for _, estimate, _ in of_target
        ]
        (middle, low, high), truth = np.transpose(ends), [tilt.given_deg for tilt in of_target]
        style = plotting.marks(index, target) | {"linestyle": "none"}
        bars = axes.errorbar(middle, at, xerr=[middle - low, high - middle], capsize=3, **style)
        truths = axes.vlines(truth, at - 0.1, at + 0.1, color="black", linewidth=1.8, zorder=3)
        plotting.mark_part(index, [*bars.get_children(), truths])
    axes.set_yticks(range(len(sessions)), sessions)
    axes.set_ylim(len(sessions) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("tilt, °")
    plotting.legend(axes)
    return plotting.svg(figure)


def _line(index: int, region: Region) -> dict[str, Any]:
    if region.kind is RegionKind.REFERENCE:
        return {"color": "black", "linewidth": 1.8, "label": region.name}
    return plotting.line(index, region.name) | {"color": plotting.colour(index - 1)}


def _unreliable(axes: Axes, columns: Series, target: TargetSeries, values: FloatArray) -> None:
    """Mark unreliable minutes: crosses where there is a value, ticks at the foot where there is none."""
    unreliable = np.array([e is not None and e.state not in SOLVED for e in target.estimates], np.bool_)
    days, finite = plotting.days(columns.time_ns), np.isfinite(values)
    crosses, ticks = days[unreliable & finite], days[unreliable & ~finite]
    axes.plot(crosses, values[unreliable & finite], "x", markersize=5, color="black")
    if ticks.size:  # an empty line that may not be clipped confuses matplotlib's layout
        foot: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(ticks, np.zeros(ticks.size), "|", markersize=7, color="black", **foot)


def over_time(
    figure: Figure, panels: Sequence[Axes], columns: Series, site: Site, *, legend: bool = True
) -> plotting.OverTime:
    """Panels over local time, cloudy minutes shaded."""
    for axes in panels:
        _shade_clouds(axes, columns)
        axes.margins(x=0.01)
        if legend:
            plotting.legend(axes)
    plotting.local_axis(panels[-1], site, columns.time_ns)
    return plotting.over_time(figure, panels[-1], columns.time_ns)


def _shade_clouds(axes: Axes, columns: Series) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], columns.cloudy, [False]]).astype(np.int8)))
    for first, after in edges.reshape(-1, 2):
        start, end = plotting.days(columns.time_ns[[first, after - 1]] + np.array([0, MINUTE_NS]))
        axes.axvspan(start, end, color=CLOUD_COLOUR, alpha=0.45, linewidth=0)


def _centre_of(target: TargetSeries, azimuth_deg: FloatArray) -> float:
    if np.isfinite(target.region.azimuth_deg):
        return float(target.region.azimuth_deg)
    return float(np.degrees(np.angle(np.nansum(np.exp(1j * np.radians(azimuth_deg))))))


def _wrap(difference_deg: FloatArray) -> FloatArray:
    """Differences of azimuths in [-180, 180)."""
    return (difference_deg + 180.0) % 360.0 - 180.0
