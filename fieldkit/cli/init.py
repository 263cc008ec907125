"""``fieldkit init``: create a campaign folder."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, is_interactive, options, print_if_json, say
from fieldkit.cli.devices import add_connected
from fieldkit.cli.types import PATH, SITE
from fieldkit.model.site import Site, zone_by_longitude

METERS = ("lux", "dni", "ghi", "dhi", "longwave", "air", "wind")
PYRGEOMETER_SD_W_M2 = 10.0
"""As the description of `prior.longwave_sd_w_m2` states it."""
SUNLIT_AIR_SD_K = 2.0
"""Judged: because a thermometer without a shade reads one to three kelvins high in calm sun."""


@click.command(cls=Command)
@click.argument("folder", type=PATH, default=".", metavar="[DIR]")
@click.option("--site", type=SITE, help="Where it is measured [default: the paper's site, to be changed].")
@click.option(
    "--zone", "timezone", metavar="ZONE", help="Its time zone, such as Asia/Tokyo [default: by longitude]."
)
@click.option("--simulated", is_flag=True, help="A campaign that records on simulated devices.")
@click.option("-y", "--yes", is_flag=True, help="Ask nothing: take the defaults of what is not given.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of fieldkit.toml for editors, and stop.")
def command(
    folder: Path, site: Site | None, timezone: str | None, simulated: bool, yes: bool, schema: bool
) -> None:
    """Create a campaign in DIR: a short fieldkit.toml, folders, .gitignore.

    On a terminal it asks what decides how good slopes become: the place, whether the beds are of one heap,
    a known bed, the meters, and whether the air is logged in the shade.
    """
    if schema:
        _print_schema()
        return
    from fieldkit.recording.campaign import init_campaign

    folder = (options().directory or Path()) / folder
    asks = is_interactive() and not (yes or simulated)
    if asks and site is None:
        site = click.prompt("place as LAT,LON,ELEVATION", type=SITE, err=True)
    tables, steps = _ask() if asks else ({}, ["fieldkit roi add"])
    place = (site.latitude_deg, site.longitude_deg, site.elevation_m) if site else None
    campaign = init_campaign(folder, place, timezone=timezone, simulated=simulated, tables=tables)
    file = campaign.config.path
    print_if_json({"campaign": str(folder), "config": str(file)})
    say(f"new campaign in {folder}; its configuration is {file}")
    if not simulated:
        _report_site_defaults(site, timezone)
    steps = ["fieldkit record --for 10m"] if simulated else [_instruments_added(file, asks), *steps]
    say(f"next: {_going_into(folder)}{', then '.join(steps)}")


def _ask() -> tuple[dict[str, Any], list[str]]:
    """Tables of the configuration by four questions, and the commands that draw the regions."""
    tables: dict[str, Any] = {}
    steps = ["fieldkit roi add flat --reference"]
    if _confirm("are all beds of one heap of sand, laid at one time?"):
        tables["surface"] = {"same": True}
    if _confirm("is there a bed whose tilt was measured, beside the flat one?"):
        steps.append("fieldkit roi add b15 --reference --tilt 15 --azimuth 180")
    meters = click.prompt(f"meters, of {', '.join(METERS)}", default="lux,air", value_proc=_meters, err=True)
    if "longwave" in meters:
        tables["prior"] = {"longwave_sd_w_m2": PYRGEOMETER_SD_W_M2}
    if "air" in meters and not _confirm("is the air thermometer in the shade?"):
        tables.setdefault("prior", {})["air_sd_k"] = SUNLIT_AIR_SD_K
    return tables, steps


def _confirm(question: str) -> bool:
    return click.confirm(question, default=True, err=True)


def _meters(text: str) -> set[str]:
    meters = set(text.replace(",", " ").split())
    if unknown := meters.difference(METERS):
        raise click.BadParameter(f"{', '.join(sorted(unknown))}: choose of {', '.join(METERS)}")
    return meters


def _instruments_added(file: Path, asks: bool) -> str:
    """Offer on a terminal to add what is connected; the next command."""
    if not asks or not click.confirm("add what is connected now?", err=True):
        return "fieldkit devices --add"
    add_connected(file, {})
    return "fieldkit doctor"


def _report_site_defaults(site: Site | None, timezone: str | None) -> None:
    """Print which parts of the site are defaults."""
    if site is None:
        say("  the site is the paper's: put yours under [site] before anything else")
    elif not timezone:
        zone = zone_by_longitude(site.longitude_deg)
        say(f"  the time zone is {zone}, by longitude: if clocks there show another, change it under [site]")


def _going_into(folder: Path) -> str:
    """The command before those that work inside the campaign only."""
    return "" if folder.resolve() == Path.cwd() else f"cd {shlex.quote(str(folder))} && "


def _print_schema() -> None:
    import json

    from fieldkit.config.toml_schema import json_schema

    click.echo(json.dumps(json_schema(), indent=2))
