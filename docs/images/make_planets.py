"""Draw the figures of the page on Mars and the Moon, from `fieldkit study --body`.

    python docs/images/make_planets.py

They are written beside this file: half a minute.
"""

from __future__ import annotations

from pathlib import Path

from fieldkit.study.other_worlds import SITES, world_study

DAY = "2024-06-01"


def main() -> None:
    """Write two figures for each world."""
    folder = Path(__file__).parent
    for body, site in SITES.items():
        study = world_study(site, DAY)
        (folder / f"{body}-windows.svg").write_text(study.figure(), encoding="utf-8")
        (folder / f"{body}-day.svg").write_text(study.day_figure(), encoding="utf-8")


if __name__ == "__main__":
    main()
