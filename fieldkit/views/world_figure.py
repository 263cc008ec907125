"""Accuracy of slopes on another world, by hour, noise and length of the window, as SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fieldkit.physics.facet import FloatArray
from fieldkit.views import plotting


def errors_over_window(
    points: Sequence[tuple[float, float, int, float]], title: str, guess_deg: float
) -> str:
    """Error of the normal, 90th percentile, over the window: a panel for each start, a line for each noise.

    `points` are (local hour, noise in K, minutes, error in degrees); the dotted line is the
    error of guessing.
    """
    hours = sorted({hour for hour, *_ in points})
    figure, panels = plotting.panels(len(hours), 2.0 * len(hours))
    for axes, hour in zip(panels, hours, strict=True):
        for index, noise_k in enumerate(sorted({noise for _, noise, *_ in points})):
            line = [
                (minutes, error) for at, noise, minutes, error in points if (at, noise) == (hour, noise_k)
            ]
            axes.plot(
                [minutes / 60.0 for minutes, _ in line], [error for _, error in line],
                color=plotting.colour(index), marker=plotting.marker(index), label=f"{noise_k:g} K",
            )  # fmt: skip
        axes.axhline(guess_deg, color="0.4", linestyle=":", linewidth=0.8, label="all called flat")
        axes.set(xscale="log", yscale="log", ylabel=f"p90, °\nfrom {hour:g} h")
        plotting.plain_log_ticks(axes.xaxis)
    panels[-1].set_xlabel("window, hours")
    plotting.legend(panels[0])
    figure.suptitle(title)
    return plotting.svg(figure)


def temperatures_over_day(
    hour: FloatArray, flat_k: FloatArray, warmer_k: Mapping[str, FloatArray], title: str
) -> str:
    """Temperature of flat ground over the hours (n,) of a day, and by how much slopes are warmer, kelvin."""
    figure, (above, below) = plotting.panels(2, 4.6)
    above.plot(hour, flat_k, color="0.2")
    above.set_ylabel("flat ground, K")
    for index, (name, warmer) in enumerate(warmer_k.items()):
        below.plot(hour, warmer, color=plotting.colour(index), linestyle=plotting.dashes(index), label=name)
    below.set(xlabel="local true solar time, h", ylabel="slope − flat, K")
    plotting.legend(below)
    figure.suptitle(title)
    return plotting.svg(figure)
