"""``fieldkit plan``: for a place, a day and some slopes, what a session will determine."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.batch import progress_bar
from fieldkit.cli.common import Command, campaign, options, print_json, print_table, say
from fieldkit.cli.types import DAY, FACET, HOUR, NEW_FILE, SITE, ZONE, NumberRange, default_option, minutes
from fieldkit.model.site import Site, with_zone

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.recording.experiments import Experiments
    from fieldkit.recording.plan import MeasuringPlan


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Site [default: the campaign's].")
@click.option("--zone", type=ZONE, help="Time zone to show, like Asia/Tokyo [default: by longitude].")
@click.option("--on", "day", type=DAY, help="Day, in that zone [default: the next].")
@click.option("--at", type=HOUR, metavar="TIME", help="Start of the session [default: at the best window].")
@default_option("--for", "session_min", "3h", "Length of the session.", minutes(20, 720))
@click.option(
    "--as-planned", is_flag=True, help="Do not predict what instruments, calibrations and tests would bring."
)
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
@default_option("--window", "window_min", "20m", "Length of the best window.", minutes(3, 360))
@default_option("--air-c", "air_c", 15.0, "Air temperature expected, °C.", NumberRange(-150.0, 60.0))
@default_option("--step", "step_min", "30m", "Time between rows.", minutes(1, 1440))
@click.option("-o", "--out", type=NEW_FILE, help="Page to write.")
def command(
    site: Site | None,
    zone: str | None,
    day: date | None,
    at: time | None,
    session_min: int,
    as_planned: bool,
    facets: tuple[tuple[float, float], ...],
    out: Path | None,
    **assumed: Any,
) -> None:
    r"""Show how well a session will determine the slopes: half widths of every tilt by the half hour.

    Simulates the session under that day's clear sky with the sand, instruments and noise of
    the campaign, and estimates it with the learned model; then again with each measure that
    could narrow it. Seconds to half a minute, by the number of cores. A page to print goes
    to the campaign's reports/, or to --out.

    \b
    fieldkit plan
    fieldkit plan --on 2026-12-11 --at 10:30 --for 2h --as-planned
    fieldkit plan --site 35.558675,139.395232,9 --on 2026-12-11 --facet 5,180 --facet 15,180
    """
    from fieldkit.recording.plan import PlanOptions, plan, target_facets
    from fieldkit.results.executors import workers

    config, place = None, with_zone(site, zone) if site else None
    if place is None or not facets:
        config = campaign()
        place = place or replace(config.site, timezone=zone or config.site.timezone)
        facets = facets or target_facets(config)
    estimator = config.estimator_settings() if config else None
    day_plan = plan(place, day, facets, PlanOptions(**assumed), estimator=estimator)
    experiments = None
    if at is not None or day_plan.day_plan.best_row is not None:
        session = day_plan.session(session_min, at=at, **_instruments(config))
        with progress_bar("simulated sessions") as on_run, workers() as executor:
            experiments = day_plan.experiments(
                session, with_measures=not as_planned, executor=executor, on_run=on_run
            )
    path = out or (config.reports / f"plan-{day_plan.day}.html" if config else None)
    if path:
        day_plan.write(path, experiments)
    if options().json:
        simulated = experiments.document if experiments else {"experiments": None}
        print_json({**day_plan.document, **simulated, "page": path})
    else:
        _print(day_plan, experiments, path)


def _instruments(config: Config | None) -> dict[str, Any]:
    """Streams and references of the campaign; without one a level reference, and frames and light."""
    from fieldkit.recording.plan import logged_quantities, reference_facets

    return {"logged": logged_quantities(config), "references": reference_facets(config)} if config else {}


def _print(day_plan: MeasuringPlan, experiments: Experiments | None, path: Path | None) -> None:
    from fieldkit.views import plan_page

    plan, site = day_plan.day_plan, day_plan.site
    click.echo(plan_page.heading(plan, site, day_plan.irradiance))
    if experiments:
        for line in experiments.summary:
            click.echo(line)
        print_table(experiments.table.columns, experiments.table.rows)
        click.echo(experiments.table.caption)
        click.echo()
    print_table(plan_page.COLUMNS, plan_page.rows(plan, site))
    for line in plan_page.footnotes(plan, site):
        click.echo(line)
    for warning in day_plan.warnings:
        click.echo(f"beware: {warning}")
    say(f"page {path}" if path else "for a page to print: --out plan.html")
    say("next: fieldkit doctor")
