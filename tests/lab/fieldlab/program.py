"""fieldkit as the program under test."""

from __future__ import annotations

from pathlib import Path

from usblab.program import Program

from fieldkit.model.installation import DISTRIBUTION
from fieldkit.model.site import Site

LAB = Path(__file__).resolve().parents[1]
PROJECT = LAB.parents[1]
RULES = PROJECT / "udev/70-fieldkit.rules"


def fieldkit(site: Site) -> Program:
    """fieldkit as it stands now, prepared for recordings at a site."""
    place = (site.latitude_deg, site.longitude_deg, site.elevation_m)
    return Program(
        distribution=DISTRIBUTION,
        package=PROJECT / "fieldkit",
        entry="fieldkit.cli:main",
        helpers=LAB / "inside_guest",
        warm_up="inside_guest.warm:warm",
        warm_up_arguments={"place": place},
        files={f"/etc/udev/rules.d/{RULES.name}": RULES.read_bytes()} if RULES.exists() else {},
        links=("/dev/fieldkit",),
    )
