"""The picture of the home page: a thermal frame with its regions, and their tilts through the afternoon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from demo_day import DemoDay

import fieldkit
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.views import formatting, plotting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGES = ("home.svg",)
FRAME = 539
"""The frame shown: the last of three hours."""


def main(day: DemoDay) -> None:
    """Draw it from the session and the slopes stored with it."""
    with fieldkit.open_session(day.session) as session:
        figure = home(session)
    (day.images / IMAGES[0]).write_text(plotting.svg(figure), encoding="utf-8")


def home(session: fieldkit.Session) -> Figure:
    """Frame on the left, tilts with their 90 % regions on the right."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(plotting.STYLE):
        figure = Figure(figsize=(7.6, 3.2), layout="constrained")
        figure.get_layout_engine().set(wspace=0.08)
        frame, tilts = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    at_ns = int(session.times_ns("camera")[FRAME])
    draw_frame(frame, session, at_ns)
    draw_tilts(tilts, session, at_ns)
    return figure


def draw_frame(axes: Axes, session: fieldkit.Session, at_ns: int) -> None:
    """The thermal frame, its regions, and what each was found to be."""
    from matplotlib.patches import Polygon

    celsius = session["camera"].kelvin(FRAME, FRAME + 1)[0] - CELSIUS_ZERO_K
    image = axes.imshow(celsius, cmap="inferno", interpolation="none", vmin=np.percentile(celsius, 1.0))
    for region in session.regions:
        axes.add_patch(Polygon(region.points_px, fill=False, edgecolor="#00D7D7", linewidth=1.6))
        x, y = np.mean(region.points_px, axis=0)
        slope = [f"{formatting.tilt(estimate)}°" for estimate in estimates(session, region.name, at_ns)[-1:]]
        style = {"facecolor": "black", "alpha": 0.6, "edgecolor": "none", "boxstyle": "round,pad=0.25"}
        axes.text(
            x,
            y,
            "\n".join([region.name, *slope]),
            color="white",
            ha="center",
            va="center",
            fontsize=9,
            bbox=style,
        )
    axes.set_axis_off()
    axes.set_title(f"the beds at {formatting.clock_time(at_ns, session.site)}", fontsize=10)
    axes.figure.colorbar(image, ax=axes, label="brightness temperature, °C", shrink=0.85)


def draw_tilts(axes: Axes, session: fieldkit.Session, at_ns: int) -> None:
    """Tilt of each bed over local time, its 90 % region, and the slope it was set up with."""
    beds = [region for region in session.regions if region.kind is not session.regions[0].kind]
    for index, bed in enumerate(beds):
        found = estimates(session, bed.name)
        hours = [formatting.of_day_ns(one.time_ns, session.site) / 3.6e12 for one in found]
        low, high = [one.tilt_low_deg for one in found], [one.tilt_high_deg for one in found]
        axes.fill_between(hours, low, high, color=plotting.colour(index), alpha=0.2, linewidth=0)
        axes.plot(hours, [one.tilt_deg for one in found], color=plotting.colour(index), linewidth=1.8)
        axes.axhline(bed.tilt_deg, color="black", linestyle=(0, (5, 3)), linewidth=1.0)
        axes.text(hours[-1], bed.tilt_deg + 0.4, bed.name, ha="right", color=plotting.colour(index))
    axes.axvline(formatting.of_day_ns(at_ns, session.site) / 3.6e12, color="0.5", linewidth=1.0)
    axes.set(ylim=(0.0, 40.0), ylabel="tilt, °", xlabel=f"local time ({session.site.timezone})")
    axes.set_title("tilt and its 90 % region; dashed: as set up", fontsize=10)
    axes.set_xticks(range(12, 16), [f"{hour}:00" for hour in range(12, 16)])


def estimates(session: fieldkit.Session, region: str, until_ns: int | None = None) -> Sequence[SlopeEstimate]:
    """The slopes of one region as they were estimated while recording, where there is one."""
    return [
        estimate
        for estimate in session.estimates()
        if estimate.region == region
        and np.isfinite(estimate.tilt_deg)
        and (until_ns is None or estimate.time_ns <= until_ns)
    ]
