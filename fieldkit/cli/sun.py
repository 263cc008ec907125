"""``fieldkit sun``: where the sun stands, and at what angle it falls on facets (the paper's Table 2)."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Any

import click

from fieldkit.cli.common import Command, campaign, print_if_json, print_table
from fieldkit.cli.types import FACET, MOMENT, SITE
from fieldkit.model.site import Site

Facet = tuple[float, float]


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Where [default: the campaign's site].")
@click.option("--at", "moments", type=MOMENT, multiple=True, required=True, help="When; may be repeated.")
@click.option("--facet", "facets", type=FACET, multiple=True, help="Surface to aim at; may be repeated.")
def command(site: Site | None, moments: tuple[datetime, ...], facets: tuple[Facet, ...]) -> None:
    r"""Sun zenith and azimuth, and incidence angles on facets.

    Local true solar time (24ths of the site's day), geometric angles as in the paper's Table 2,
    and refracted ones of a standard atmosphere.

    \b
    fieldkit sun --site 35.558675,139.395232,9 --at 2017-08-30T12:00+09:00 --facet 10,180
    """
    from fieldkit.results.sun_angles import sun_rows

    place = site or campaign().site
    rows = sun_rows(place, moments, facets)
    if not print_if_json({"site": asdict(place), "rows": rows}):
        _print_rows(rows, facets)


def _print_rows(rows: list[dict[str, Any]], facets: tuple[Facet, ...]) -> None:
    headings = [f"on {tilt:g}°/{azimuth:g}°" for tilt, azimuth in facets]
    print_table(["time", "solar time", "zenith", "azimuth", "refracted zenith", *headings], map(_cells, rows))


def _cells(row: dict[str, Any]) -> list[str]:
    angles = [row["sun_zenith_deg"], row["sun_azimuth_deg"], row["sun_zenith_refracted_deg"]]
    angles += [facet["incidence_deg"] for facet in row["facets"]]
    return [row["time"], _clock(row["solar_time_h"]), *(f"{angle:.4f}°" for angle in angles)]


def _clock(hours: float) -> str:
    """``14:05``."""
    minutes = round(hours * 60.0) % (24 * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"
