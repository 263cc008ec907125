"""``fieldkit plan``: for a place, a day and some slopes, when to measure and what to beware of."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, campaign, options, print_json, print_table, progress, say
from fieldkit.cli.types import DAY, FACET, SITE, ZONE, minutes
from fieldkit.model.site import Site, with_zone

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.recording.experiments import Experiments
    from fieldkit.recording.plan import MeasuringPlan


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Site [default: the campaign's].")
@click.option("--zone", type=ZONE, help="Time zone to show, like Asia/Tokyo [default: by longitude].")
@click.option("--on", "day", type=DAY, required=True, help="Day, in that zone.")
@click.option(
    "--facet", "facets", type=FACET, multiple=True, help="A region's slope [default: the campaign's targets]."
)
@click.option(
    "--dni", "dni_w_m2", type=click.FloatRange(1.0), default=800.0, show_default=True,
    help="Direct normal irradiance assumed, W/m².",
)  # fmt: skip
@click.option(
    "--clear-sky", "turbidity", type=click.FloatRange(1.0), metavar="TURBIDITY",
    help="Clear-sky model instead; Linke 2..6.",
)  # fmt: skip
@click.option(
    "--noise", "noise_k", type=click.FloatRange(1e-4), default=0.1, show_default=True,
    help="Noise of a region's minute mean, K.",
)  # fmt: skip
@click.option(
    "--window", "window_min", type=minutes(3, 360), default="20m", show_default=True,
    help="Length of a window.",
)  # fmt: skip
@click.option("--air-c", default=15.0, show_default=True, help="Air temperature expected, °C.")
@click.option(
    "--step", "step_min", type=minutes(1, 1440), default="30m", show_default=True, help="Time between rows."
)
@click.option("--experiments", "predicts", is_flag=True, help="Predict what a shade test and others bring.")
@click.option(
    "--for", "session_min", type=minutes(20, 360), default="1h", show_default=True,
    help="Length of the session for --experiments.",
)  # fmt: skip
@click.option("-o", "--out", type=click.Path(dir_okay=False, path_type=Path), help="Page to write.")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    site: Site | None,
    zone: str | None,
    day: date,
    facets: tuple[tuple[float, float], ...],
    predicts: bool,
    session_min: int,
    out: Path | None,
    **assumed: Any,
) -> None:
    r"""Sun, kelvin per degree and the best possible accuracy over a day.

    The Cramér–Rao bound needs no measurement: only sun, irradiance and noise. A page to
    print goes to the campaign's reports/, or to --out. --experiments simulates the
    best hour with the learned model, as it is and with each experiment: half a minute.

    \b
    fieldkit plan --site 35.558675,139.395232,9 --on 2026-12-11 --facet 5,180 --facet 15,180
    fieldkit plan --on 2026-12-11 --clear-sky 3 --experiments
    """
    from fieldkit.recording.plan import PlanOptions, plan, target_facets

    config = None if site and facets else campaign(ctx)
    made = plan(
        with_zone(site, zone) if site else _campaign_site(config, zone),
        day,
        facets or target_facets(_loaded(config)),
        PlanOptions(**assumed),
        estimator=config.estimator_settings() if config else None,
    )
    found = _predicted(made, session_min, config) if predicts else None
    path = out or (config.reports / f"plan-{day}.html" if config else None)
    if path:
        made.write(path, found)
    if options(ctx).json:
        print_json({**made.document, "experiments": found and found.document, "page": path})
    else:
        _print(made, found, path)


def _predicted(made: MeasuringPlan, session_min: int, config: Config | None) -> Experiments:
    from fieldkit.recording.plan import logs_air

    with progress() as bar:
        task = bar.add_task("experiments", total=None)
        return made.experiments(
            session_min,
            air_logged=config is not None and logs_air(config),
            on_experiment=lambda one: bar.update(task, description=one.name),
        )


def _loaded(config: Config | None) -> Config:
    """The campaign's configuration, which is loaded unless both --site and --facet are given."""
    assert config is not None
    return config


def _campaign_site(config: Config | None, zone: str | None) -> Site:
    site = _loaded(config).site
    return replace(site, timezone=zone or site.timezone)


def _print(made: MeasuringPlan, found: Experiments | None, path: Path | None) -> None:
    from fieldkit.views import plan_page

    plan, site = made.day_plan, made.site
    click.echo(plan_page.heading(plan, site, made.irradiance))
    # the page has room for both bounds, a terminal for the one that the campaign's estimates will have
    hidden = plan_page.FREE if plan.settings.azimuth_known else plan_page.KNOWN
    shown = [index for index, name in enumerate(plan_page.COLUMNS) if name != hidden]
    print_table(
        [plan_page.COLUMNS[index] for index in shown],
        [[row[index] for index in shown] for row in plan_page.rows(plan, site)],
    )
    for line in plan_page.summary(plan, site):
        click.echo(line)
    for warning in made.warnings:
        click.echo(f"beware: {warning}")
    if found:
        print_table(found.table.columns, found.table.rows)
        click.echo(found.table.caption)
    say(f"page {path}" if path else "for a page to print: --out plan.html")
