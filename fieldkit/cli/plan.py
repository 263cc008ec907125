"""``fieldkit plan``: for a place, a day and some beds, when to measure and what to beware of."""

from __future__ import annotations

from dataclasses import asdict, replace
from datetime import date, datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, campaign, options, print_json, print_table, say
from fieldkit.cli.types import DAY, FACET, SITE, ZONE
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError, NoAnswerError, StorageError
from fieldkit.model.site import RegionKind, Site, with_zone
from fieldkit.model.units import CELSIUS_ZERO_K, HOUR_NS, MINUTE_NS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fieldkit.config import Config
    from fieldkit.estimation.day_plan import DayPlan
    from fieldkit.physics.facet import FloatArray

Facet = tuple[float, float]


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Where [default: the campaign's site].")
@click.option("--zone", type=ZONE, help="Time zone to show, like Asia/Tokyo [default: by longitude].")
@click.option("--on", "day", type=DAY, required=True, help="Which day, in that zone.")
@click.option("--facet", "facets", type=FACET, multiple=True, help="A bed [default: the campaign's targets].")
@click.option(
    "--dni",
    type=click.FloatRange(1.0),
    default=800.0,
    show_default=True,
    help="Direct normal irradiance assumed, W/m².",
)
@click.option(
    "--clear-sky",
    type=click.FloatRange(1.0),
    metavar="TURBIDITY",
    help="Clear-sky model instead; Linke 2..6.",
)
@click.option(
    "--noise",
    type=click.FloatRange(1e-4),
    default=0.1,
    show_default=True,
    help="Noise of a region's minute mean, K.",
)
@click.option(
    "--window",
    type=click.IntRange(3, 360),
    default=20,
    show_default=True,
    help="Length of a window, minutes.",
)
@click.option("--air-c", default=15.0, show_default=True, help="Air temperature expected, °C.")
@click.option("--step", type=click.IntRange(1), default=30, show_default=True, help="Minutes between rows.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Page to write.")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    site: Site | None,
    zone: str | None,
    day: date,
    facets: tuple[Facet, ...],
    **given: Any,
) -> None:
    r"""Sun, kelvin per degree and the best possible accuracy over a day.

    The Cramér–Rao bound needs no measurement: only sun, irradiance and noise. A page to
    print goes to the campaign's reports/, or where --out says.

    \b
    fieldkit plan --site 35.558675,139.395232,9 --on 2026-12-11 --facet 5,180 --facet 15,180
    """
    config = None if site and facets else campaign(ctx)
    place = with_zone(site, zone) if site else _of_campaign(config, zone)
    beds = facets or _targets(config)
    plan = make_plan(place, day, beds, given, config)
    light = (
        f"clear sky, Linke turbidity {given['clear_sky']:g}"
        if given["clear_sky"]
        else f"S {given['dni']:g} W/m² assumed"
    )
    path = given["out"] or (config.reports / f"plan-{day}.html" if config else None)
    if path:
        _write(plan, place, f"Plan for {day}", light, path)
    if options(ctx).json:
        print_json(_document(plan, place, day, light, path))
    else:
        _print(plan, place, light, path)


def make_plan(
    site: Site, day: date, facets: tuple[Facet, ...], given: dict[str, Any], config: Config | None = None
) -> DayPlan:
    """The plan of one local day; `given` are the verb's numbers by the names of its options.

    Raises `NoAnswerError` where the sun does not rise.
    """
    import numpy as np

    from fieldkit.estimation.day_plan import PlanSettings, plan_day
    from fieldkit.physics.sun import sun_vectors

    time_ns = np.arange(*_ends_ns(site, day), MINUTE_NS, dtype=np.int64)
    settings = PlanSettings(
        noise_k=given["noise"], window_min=given["window"], air_k=given["air_c"] + CELSIUS_ZERO_K
    )
    if config:
        estimator = config.estimator_settings()
        settings = replace(settings, surface=estimator.surface, azimuth_known=estimator.azimuth == "known")
    sun = sun_vectors(time_ns, site)
    plan = plan_day(facets, time_ns, sun, _direct(sun, time_ns, site, given), settings, given["step"])
    if not plan.rows.size:
        raise NoAnswerError(f"the sun does not rise on {day} at this site", fix="choose another day")
    return plan


def _ends_ns(site: Site, day: date) -> tuple[int, int]:
    """A day of the site's zone, moved by whole hours to have the sun's noon in its middle.

    So that no night is cut in two where clocks are of another place, or the sun sets after midnight.
    """
    from fieldkit.views.formatting import zone

    start = datetime(day.year, day.month, day.day, tzinfo=zone(site))
    ahead_h = (start.utcoffset() or timedelta()) / timedelta(hours=1) - site.longitude_deg / 15.0
    moved_ns = round((ahead_h + 12.0) % 24.0 - 12.0) * HOUR_NS
    return utc_ns(start) + moved_ns, utc_ns(start + timedelta(days=1)) + moved_ns


