"""The figure of an emissivity day: pairs of camera and probe with the fitted line, and the error budget."""

from __future__ import annotations

import shutil

from demo_day import DemoDay

IMAGES = ("emissivity.svg",)
TRUTH = ("simulation.emissivity=0.85", "simulation.speed=max", "record.burst_frames=3")


def main(day: DemoDay) -> None:
    """Run the day of the page on emissivity."""
    settings = [word for setting in TRUTH for word in ("--set", setting)]
    sample = ("--sample", "dry-silica-sand", "--for", "3h", "--reflected", "b05")
    day.run("calibrate", "emissivity", "-C", str(day.sandslope), *sample, *settings)
    figure = next((day.sandslope / "calibration").glob("*.svg"))
    shutil.copyfile(figure, day.images / IMAGES[0])
