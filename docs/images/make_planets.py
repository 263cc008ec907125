"""The figures of the page on Mars and the Moon, from `fieldkit study --body`: half a minute."""

from __future__ import annotations

from demo_day import DemoDay

from fieldkit.study.other_worlds import SITES, world_study

DAY = "2024-06-01"
IMAGES = tuple(f"{body}-{kind}.svg" for body in SITES for kind in ("windows", "day"))


def main(day: DemoDay) -> None:
    """Write two figures for each world."""
    for body, site in SITES.items():
        study = world_study(site, DAY)
        (day.images / f"{body}-windows.svg").write_text(study.figure(), encoding="utf-8")
        (day.images / f"{body}-day.svg").write_text(study.day_figure(), encoding="utf-8")
