"""The figures of the paper, made anew by `fieldkit study`."""

from __future__ import annotations

import shutil

from demo_day import DemoDay

FIGURES = ("05", "06", "07", "08", "09-contours", "10-contours", "12", "13", "14")
IMAGES = tuple(f"paper-{figure}.svg" for figure in FIGURES)


def main(day: DemoDay) -> None:
    """Run the study and keep its figures."""
    out = day.folder / "study"
    day.run("study", "--out", str(out))
    for figure, image in zip(FIGURES, IMAGES, strict=True):
        shutil.copyfile(out / f"figure-{figure}.svg", day.images / image)
