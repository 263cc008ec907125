"""``fieldkit init``: create a campaign folder."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.types import SITE
from fieldkit.model.errors import RefusedError, StorageError
from fieldkit.model.site import Site, with_zone, zone_by_longitude

FOLDERS = ("calibration", "recordings", "results", "reports")
GITIGNORE = (
    "# Sessions are large; keep the configuration and the calibrations.\n/recordings/\n/results/\n/reports/\n"
)


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), default=".", metavar="[DIR]")
@click.option("--site", type=SITE, help="Where the beds stand [default: the paper's site, to be changed].")
@click.option("--timezone", metavar="NAME", help="Its time zone, such as Asia/Tokyo [default: by longitude].")
@click.option("--simulated", is_flag=True, help="A campaign that records on simulated devices.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of fieldkit.toml for editors, and stop.")
@click.pass_context
def command(
    ctx: click.Context, folder: Path, site: Site | None, timezone: str | None, simulated: bool, schema: bool
) -> None:
    """Create a campaign in DIR: a commented fieldkit.toml, folders, .gitignore."""
    if schema:
        _print_schema()
        return
    from fieldkit.config import FILE_NAME, ConfigMistakesError, mistakes_in
    from fieldkit.config.template import PAPER_SITE, SIMULATED, campaign_toml

    if simulated and (site or timezone):
        raise click.UsageError("--simulated brings its own site: omit --site and --timezone")
    folder = (options(ctx).directory or Path()) / folder
    given = SIMULATED if simulated else {"site": _site_table(site, timezone) or PAPER_SITE}
    text = campaign_toml(given)
    if mistakes := mistakes_in(text, folder / FILE_NAME):
        raise ConfigMistakesError(mistakes, fix="nothing was written; correct the options")
    make_campaign(folder, text)
    if options(ctx).json:
        print_json({"campaign": str(folder), "config": str(folder / FILE_NAME)})
    say(f"new campaign in {folder}; its configuration is {folder / FILE_NAME}")
    if not simulated:
        _tell_site(site, timezone)
    then = "fieldkit record --for 10m" if simulated else "fieldkit devices, then fieldkit roi add"
    say(f"next: {_going_into(folder)}{then}")


def _tell_site(site: Site | None, timezone: str | None) -> None:
    """What of the site nobody said."""
    if site is None:
        say("  the site is the paper's: put yours under [site] before anything else")
    elif not timezone:
        zone = zone_by_longitude(site.longitude_deg)
        say(f"  the time zone is {zone}, by longitude: if clocks there show another, change it under [site]")


def _going_into(folder: Path) -> str:
    """The command in front of those that work inside the campaign only."""
    return "" if folder.resolve() == Path.cwd() else f"cd {shlex.quote(str(folder))} && "


def _site_table(site: Site | None, timezone: str | None) -> Mapping[str, Any] | None:
    if site is None:
        if timezone:
            raise click.UsageError("--timezone needs --site")
        return None
    return {
        "latitude_deg": site.latitude_deg,
        "longitude_deg": site.longitude_deg,
        "elevation_m": site.elevation_m,
        "timezone": with_zone(site, timezone).timezone,
    }


def make_campaign(folder: Path, text: str) -> None:
    """Write a campaign's configuration and make its folders; raises `RefusedError`, `StorageError`."""
    from fieldkit.config import FILE_NAME

    file = folder / FILE_NAME
    if file.exists():
        raise RefusedError(
            f"{file} is there already", fix="choose another folder; init never overwrites a campaign"
        )
    try:
        for sub in FOLDERS:
            (folder / sub).mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        ignore = folder / ".gitignore"
        if not ignore.exists():
            ignore.write_text(GITIGNORE, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot make a campaign in {folder}: {error.strerror}") from error


def _print_schema() -> None:
    import json

    from fieldkit.config.toml_schema import json_schema

    click.echo(json.dumps(json_schema(), indent=2))
