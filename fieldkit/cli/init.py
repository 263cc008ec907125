"""``fieldkit init``: create a campaign folder."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from fieldkit.cli.common import Command, is_interactive, options, print_json, say
from fieldkit.cli.devices import add_connected
from fieldkit.cli.types import PATH, SITE
from fieldkit.model.site import Site, zone_by_longitude


@click.command(cls=Command)
@click.argument("folder", type=PATH, default=".", metavar="[DIR]")
@click.option("--site", type=SITE, help="Where it is measured [default: the paper's site, to be changed].")
@click.option(
    "--zone", "timezone", metavar="ZONE", help="Its time zone, such as Asia/Tokyo [default: by longitude]."
)
@click.option("--simulated", is_flag=True, help="A campaign that records on simulated devices.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of fieldkit.toml for editors, and stop.")
def command(folder: Path, site: Site | None, timezone: str | None, simulated: bool, schema: bool) -> None:
    """Create a campaign in DIR: a commented fieldkit.toml, folders, .gitignore."""
    if schema:
        _print_schema()
        return
    from fieldkit.recording.campaign import init_campaign

    if simulated and (site or timezone):
        raise click.UsageError("--simulated brings its own site: omit --site and --zone")
    if timezone and site is None:
        raise click.UsageError("--zone needs --site")
    folder = (options().directory or Path()) / folder
    place = (site.latitude_deg, site.longitude_deg, site.elevation_m) if site else None
    file = init_campaign(folder, place, timezone=timezone, simulated=simulated).config.path
    if options().json:
        print_json({"campaign": str(folder), "config": str(file)})
    say(f"new campaign in {folder}; its configuration is {file}")
    if not simulated:
        _report_site_defaults(site, timezone)
    then = "fieldkit record --for 10m" if simulated else f"{_instruments_added(file)}, then fieldkit roi add"
    say(f"next: {_going_into(folder)}{then}")


def _instruments_added(file: Path) -> str:
    """Offer on a terminal to add what is connected; the next command."""
    if not is_interactive() or not click.confirm("add what is connected now?", err=True):
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
