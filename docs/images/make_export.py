"""A session in other programs and back: its CSV export drawn by pandas, and a folder of frames imported."""

from __future__ import annotations

import pandas as pd
from demo_day import DemoDay, command_svg
from matplotlib.figure import Figure

from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.views.plotting import legend, line, panels, svg

IMAGES = ("export.svg", "terminal-import.svg")


def main(day: DemoDay) -> None:
    """Export, draw, export frames, import them."""
    out = day.folder / "csv"
    day.run("export", str(day.session), "--to", "csv", "-o", str(out))
    regions = pd.read_csv(next(out.glob("*-camera-regions.csv")))
    (day.images / "export.svg").write_text(svg(temperatures(regions)), encoding="utf-8")
    short = next((day.sandslope / "recordings").glob("*clear.h5"))
    day.run("export", str(short), "--to", "tiff", "-o", "frames", within=day.sandslope)
    printed = day.run("import", "frames", "--title", "again", within=day.sandslope)
    shown = command_svg("fieldkit import frames --title again", printed.replace(f"{day.sandslope}/", ""))
    (day.images / "terminal-import.svg").write_text(shown, encoding="utf-8")


def temperatures(table: pd.DataFrame) -> Figure:
    """Temperature of each region over time, from the columns of the CSV file."""
    figure, (axes,) = panels(1, 3.0)
    for number, (region, rows) in enumerate(table.groupby("region", sort=False)):
        hours = (
            pd.to_datetime(rows["time"]) - pd.to_datetime(table["time"].iloc[0])
        ).dt.total_seconds() / 3600
        celsius = rows["temperature [K]"] - CELSIUS_ZERO_K
        axes.plot(hours, celsius, **line(number, str(region)))
    axes.set(xlabel="hours of the session", ylabel="temperature, °C")
    legend(axes)
    return figure
