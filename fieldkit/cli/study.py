"""``fieldkit study``: sections 2 to 5 of the paper done again, and the same with other choices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from fieldkit.cli.common import Verb, options, print_json, print_table, progress, say
from fieldkit.cli.types import DAY, HOUR, SITE, ZONE

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
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command(cls=Verb)
@click.option("--site", type=SITE, help="Where [default: the paper's site].")
@click.option("--zone", type=ZONE, help="Time zone of a --site [default: by longitude].")
@click.option("--on", "day", type=DAY, help="Which day [default: 2017-08-30, the paper's].")
@click.option("--start", "starts", type=HOUR, multiple=True, help="Local start [default: 9, 12, 15 h].")
@click.option("--minutes", type=click.IntRange(2, 720), default=20, show_default=True, help="Window.")
@click.option("--dni", type=click.FloatRange(1.0), help="Constant direct normal irradiance, W/m².")
@click.option("--turbidity", type=click.FloatRange(1.0), help="Linke turbidity of the clear sky.")
@click.option("--weather", type=FILE, help="A file of SURFRAD or BSRN instead; site and day are its own.")
@click.option("--longwave", default=400.0, show_default=True, help="Long wave down, W/m².")
@click.option("--air-c", default=30.0, show_default=True, help="Air temperature, °C.")
@click.option("--slopes", type=click.IntRange(1), help="So many random slopes [default: the paper's 61x361].")
@click.option("--noise", type=click.FloatRange(0.0), default=0.0, show_default=True, help="Noise, K.")
@click.option("--quantum", type=click.FloatRange(0.0), default=0.0, show_default=True, help="Steps of, K.")
@click.option(
    "--tolerance", type=click.FloatRange(1e-6), default=0.5, show_default=True, help="Contour, W/m²."
)
@click.option(
    "--estimator",
    "estimators",
    type=click.Choice(["contours", "unit-norm", "posterior"]),
    multiple=True,
    default=("contours", "unit-norm"),
    show_default=True,
    help="May be repeated.",
)
@click.option("--seed", default=1, show_default=True, help="Of noise and random slopes.")
@click.option("--sensitivity", is_flag=True, help="Also how Fig. 9 depends on what the paper does not tell.")
@click.option("--session", "sessions", type=FILE, multiple=True, help="Figs. 12 and 13 from sessions.")
@click.option("--surfrad", type=FILE, multiple=True, help="Only eq. (7) and others against SURFRAD days.")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default=Path("study"), show_default=True
)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    sensitivity: bool,
    sessions: tuple[Path, ...],
    surfrad: tuple[Path, ...],
    out: Path,
    **given: Any,
) -> None:
    r"""The paper's simulation study, with its tables and figures.

    Writes tables (CSV, JSON), figures 5 to 10 and 12 to 14 (SVG) and a page with all of
    them. The paper's irradiance is not public: where figures differ the page says so, and
    --sensitivity shows by how much. Figs. 12 and 13 show the paper's beds under a
    simulated sky unless sessions are given.

    \b
    fieldkit study                                            the paper as it stands
    fieldkit study --noise 0.1 --minutes 60 --estimator unit-norm
    fieldkit study --surfrad slv15365.dat --surfrad slv16001.dat
    """
    if surfrad:
        from fieldkit.cli import study_surfrad

        study_surfrad.report(surfrad)
        return
    document, folder = _studied(given, sessions, sensitivity, out)
    if options(ctx).json:
        print_json(document)
        return
    _print(document)
    say(f"tables, figures and a page with all of them: {folder / 'study.html'}")


def _studied(
    given: dict[str, Any], sessions: tuple[Path, ...], with_sensitivity: bool, out: Path
) -> tuple[dict[str, Any], Path]:
    """Run everything and write it; the document that ``--json`` prints, and where the rest is."""
    from fieldkit.cli import study_output, study_runs

    chosen = study_runs.choices(given)
    with progress() as bar:
        task = bar.add_task("study", total=None)
        runs = study_runs.run_all(chosen)
        bar.update(task, description="field")
        days = study_output.field_days(sessions)
        bar.update(task, description="tables and figures")
        rows = study_runs.sensitivity(chosen) if with_sensitivity else []
        tables = study_output.tables(runs, rows, days)
        document = study_output.document(chosen, tables)
        study_output.write(out, document, tables, study_output.figures(chosen, runs, days))
    return document, out


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
