"""The common style of all figures: colours, line styles, panels, and SVG output.

Matplotlib comes with the extra ``fieldkit-slope[lab]``; `available` reports whether it is installed. The
colours are those of Okabe and Ito, which can be distinguished without colour vision, and lines also differ by
their dashes or marks. A page shows figures about 1.7 times as large, so that their type is as large as its
text. Figures over time are wide; a phone scrolls them in their box.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Site
from fieldkit.model.units import HOUR_NS
from fieldkit.views import formatting

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

WIDTH_IN, WIDE_IN = 4.8, 9.6
FONT_PT = 9.5
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F6000", "#6A3D9A")
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)))
MARKERS = "osD^vPX*"
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # letters stay letters: small, searchable, in the reader's own font
    "svg.hashsalt": "fieldkit",  # the same session gives the same bytes
    "font.family": "sans-serif",
    "font.size": FONT_PT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
}

LEGEND: dict[str, Any] = {"frameon": False, "fontsize": FONT_PT, "handlelength": 1.8, "handletextpad": 0.5}


@dataclass(frozen=True, slots=True)
class OverTime:
    """A figure over time as SVG text, and where in its width each time lies, from 0 (left) to 1 (right)."""

    svg: str
    share_of_width: FloatArray


def available() -> bool:
    """True if matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def colour(index: int) -> str:
    """The colour of the line number `index`."""
    return COLOURS[index % len(COLOURS)]


def line(index: int, label: str) -> dict[str, Any]:
    """Style of the line number `index`, which has a label."""
    return {"color": colour(index), "linestyle": DASHES[index % len(DASHES)], "label": label}


def marks(index: int, label: str) -> dict[str, Any]:
    """Style of the marks number `index`, which have a label."""
    return {"color": colour(index), "marker": MARKERS[index % len(MARKERS)], "label": label}


def panels(count: int, height_in: float, width_in: float = WIDTH_IN) -> tuple[Figure, list[Axes]]:
    """An empty figure of some panels one above the other."""
    from matplotlib.figure import Figure

    with figure_style():
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


def figure_style() -> AbstractContextManager[None]:
    """The context in which texts get the common size: matplotlib sets it when they are made."""
    from matplotlib import rc_context

    return rc_context(STYLE)


def svg(figure: Figure) -> str:
    """A figure as SVG text."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer, unsaid = io.StringIO(), dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with figure_style():
        # `savefig` draws a figure twice, first to lay it out, which drawing does by itself
        FigureCanvasSVG(figure).print_svg(buffer, metadata=unsaid)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def over_time(figure: Figure, axes: Axes, time_ns: IntArray) -> OverTime:
    """A figure whose `axes` run over dates, with the places of these times."""
    figure.align_ylabels()
    svg_text = svg(figure)  # which lays out the axes
    points = np.column_stack([days(time_ns), np.zeros(time_ns.size)])
    return OverTime(svg_text, axes.transData.transform(points)[:, 0] / figure.bbox.width)


def local_axis(axes: Axes, site: Site | None, time_ns: IntArray) -> None:
    """Label a horizontal axis by the site's clocks, UTC without a site; with its dates if there are two."""
    from matplotlib.dates import AutoDateLocator, DateFormatter

    zone = UTC if site is None else formatting.zone(site)
    ends_ns = (int(time_ns.min()), int(time_ns.max())) if time_ns.size else ()
    dates = {datetime.fromtimestamp(end / 1e9, zone).date() for end in ends_ns}
    time_format = "%H:%M\n%Y-%m-%d" if len(dates) > 1 else "%H:%M"
    axes.xaxis.set_major_locator(AutoDateLocator(tz=zone, minticks=3, maxticks=7))  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_formatter(DateFormatter(time_format, tz=zone))  # type: ignore[no-untyped-call]
    if site is None:
        axes.set_xlabel("UTC")
    elif ends_ns:
        axes.set_xlabel(f"local time ({formatting.zone_name(ends_ns[0], site, ends_ns[1])})")


def mark_part(index: int, artists: Iterable[Artist]) -> None:
    """Mark what is drawn of part number `index` of a figure (`fieldkit.views.html.Figure.parts`)."""
    for number, artist in enumerate(artists):
        artist.set_gid(f"{number}-part-{index}")


def plain_log_ticks(axis: Axis) -> None:
    """Write the ticks of a logarithmic axis as 0.5, 1, 2, not as powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def clock_ticks(axes: Axes) -> None:
    """Write the ticks of a horizontal axis in hours since midnight as 09:30."""
    axes.xaxis.set_major_formatter(
        lambda hour, _position: "{:02d}:{:02d}".format(*divmod(round(hour * 60) % 1440, 60))
    )


def days(time_ns: IntArray) -> FloatArray:
    """Days since 1970, which is how matplotlib counts dates."""
    return time_ns / 86_400e9


def broken(time_ns: IntArray, *values: ArrayLike) -> list[FloatArray]:
    """Days (n,) and values of a line, NaN between those that lie an hour apart: it breaks there."""
    after = np.flatnonzero(np.diff(time_ns) > HOUR_NS) + 1
    return [np.insert(np.asarray(series, np.float64), after, np.nan) for series in (days(time_ns), *values)]


def legend(axes: Axes) -> None:
    """A legend above the axes, at their left for phones; none where nothing is drawn."""
    labels = axes.get_legend_handles_labels()[1]
    if labels:
        columns = _columns(labels, axes.bbox.width / axes.figure.dpi)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, columnspacing=1.0, **LEGEND)


def _columns(labels: Sequence[str], width_in: float) -> int:
    """As many columns as fit the width at the longest label."""
    return max(1, int(12 * width_in / (max(map(len, labels)) + 4)))
