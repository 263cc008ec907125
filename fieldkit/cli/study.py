"""``fieldkit study``: reproduce sections 2–5 of the paper, or vary its assumptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Command, print_if_json, print_table, progress, say
from fieldkit.cli.types import DAY, FILE, HOUR, SITE, NumberRange, default_option, minutes
from fieldkit.model.site import Site, with_zone

METHODS = click.Choice(["contours", "unit-norm", "posterior"])
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


@click.command(cls=Command)
@click.option("--site", type=SITE, help="Site [default: the paper's].")
@click.option("--zone", "timezone", metavar="ZONE", help="Time zone of a --site [default: by longitude].")
@click.option("--on", "day", type=DAY, help="Day [default: 2017-08-30, the paper's].")
@click.option("--start", "starts", type=HOUR, multiple=True, help="Local start [default: 9, 12, 15 h].")
@default_option("--window", "minutes", "20m", "Length of a window.", minutes(2, 720))
@click.option("--dni", "dni_w_m2", type=NumberRange(1.0), help="Constant direct normal irradiance, W/m².")
@click.option("--weather", type=FILE, help="SURFRAD or BSRN file instead; sets site and day.")
@click.option("--slopes", type=click.IntRange(1), help="Number of random slopes [default: 61x361].")
@default_option("--noise", "noise_k", 0.0, "Noise, K.", NumberRange(0.0))
@click.option("--estimator", "estimators", type=METHODS, multiple=True, help="[default: the first two]")
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
@click.option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), default=Path("study"), show_default=True
)
def command(
    site: Site | None,
    timezone: str | None,
    weather: Path | None,
    sensitivity: bool,
    sessions: tuple[Path, ...],
    out: Path,
    **assumptions: Any,
) -> None:
    r"""Reproduce sections 2–5 of the paper, with tables and figures.

    Writes tables (CSV, JSON), figures 5 to 10 and 12 to 14 (SVG) and a page with all of
    them. The paper's irradiance is not public: where figures differ the page states it, and
    --sensitivity shows by how much. Figs. 12 and 13 show the paper's beds under a
    simulated sky unless sessions are given.

    \b
    fieldkit study                                            the paper as it stands
    fieldkit study --noise 0.1 --window 1h --estimator unit-norm
    """
    from fieldkit.study.paper_study import paper_study
    from fieldkit.study.runs import StudyOptions
    from fieldkit.weather import read_station_file

    chosen = StudyOptions.of(
        site=with_zone(site, timezone) if site else None,
        weather=read_station_file(weather) if weather else None,
        **assumptions,
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
    if print_if_json(study.document):
        return
    _print(study.document)
    say(f"tables, figures and a page with all of them: {out / 'study.html'}")


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