def _direct(sun: FloatArray, time_ns: NDArray[np.int64], site: Site, given: dict[str, Any]) -> FloatArray:
    import numpy as np

    from fieldkit.physics.daylight import clear_sky

    if given["clear_sky"]:
        return clear_sky(sun[:, 2], time_ns, site.elevation_m, given["clear_sky"])[0]
    return np.full(len(sun), given["dni"])


def _of_campaign(config: Config | None, zone: str | None) -> Site:
    assert config is not None
    return replace(config.site, timezone=zone or config.site.timezone)


def _targets(config: Config | None) -> tuple[Facet, ...]:
    """Tilt and azimuth of the campaign's targets, as far as they are known."""
    assert config is not None
    known = [
        (region.tilt_deg, region.azimuth_deg)
        for region in config.regions
        if region.kind is RegionKind.TARGET and isfinite(region.tilt_deg) and isfinite(region.azimuth_deg)
    ]
    if not known:
        raise ConfigError(
            "no target in fieldkit.toml has a tilt and an azimuth to plan for", fix="add --facet TILT,AZIMUTH"
        )
    return tuple(known)


def _print(plan: DayPlan, site: Site, light: str, path: Path | None) -> None:
    from fieldkit.views import plan_page

    click.echo(plan_page.heading(plan, site, light))
    # the page has room for both bounds, a terminal for the one that the campaign's estimates will have
    left_out = plan_page.FREE if plan.settings.azimuth_known else plan_page.KNOWN
    shown = [index for index, name in enumerate(plan_page.COLUMNS) if name != left_out]
    print_table(
        [plan_page.COLUMNS[index] for index in shown],
        [[row[index] for index in shown] for row in plan_page.rows(plan, site)],
    )
    for line in plan_page.summary(plan, site):
        click.echo(line)
    for warning in plan_page.warnings(plan, site):
        click.echo(f"beware: {warning}")
    say(f"page {path}" if path else "for a page to print: --out plan.html")


def _write(plan: DayPlan, site: Site, title: str, light: str, path: Path) -> None:
    from fieldkit.views import plan_page

    content = plan_page.page(plan, site, title, light)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}", fix="give another --out") from error


def _document(plan: DayPlan, site: Site, day: date, light: str, path: Path | None) -> dict[str, Any]:
    from fieldkit.views import plan_page

    budget = plan.bias_budget_k()
    best_ns = None if plan.best_row is None else int(plan.time_ns[plan.rows[plan.best_row]])
    return {
        "site": asdict(site),
        "day": str(day),
        "irradiance": light,
        "noise_k": plan.settings.noise_k,
        "window_min": plan.settings.window_min,
        "best_window_start": None if best_ns is None else _iso(best_ns, site),
        "minutes_for_azimuth": plan.minutes_for_azimuth(),
        "bias_budget": [
            {"tilt_deg": tilt, "azimuth_deg": turn, "for_deg": plan.settings.bias_deg, "kelvin": kelvin}
            for (tilt, turn), kelvin in zip(plan.facets, budget, strict=True)
        ],
        "warnings": plan_page.warnings(plan, site),
        "rows": [_row(plan, index, site) for index in range(plan.rows.size)],
        "page": path,
    }


def _row(plan: DayPlan, index: int, site: Site) -> dict[str, Any]:
    from fieldkit.physics.facet import tilt_azimuth

    minute, found = int(plan.rows[index]), plan.bounds[index]
    zenith, azimuth = (float(angle) for angle in tilt_azimuth(plan.sun[minute]))
    return {
        "time": _iso(int(plan.time_ns[minute]), site),
        "sun_zenith_deg": zenith,
        "sun_azimuth_deg": azimuth,
        "direct_normal_w_m2": plan.dni_w_m2[minute],
        "verdict": plan.verdict(index),
        "facets": [
            {
                "tilt_deg": tilt,
                "azimuth_deg": turn,
                "w_m2_per_degree": plan.sensitivity.irradiance_w_m2[bed, minute],
                "kelvin_per_degree": plan.sensitivity.temperature_k[bed, minute],
                "weak": bool(plan.weak[bed, minute]),
                "uncertain": bool(plan.uncertain(index)[bed]),
                **{f"bound_{name}": getattr(found, name)[bed] for name in found.__slots__},
            }
            for bed, (tilt, turn) in enumerate(plan.facets)
        ],
    }


def _iso(time_ns: int, site: Site) -> str:
    from fieldkit.views.formatting import local_time

    return local_time(time_ns, site).isoformat()
