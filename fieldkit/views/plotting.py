"""The common style of all figures: colours, line styles, panels, and SVG output.

Matplotlib comes with the extra ``fieldkit[lab]``; `available` reports whether it is installed. The
colours are those of Okabe and Ito, which can be distinguished without colour vision, and lines also differ by
their dashes or marks. A page shows figures about 1.7 times as large, so that their type is as large as its
text. Figures over time are wide; a phone scrolls them in their box.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.views.report.series import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN, WIDE_IN = 4.8, 9.6
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F6000", "#6A3D9A")
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)))
MARKERS = "osD^vPX*"
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # letters stay letters: small, searchable, in the reader's own font
    "svg.hashsalt": "fieldkit",  # the same session gives the same bytes
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
}

LEGEND: dict[str, Any] = {"frameon": False, "fontsize": 9, "handlelength": 1.8, "handletextpad": 0.5}


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def colour(index: int) -> str:
    """The colour of the line number `index`."""
    return COLOURS[index % len(COLOURS)]


def dashes(index: int) -> Any:
    """The line style of the line number `index`."""
    return DASHES[index % len(DASHES)]


def marker(index: int) -> str:
    """The mark of the points number `index`."""
    return MARKERS[index % len(MARKERS)]


def panels(count: int, height_in: float, width_in: float = WIDTH_IN) -> tuple[Figure, list[Axes]]:
    """An empty figure of some panels one above the other."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


def svg(figure: Figure) -> str:
    """A figure as SVG text."""
    from matplotlib import rc_context

    buffer = io.StringIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def plain_log_ticks(axes: Axes) -> None:
    """Write the ticks of a logarithmic vertical axis as 0.5, 1, 2, not as powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def days(time_ns: NDArray[np.int64]) -> FloatArray:
    """Days since 1970, which is how matplotlib counts dates."""
    return time_ns / 86_400e9


def legend(axes: Axes) -> None:
    """A legend above the axes, where it hides nothing; none where nothing is drawn."""
    labels = axes.get_legend_handles_labels()[1]
    if labels:
        columns = _columns(labels)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, columnspacing=1.0, **LEGEND)


def _columns(labels: Sequence[str]) -> int:
    """As many columns as fit the width at the longest label."""
    return max(1, min(4, 44 // (max(map(len, labels)) + 4)))
