"""``fieldkit sweep``: recorded sessions estimated with every combination of parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_sessions
from fieldkit.cli.types import PATH

if TYPE_CHECKING:
    from fieldkit.results.sweep import Sweep


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, required=True, type=PATH)
@click.option(
    "--set",
    "settings",
    multiple=True,
    required=True,
    metavar="KEY=VALUES",
    help="Values to try of a key of fieldkit.toml: LOW:HIGH:STEP or A,B,C; may be given for several keys.",
)
@click.option(
    "-o", "--out", type=PATH, metavar="BASE", help="Write BASE.csv, .json, .parquet [default: sweep-TIME]."
)
@common.present_option
@common.workers_options
def command(
    sessions: tuple[Path, ...],
    settings: tuple[str, ...],
    out: Path | None,
    present: bool,
    jobs: int | None,
    address: str | None,
) -> None:
    r"""Estimate SESSIONS, or folders of them, with every combination of parameters.

    What was estimated before is taken from the cache, so a sweep that was stopped goes on where it was.
    The table has a row for each session, set of parameters and region; where regions have a known tilt,
    the sets are ranked by their error, with what that ranking is worth.

    \b
    fieldkit sweep recordings/ --set surface.albedo=0.15:0.35:0.05 --set surface.emissivity=0.88,0.90

    With the learned model, prior=configured,others compares the prior as configured with what all
    other sessions learnt of sand and light meter.

    \b
    fieldkit sweep recordings/ --set estimator.model=learned --set prior=configured,others
    """
    from fieldkit.cli import batch
    from fieldkit.results.executors import workers
    from fieldkit.results.sweep import read_grid, sweep

    grid = read_grid(settings)
    paths = find_sessions(sessions)
    base = batch.base_of(out or _default(paths[0]))
    runs = len(grid.sets) * len(paths)
    with batch.progress_bar("estimating") as on_progress, workers(jobs, address, runs) as executor:
        run = partial(sweep, executor=executor, on_progress=on_progress, notify=common.say)
        result = run(paths, grid, present=present)
    common.say(f"done, {result.cached} of them known before")
    if result.columns:
        _print(result, result.write(base))
    batch.raise_failures(result.failures, paths)


def _default(session: Path) -> Path:
    """``results/sweep-TIME`` of the campaign a session lies in, or beside a session elsewhere."""
    from fieldkit.results.result_files import results_folder

    return results_folder(session) / time.strftime("sweep-%Y%m%dT%H%M%SZ", time.gmtime())


def _print(result: Sweep, files: Sequence[Path]) -> None:
    ranking = result.ranking_document()
    if common.print_if_json({"runs": result.runs, "files": list(map(str, files)), "ranking": ranking}):
        return
    if ranking is None:
        click.echo("no region of known tilt was estimated: nothing to rank the parameters by")
    else:
        _print_ranking(ranking)
    for file in files:
        click.echo(file)


def _print_ranking(ranking: Mapping[str, Any]) -> None:
    best = ", ".join(f"{key} {value}" for key, value in ranking["best"].items())
    click.echo(
        f"best median |error|: {best}   {ranking['error_deg']:.1f}° (worst {ranking['worst_deg']:.1f}°)"
    )
    if ranking["sessions"] > 1:
        click.echo(
            f"cross-validated over sessions: {_error(ranking['left_out_deg'])}, "
            f"the same choice in {ranking['same_choice']} of {ranking['sessions']}"
        )
    rows = [
        (key, "  ".join(f"{value}: {_error(error)}" for value, error in by_value.items()))
        for key, by_value in ranking["sensitivity"].items()
    ]
    if rows:
        common.print_table(("parameter", "mean |error| by value"), rows)
    for warning in ranking["warnings"]:
        common.say(f"warning: {warning}")


def _error(error_deg: float) -> str:
    """An error; sets that solve few slopes, or none of a region of known tilt, have none."""
    return f"{error_deg:.1f}°" if math.isfinite(error_deg) else "not ranked"
