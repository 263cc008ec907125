"""The figures of the shade test and of the hour after sunset, from simulated beds.

The beds of the demo lie on the packaged day's weather, a board over one of them for five minutes.
"""

from __future__ import annotations

import numpy as np
from demo_day import DemoDay
from matplotlib.figure import Figure

from fieldkit.model.arrays import FloatArray
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.boards import Board
from fieldkit.simulation.facets import GROUND
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel, SceneSeries
from fieldkit.simulation.sky import MeasuredSky
from fieldkit.views.plotting import legend, line, panels, svg
from fieldkit.weather import packaged_day

IMAGES = ("shade-test.svg", "after-sunset.svg")
NOON_S, LENGTH_S = 3 * 3600.0, 10 * 3600.0
BOARD_S = (3600.0, 3900.0)
"""A board over b15 from 13:00 to 13:05, in seconds after noon."""


def afternoon() -> SceneSeries:
    """The beds from 9:00 to 19:00."""
    day = packaged_day()
    board = Board("b15", NOON_S + BOARD_S[0], NOON_S + BOARD_S[1])
    model = SceneModel(day.site, MeasuredSky(day), BEDS, GROUND, EXCHANGE, (), 3.0, boards=(board,))
    return model.series(ALAMOSA_NOON_NS - round(NOON_S * SECOND_NS), LENGTH_S)


def temperatures(scene: SceneSeries, hours: FloatArray) -> Figure:
    """Surface temperatures of the beds over hours after noon."""
    figure, (axes,) = panels(1, 3.2)
    surface = scene.rows[6 : 6 + len(BEDS)]
    for number, (bed, kelvin) in enumerate(zip(BEDS, surface, strict=True)):
        celsius = np.interp(3600.0 * hours + NOON_S, scene.time_s, kelvin) - CELSIUS_ZERO_K
        axes.plot(12.0 + hours, celsius, **line(number, bed.name))
    ticks = np.linspace(hours[0], hours[-1], 5)
    axes.set_xticks(12.0 + ticks, [f"{12 + int(at)}:{round(at % 1 * 60):02d}" for at in ticks])
    axes.set_ylabel("surface temperature, °C")
    axes.margins(y=0.12)
    legend(axes)
    return figure


def shade_test(scene: SceneSeries) -> Figure:
    """Forty minutes about the board."""
    figure = temperatures(scene, np.arange(2700.0, 5101.0, 10.0) / 3600.0)
    figure.axes[0].axvspan(*(12.0 + at / 3600.0 for at in BOARD_S), color="#E4E4E4", zorder=0)
    middle = 12.0 + sum(BOARD_S) / 7200.0
    figure.axes[0].annotate(
        "board over b15", (middle, 1.0), xycoords=("data", "axes fraction"), ha="center", va="top"
    )
    return figure


def after_sunset(scene: SceneSeries) -> Figure:
    """An hour before sunset and the hour after it."""
    sunset_h = sunset_s(scene) / 3600.0
    figure = temperatures(scene, np.arange(sunset_h - 1.0, sunset_h + 1.001, 0.01))
    figure.axes[0].axvline(12.0 + sunset_h, color="black", lw=1.0, ls=":")
    figure.axes[0].annotate(
        " sunset", (12.0 + sunset_h, 1.0), xycoords=("data", "axes fraction"), ha="left", va="top"
    )
    return figure


def sunset_s(scene: SceneSeries) -> float:
    """Seconds from noon until the sun sets."""
    time_ns = scene.origin_ns + np.round(scene.time_s * SECOND_NS).astype(np.int64)
    height: FloatArray = sun_vectors(time_ns, packaged_day().site, refraction=True)[:, 2]
    return float(scene.time_s[np.flatnonzero(height > 0.0)[-1]]) - NOON_S


def main(day: DemoDay) -> None:
    """Draw both from one scene."""
    scene = afternoon()
    for image, figure in zip(IMAGES, (shade_test(scene), after_sunset(scene)), strict=True):
        (day.images / image).write_text(svg(figure), encoding="utf-8")
