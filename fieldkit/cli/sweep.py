"""``fieldkit sweep``: recorded sessions estimated with every combination of parameters."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_sessions

if TYPE_CHECKING:
    from fieldkit.workflows.sweep import Grid, Ranking


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--set", "settings", multiple=True, required=True, metavar="KEY=VALUES",
    help="Values to try of a key of fieldkit.toml: LOW:HIGH:STEP or A,B,C; may be given for several keys.",
)  # fmt: skip
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="BASE",
    help="Write BASE.csv, BASE.json (and BASE.parquet) [default: sweep-TIME in the results folder].",
)  # fmt: skip
@common.present_option
@common.workers_options
@click.pass_context
def command(
    ctx: click.Context,
    sessions: tuple[Path, ...],
    settings: tuple[str, ...],
    out: Path | None,
    present: bool,
    jobs: int | None,
    kind: str,
    address: str | None,
) -> None:
    r"""Estimate SESSIONS, or folders of them, with every combination of parameters.

    What was estimated before is taken from the cache, so a sweep that was stopped goes on where it was.
    The table has a row for each session, set of parameters and bed; where beds have a known tilt, the sets
    are ranked by their error, with what that ranking is worth.

    \b
    fieldkit sweep recordings/ --set surface.albedo=0.15:0.35:0.05 --set surface.emissivity=0.88,0.90
    """
    from fieldkit.cli import batch
    from fieldkit.workflows.provenance import provenance
    from fieldkit.workflows.sweep import Summary, names_of, read_grid, runs_of

    grid = read_grid(settings)
    paths = find_sessions(ctx, sessions)
    base = batch.base_of(out or _default(paths[0]))
    sources, failures = batch.look_at(paths, present=present)
    runs = runs_of(sources, grid)
    common.say(f"{len(runs)} runs: {len(grid.sets)} sets of parameters, {len(sources)} sessions")
    summary = Summary(grid, names_of(sources))
    with batch.workers(kind, address, jobs, len(runs)) as executor:
        for outcome in batch.carried_out(runs, executor, failures):
            summary.add(outcome)
    common.say(f"done, {summary.cached} of them known before")
    ranking = summary.ranking()
    if summary:
        about = {
            **provenance(sources, failures),
            "parameters": {parameter.key: parameter.values for parameter in grid.parameters},
            "ranking": None if ranking is None else ranking_document(ranking, grid),
        }
        written = batch.write_results(base, summary.columns(), about)
        _tell(written, ranking, grid, len(runs))
    batch.complain(failures, paths)


def ranking_document(ranking: Ranking, grid: Grid) -> dict[str, Any]:
    """The ranking for the result file and ``--json``."""
    return {
        "best": dict(setting.split("=", 1) for setting in grid.sets[ranking.best]),
        "error_deg": ranking.error_deg[ranking.best],
        "worst_deg": ranking.worst_deg,
        "left_out_deg": ranking.left_out_deg,
        "same_choice": ranking.same_choice,
        "sessions": ranking.folds,
        "sessions_without_slopes": ranking.silent,
        "uncertain_share": ranking.uncertain_share,
        "sensitivity": {
            effect.key: dict(zip(effect.values, effect.error_deg, strict=True)) for effect in ranking.effects
        },
        "warnings": ranking.warnings,
    }


def _default(session: Path) -> Path:
    """``results/sweep-TIME`` of the campaign a session lies in, or beside a session elsewhere."""
    folder = session.resolve().parent
    results = folder.parent / "results" if folder.name == "recordings" else folder
    return results / time.strftime("sweep-%Y%m%dT%H%M%SZ", time.gmtime())


def _tell(written: Sequence[Path], ranking: Ranking | None, grid: Grid, runs: int) -> None:
    if common.options().json:
        found = None if ranking is None else ranking_document(ranking, grid)
        common.print_json({"runs": runs, "files": [str(path) for path in written], "ranking": found})
        return
    if ranking is None:
        click.echo("no bed of known tilt was answered: nothing to rank the parameters by")
    else:
        _print_ranking(ranking_document(ranking, grid))
    for path in written:
        click.echo(path)


def _print_ranking(found: Mapping[str, Any]) -> None:
    best = ", ".join(f"{key} {value}" for key, value in found["best"].items())
    click.echo(f"best median |error|: {best}   {found['error_deg']:.1f}° (worst {found['worst_deg']:.1f}°)")
    if found["sessions"] > 1:
        click.echo(
            f"sessions left out of the choice: {found['left_out_deg']:.1f}°, "
            f"the same choice in {found['same_choice']} of {found['sessions']}"
        )
    rows = [
        (key, "  ".join(f"{value}: {error:.1f}°" for value, error in by_value.items()))
        for key, by_value in found["sensitivity"].items()
    ]
    if rows:
        common.print_table(("parameter", "mean |error| by value"), rows)
    for warning in found["warnings"]:
        common.say(f"warning: {warning}")
