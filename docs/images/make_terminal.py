"""What commands print, as a terminal shows it: plan, regions, check, estimate, sweep."""

from __future__ import annotations

import shlex
from pathlib import Path

from demo_day import DemoDay, command_svg

SITE = "--site 35.558675,139.395232,9 --zone Asia/Tokyo"
OF_THE_DEMO = {
    "plan": f"plan {SITE} --on 2026-12-11 --facet 5,180 --facet 15,180 --facet 25,180 --step 1h",
    "regions": "roi check --session recordings/*.h5",
    "estimate": "estimate recordings/*.h5",
}
OF_THE_CAMPAIGN = {
    "check": "check recordings/*cable.h5",
    "sweep": "sweep recordings/*clear.h5 -o results/sweep --set estimator.model=full "
    "--set surface.albedo=0.15:0.25:0.05",
}
"""Commands by the name of their image, as typed in the campaign's folder."""
IMAGES = tuple(f"terminal-{name}.svg" for name in (*OF_THE_DEMO, *OF_THE_CAMPAIGN))


def main(day: DemoDay) -> None:
    """Run each in its campaign."""
    for campaign, commands in ((day.demo, OF_THE_DEMO), (day.sandslope, OF_THE_CAMPAIGN)):
        for name, command in commands.items():
            printed = day.run(*words_of(command, campaign), within=campaign).replace(f"{campaign}/", "")
            svg = command_svg(f"fieldkit {command}", printed)
            (day.images / f"terminal-{name}.svg").write_text(svg, encoding="utf-8")


def words_of(command: str, folder: Path) -> list[str]:
    """The words of a command, names of files with ``*`` as a shell would replace them."""
    return [
        file
        for word in shlex.split(command)
        for file in (
            sorted(str(path.relative_to(folder)) for path in folder.glob(word)) if "*" in word else [word]
        )
    ]
