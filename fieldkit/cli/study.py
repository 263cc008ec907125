"""``fieldkit study``: reproduce sections 2–5 of the paper, or vary its assumptions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, options, print_json, print_table, progress, say
from fieldkit.cli.types import DAY, FILE, HOUR, SITE, ZONE, NumberRange, minutes
from fieldkit.model.site import Site, with_zone

SHOWN = {
    "start": "start",
    "estimator": "estimator",
    "slopes": "slopes",
    "tilt_mae": "MAE °",
    "tilt_sd_paper": "SD eq. (9)",
    "tilt_sd_usual": "SD usual",
    "tilt_p50": "p50 °",
    "tilt_p90": "p90 °",
    "tilt_largest": "largest °",
    "paper_tilt_p90": "paper's p90",
    "normal_p90": "normal p90 °",
    "unsolved": "unsolved",
}
WORLD_DAY = "2024-06-01"


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Site [default: the paper's].")
@click.option("--zone", type=ZONE, help="Time zone of a --site [default: by longitude].")
@click.option("--on", "day", type=DAY, help="Day [default: 2017-08-30, the paper's].")
@click.option("--start", "starts", type=HOUR, multiple=True, help="Local start [default: 9, 12, 15 h].")
@click.option(
    "--window", "minutes", type=minutes(2, 720), default="20m", show_default=True, help="Length of a window."
)
@click.option("--dni", "dni_w_m2", type=NumberRange(1.0), help="Constant direct normal irradiance, W/m².")
@click.option("--turbidity", type=NumberRange(1.0), help="Linke turbidity of the clear sky.")
@click.option("--weather", type=FILE, help="SURFRAD or BSRN file instead; sets site and day.")
@click.option("--slopes", type=click.IntRange(1), help="Number of random slopes [default: 61x361].")
@click.option("--noise", "noise_k", type=NumberRange(0.0), default=0.0, show_default=True, help="Noise, K.")
@click.option(
    "--estimator", "estimators", type=click.Choice(["contours", "unit-norm", "posterior"]), multiple=True,
    default=("contours", "unit-norm"), show_default=True, help="May be repeated.",
)  # fmt: skip
@click.option("--seed", default=1, show_default=True, help="Random seed.")
@click.option("--sensitivity", is_flag=True, help="Also vary what the paper does not state (Fig. 9).")
@click.option(
    "--session",
    "sessions",
    type=FILE,
    multiple=True,
    metavar="SESSION",
    help="Figs. 12 and 13 from this session.",
)
@click.option("--surfrad", type=FILE, multiple=True, help="Only compare surface models with SURFRAD days.")
@click.option(
    "--measured-ground", "grounds", type=FILE, multiple=True,
    help="Only try the surface model on measured ground, a CSV file.",
)  # fmt: skip
@click.option("--body", type=click.Choice(["mars", "moon"]), help="Study this world instead of the paper.")
@click.option("--dust", type=NumberRange(0.0, 6.0), help="Optical depth of dust, for --body.")
@click.option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), default=Path("study"), show_default=True
)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    site: Site | None,
    zone: str | None,
    weather: Path | None,
    sensitivity: bool,
    sessions: tuple[Path, ...],
    surfrad: tuple[Path, ...],
    grounds: tuple[Path, ...],
    body: str | None,
    dust: float | None,
    out: Path,
    **given: Any,
) -> None:
    r"""Reproduce sections 2–5 of the paper, with tables and figures.

    Writes tables (CSV, JSON), figures 5 to 10 and 12 to 14 (SVG) and a page with all of
    them. The paper's irradiance is not public: where figures differ the page states it, and
    --sensitivity shows by how much. Figs. 12 and 13 show the paper's beds under a
    simulated sky unless sessions are given.

    --measured-ground reads one row a minute with the columns minute, ground_radiometer_c, air_c,
    wind_m_s, shortwave_down_w_m2, shortwave_up_w_m2, longwave_down_w_m2 and
    sun_zenith_apparent_deg; at least a day. The model is fitted on one half and tried on
    the other, then the other way round.

    --body studies another world instead: slopes, hours, noise and windows, with a
    verdict. It takes --site, --on, --noise, --slopes, --seed and --dust.

    \b
    fieldkit study                                            the paper as it stands
    fieldkit study --noise 0.1 --window 1h --estimator unit-norm
    fieldkit study --surfrad slv15365.dat --surfrad slv16001.dat
    fieldkit study --body mars --out mars
    fieldkit study --measured-ground cinder-2022.csv --out ground
    """
    if body:
        _study_world(ctx, body, site, dust, out, given)
        return
    if dust is not None:
        raise click.UsageError("--dust needs --body")
    if surfrad:
        _compare_with_surfrad(surfrad)
        return
    if grounds:
        _try_on_ground(grounds, out)
        return
    from fieldkit.study.paper_study import paper_study
    from fieldkit.study.runs import StudyOptions
    from fieldkit.weather import read_station_file

    chosen = StudyOptions.of(
        site=with_zone(site, zone) if site else None,
        weather=read_station_file(weather) if weather else None,
        **given,
    )
    with progress() as bar:
        task = bar.add_task("study", total=None)
        study = paper_study(
            chosen,
            sessions=sessions,
            with_sensitivity=sensitivity,
            on_stage=lambda stage: bar.update(task, description=stage),
        )
        study.write(out)
    if options().json:
        print_json(study.document)
        return
    _print(study.document)
    say(f"tables, figures and a page with all of them: {out / 'study.html'}")


WORLD_COLUMNS = {
    "hour": "from h",
    "minutes": "minutes",
    "noise_k": "noise K",
    "tilt_mae_deg": "tilt MAE °",
    "normal_p90_deg": "normal p90 °",
    "bound_north_deg": "bound N °",
    "bound_east_deg": "E °",
    "bound_south_deg": "S °",
    "bound_west_deg": "W °",
    "verdict": "verdict",
}
FOR_THE_EARTH = ("dni_w_m2", "turbidity", "starts", "weather", "sessions", "surfrad", "grounds", "zone")


def _study_world(
    ctx: click.Context, body: str, site: Site | None, dust: float | None, out: Path, given: dict[str, Any]
) -> None:
    from fieldkit.study.other_worlds import NOISES_K, SITES, world_study

    for parameter in ctx.command.params:
        if parameter.name in FOR_THE_EARTH and ctx.params[parameter.name] not in (None, ()):
            raise click.UsageError(f"{parameter.opts[0]} belongs to the Earth: omit it with --body {body}")
    with progress() as bar:
        task = bar.add_task("study", total=None)
        study = world_study(
            replace(site, body=body) if site else SITES[body],
            str(given["day"] or WORLD_DAY),
            dust=dust,
            noises_k=(given["noise_k"],) if given["noise_k"] else NOISES_K,
            slopes=given["slopes"] or 300,
            seed=given["seed"],
            on_window=lambda window: bar.update(task, description=window),
        )
    study.write(out)
    if options().json:
        print_json(study.document)
        return
    print_table(
        list(WORLD_COLUMNS.values()), [[_cell(row[name]) for name in WORLD_COLUMNS] for row in study.rows]
    )
    for sentence in study.summary:
        click.echo(sentence)
    say(f"table and figure: {out / 'world.csv'}, {out / 'world.svg'}")


def _compare_with_surfrad(paths: tuple[Path, ...]) -> None:
    from fieldkit.study.surfrad import compare

    found = compare(paths)
    if options().json:
        print_json({"within_sample": found.within_sample, "next_day": found.next_day})
        return
    print_table(
        ["file", "model", "emissivity", "RMSE K", "bias K"],
        [[_fixed(value) for value in row.values()] for row in found.within_sample],
    )
    if found.next_day:
        rows = [[_fixed(value) for value in row.values()] for row in found.next_day]
        print_table(list(found.next_day[0]), rows)


def _try_on_ground(paths: tuple[Path, ...], out: Path) -> None:
    from fieldkit.study import ground, ground_output

    if len({path.stem for path in paths}) < len(paths):
        raise click.UsageError(
            "two --measured-ground files have the same name: their figures would be one file"
        )
    with progress() as bar:
        task = bar.add_task("ground", total=ground.steps(len(paths)))
        fits = [
            fit
            for path in paths
            for fit in ground.ground_fits(path, lambda done: bar.update(task, advance=1, description=done))
        ]
    ground_output.write(out, fits)
    if options().json:
        print_json(ground_output.document(fits))
        return
    print_table(ground_output.SCORE_COLUMNS, ground_output.score_rows(fits))
    click.echo()
    print_table(ground_output.PARAMETER_COLUMNS, ground_output.parameter_rows(fits))
    click.echo()
    for fit in fits:
        click.echo(f"{fit.ground.name}, {fit.fitted} fitted: exchange {fit.exchange} W m⁻² K⁻¹, U in m/s")
    exchange = fits[0].mean_exchange_w_m2_k
    say(f"figures, tables and a page with all of them: {out / 'ground.html'}")
    say(
        f"next, {fits[0].ground.name}'s exchange as the prior: "
        f"fieldkit estimate SESSION --set prior.exchange_w_m2_k={exchange:.1f}"
    )


def _fixed(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _print(document: dict[str, Any]) -> None:
    click.echo(f"{document['day']}, {document['minutes']} min, {document['irradiance']}")
    rows = document["errors"]
    print_table(list(SHOWN.values()), [[_cell(row[name]) for name in SHOWN] for row in rows])
    for day in document["field"]:
        click.echo(
            f"{day['day']}: model against measured surface {day['rmse_k']:.2f} K rms (paper 1.83), "
            f"mean tilt error {day['mean_tilt_error_deg']:.1f}° (paper: mostly 2–7°)"
        )
    for row in document.get("sensitivity", []):
        click.echo("  ".join(_cell(value) for value in row.values()))


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "–" if value != value else f"{value:.3g}"
    return str(value)
