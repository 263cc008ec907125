"""``fieldkit plan``: for a place, a day and some slopes, what a session will determine."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, campaign, print_if_json, print_table, say, say_warning
from fieldkit.cli.types import DAY, FACET, HOUR, NEW_FILE, SITE, NumberRange, default_option, minutes
from fieldkit.model.site import Site, with_zone

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.estimation.settings import EstimatorSettings
    from fieldkit.recording.plan import MeasuringPlan
    from fieldkit.recording.planned_session import Prediction


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Site [default: the campaign's].")
@click.option(
    "--zone", "timezone", metavar="ZONE", help="Zone to show, like Asia/Tokyo [default: by longitude]."
)
@click.option("--on", "day", type=DAY, help="Day, in that zone [default: the next].")
@click.option("--at", type=HOUR, metavar="TIME", help="Start of the session [default: around the best time].")
@default_option("--for", "session_min", "3h", "Length of the session.", minutes(20, 720))
@click.option(
    "--facet", "facets", type=FACET, multiple=True, help="A region's slope [default: the campaign's targets]."
)
@default_option(
    "--dni", "dni_w_m2", 800.0, "Direct normal irradiance over the day, W/m².", NumberRange(1.0, 1408.0)
)
@click.option(
    "--clear-sky", "turbidity", type=NumberRange(1.0), metavar="TURBIDITY", help="Clear sky instead, 2..6."
)
@click.option(
    "--noise", "noise_k", type=NumberRange(1e-4), help="Noise of a minute mean, K [default: as configured]."
)
@default_option("--air-c", "air_c", 15.0, "Air temperature expected, °C.", NumberRange(-150.0, 60.0))
@default_option("--step", "step_min", "30m", "Time between rows.", minutes(1, 1440))
@click.option("-o", "--out", type=NEW_FILE, help="Page to write.")
def command(
    site: Site | None,
    timezone: str | None,
    day: date | None,
    at: time | None,
    session_min: int,
    facets: tuple[tuple[float, float], ...],
    out: Path | None,
    **assumed: Any,
) -> None:
    r"""Show how well a session will determine the slopes, and what would narrow them.

    Simulates the session under that day's clear sky with the sand, instruments and noise of
    the campaign, and estimates it with the learned model: half-widths of every tilt after 30
    and 60 minutes and at the end, and what each measure would leave of them. Seconds the first
    time. With --site a campaign is planned elsewhere. A page to print goes to the campaign's
    reports/, or to --out.

    \b
    fieldkit plan
    fieldkit plan --on 2026-12-11 --at 10:30 --for 2h
    fieldkit plan --site 35.558675,139.395232,9 --on 2026-12-11 --facet 5,180 --facet 15,180
    """
    from fieldkit.recording.plan import PlanOptions, plan, regions_without_slope, target_facets

    config = _campaign(is_needed=not (site and facets))
    place, estimator = _place(config, site, timezone)
    if config and not facets:
        facets = target_facets(config)
        for name in regions_without_slope(config):
            say_warning(f"{name} has no tilt and azimuth, so it is not planned with")
    day_plan = plan(place, day, facets, PlanOptions(**assumed), estimator=estimator)
    prediction = None
    if at is not None or day_plan.day_plan.best_minute() is not None:
        prediction = day_plan.prediction(day_plan.session(session_min, at=at, **_instruments(config)))
    path = out or (config.reports / f"plan-{day_plan.day}.html" if config else None)
    if path:
        day_plan.write(path, prediction)
    document = prediction.document if prediction else {"prediction": None}
    if not print_if_json({**day_plan.document, **document, "page": path}):
        _print(day_plan, prediction, path)


def _campaign(*, is_needed: bool) -> Config | None:
    """The campaign here, None without one; raises `ConfigError` without one that is needed."""
    from fieldkit.config.files import NoCampaignError

    try:
        return campaign()
    except NoCampaignError:
        if is_needed:
            raise
        return None


def _place(
    config: Config | None, site: Site | None, zone: str | None
) -> tuple[Site, EstimatorSettings | None]:
    """Where the session will be, the campaign's place by default, and the campaign's settings."""
    if config is None:
        assert site is not None
        return with_zone(site, zone), None
    settings = config.estimator_settings()
    if site is None:
        return replace(config.site, timezone=zone or config.site.timezone), settings
    # a horizon is that of the campaign's own place
    elsewhere = replace(with_zone(site, zone), body=config.site.body)
    return elsewhere, replace(settings, horizon=(), horizons={})


def _instruments(config: Config | None) -> dict[str, Any]:
    """Streams and references of the campaign; without one a level reference, and frames and light."""
    from fieldkit.recording.plan import logged_quantities, reference_facets

    return {"logged": logged_quantities(config), "references": reference_facets(config)} if config else {}


def _print(day_plan: MeasuringPlan, prediction: Prediction | None, path: Path | None) -> None:
    from fieldkit.views import plan_page

    plan, site = day_plan.day_plan, day_plan.site
    click.echo(plan_page.heading(plan, site, day_plan.irradiance))
    if prediction:
        for line in prediction.summary:
            click.echo(line)
        print_table(prediction.table.columns, prediction.table.rows)
        click.echo(prediction.table.caption)
        click.echo()
    print_table(plan_page.COLUMNS, plan_page.rows(plan, site))
    for line in plan_page.footnotes(plan):
        click.echo(line)
    for warning in day_plan.warnings:
        click.echo(f"beware: {warning}")
    say(f"page {path}" if path else "for a page to print: --out plan.html")
    say("next: fieldkit doctor")
