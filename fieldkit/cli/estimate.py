"""``fieldkit estimate``: slopes of one recorded session or of many."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import batch, common
from fieldkit.cli.session_paths import find_sessions
from fieldkit.cli.slope_table import explain_slopes, print_slopes
from fieldkit.cli.types import FACET, PATH, SITE, WORDS
from fieldkit.model.site import Region, RegionKind, Site

if TYPE_CHECKING:
    from fieldkit.results.batch import EstimatedSessions
    from fieldkit.results.comparison import Comparison, Move

Workers = tuple[int | None, str | None]
"""Number of processes and scheduler, as `workers` takes them."""


# --campaign and --without-mark, chosen for sessions, go on under the names of their arguments in Python
@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, required=True, type=PATH)
@click.option("-o", "--out", type=PATH, metavar="BASE", help="Write every minute's slopes to BASE.csv.")
@click.option(
    "--together", is_flag=True, help="One slope of each region for all SESSIONS, which are of one place."
)
@common.present_option
@common.workers_options
@click.option("--site", type=SITE, help="Where a table was measured.")
@click.option(
    "--reference-facet",
    "reference",
    type=FACET,
    default=(0.0, 0.0),
    help="Slope of a table's reference.  [default: horizontal]",
)
@click.option(
    "--without-mark",
    "without_marks",
    type=WORDS,
    multiple=True,
    metavar="MARK",
    help="Give a mark no effect, by its number (fieldkit mark --list) or text.",
)
@click.option(
    "--against",
    multiple=True,
    metavar="KEY=VALUE|BASE",
    help="Compare with the slopes by other settings, or with those that -o BASE wrote.",
)
@common.set_option
def command(
    sessions: tuple[Path, ...],
    out: Path | None,
    together: bool,
    jobs: int | None,
    address: str | None,
    site: Site | None,
    reference: tuple[float, float],
    settings: tuple[str, ...],
    against: tuple[str, ...],
    **chosen: Any,
) -> None:
    """Estimate the slopes of recorded SESSIONS or folders of them, as configured or with --set.

    --together joins sessions of one place, such as a field on several days, or the days of one: slopes,
    absorbed light and thermal inertia are those of all; weather and the camera's offsets begin anew in each.
    It needs the learned model.

    A single table FILE.csv with --site works as well, and several with --together: columns time (ISO 8601
    with its zone), reference_k, one NAME_k for each target (or _c), irradiance_w_m2 (direct normal), ghi_w_m2
    (global horizontal) or illuminance_lx; air_k (or _c), wind_m_s and flags if any. One row gives the
    component along the sun. With --set estimator.reference=weather reference_k is not needed.

    --against prints which regions moved, by how much (also in half-widths) and what differed: settings, code,
    marks. It may be given for several keys.

    With -o all of them go into one table, BASE.csv (and BASE.parquet with fieldkit-slope[lab]), and BASE.json
    records what made it: code, parameters, checksums of the sessions, command line.
    """
    are_tables = [path.suffix.lower() == ".csv" for path in sessions]
    if any(are_tables) and not (all(are_tables) and (together or len(sessions) == 1)):
        raise click.UsageError(
            "give one table alone, or several of one place with --together; sessions apart"
        )
    if all(are_tables):
        if any((out, *chosen.values(), against, jobs, address)):
            raise click.UsageError("a table takes --site, --reference-facet, --set; to write: --json > FILE")
        _estimate_tables(sessions, site, reference, settings)
        return
    paths = find_sessions(sessions)
    if together:
        if against or jobs is not None or address is not None:
            raise click.UsageError("sessions are joined in this process: omit -j, --address and --against")
        _estimate_together(paths, out, settings, chosen)
        return
    _estimate_sessions(paths, out, (jobs, address), against, {"settings": settings, **chosen})


def _estimate_sessions(
    paths: Sequence[Path], out: Path | None, by: Workers, against: Sequence[str], how: dict[str, Any]
) -> None:
    from fieldkit.results.batch import estimate_sessions
    from fieldkit.results.comparison import compare
    from fieldkit.results.estimate import require_slope
    from fieldkit.results.executors import workers

    base = None if out is None else batch.base_of(out)
    with batch.progress_bar("estimating") as on_progress, workers(*by, len(paths)) as executor:
        run = partial(estimate_sessions, paths, executor=executor, on_progress=on_progress)
        estimates = run(**how)
        other: EstimatedSessions | str = "".join(against)
        if len(against) > 1 or "=" in "".join(against):
            other = run(**{**how, "settings": against})
    if base is not None and estimates.estimates:
        common.say(f"wrote {', '.join(map(str, estimates.write(base)))}")
    if estimates.estimates and other:
        _print_comparison(compare(estimates, other))
    elif estimates.estimates:
        _print(estimates)
    batch.raise_failures(estimates.failures, paths)
    require_slope(
        [slope for of_session in estimates.estimates.values() for slope in of_session.final.values()]
    )


def _estimate_together(
    paths: Sequence[Path], out: Path | None, settings: Sequence[str], chosen: dict[str, Any]
) -> None:
    from fieldkit.results.estimate import require_slope, slopes_document
    from fieldkit.results.together import estimate_together

    base = None if out is None else batch.base_of(out)
    with batch.progress_bar("estimating together") as on_progress:
        estimates = estimate_together(
            paths, settings, **chosen, notify=common.say_warning, on_progress=on_progress
        )
    if base is not None:
        common.say(f"wrote {', '.join(map(str, estimates.write(base)))}")
    document = {"together": list(map(str, estimates.sessions)), **slopes_document(estimates)}
    if not common.print_if_json(document):
        print_slopes(estimates.final, estimates.regions, estimates.learnt.final, estimates.checks)
        explain_slopes(estimates.final.values())
        command = "report {}" if base else "estimate {} --together -o BASE"
        common.say(f"next: fieldkit {command.format(shlex.join(map(str, paths)))}")
    require_slope(estimates.final.values())


def _estimate_tables(
    paths: Sequence[Path], site: Site | None, reference: tuple[float, float], settings: Sequence[str]
) -> None:
    from fieldkit.results.estimate import as_document, estimate_tables, require_slope

    if site is None:
        raise click.UsageError("a table needs --site LAT,LON,ALT: where it was measured")
    slopes = estimate_tables(
        paths, site, settings=settings, reference_slope_deg=reference, notify=common.say_warning
    )
    head = {"table": str(paths[0])} if len(paths) == 1 else {"together": list(map(str, paths))}
    if not common.print_if_json({**head, "slopes": [as_document(slope) for slope in slopes]}):
        targets = [Region(slope.region, RegionKind.TARGET, ()) for slope in slopes]
        print_slopes({slope.region: slope for slope in slopes}, targets)
        explain_slopes(slopes)
    require_slope(slopes)


def _print_comparison(comparison: Comparison) -> None:
    if common.print_if_json(comparison.document()):
        return
    columns = ("session", "region", "other °", "tilt °", "moved °", "half-widths", "azimuth moved °", "state")
    common.print_table(columns, map(_move_row, comparison.moves))
    for name, (there, here) in comparison.differences.items():
        common.say(f"{name}: {there or 'as configured'} in the other, here {here or 'as configured'}")
    if not comparison.differences:
        common.say("settings, code and marks are the same")


def _move_row(move: Move) -> tuple[str, ...]:
    from fieldkit.views.formatting import number

    tilts = (number(tilt, 1) for tilt in (move.other_tilt_deg, move.tilt_deg))
    moved = (number(value, places) for value, places in ((move.moved_deg, 1), (move.moved_half_widths, 2)))
    state = move.state if move.state == move.other_state else f"{move.other_state} → {move.state}"
    return move.session, move.region, *tilts, *moved, number(move.azimuth_moved_deg), state


def _print(sessions: EstimatedSessions) -> None:
    from fieldkit.results.estimate import slopes_document

    documents = [
        {"session": str(sessions.paths[name]), **slopes_document(slopes)}
        for name, slopes in sessions.estimates.items()
    ]
    if common.print_if_json(documents[0] if len(documents) == 1 else {"sessions": documents}):
        return
    for name, estimates in sessions.estimates.items():
        if len(sessions.estimates) > 1:
            click.echo(name)
        print_slopes(estimates.final, estimates.regions, estimates.learnt.final, estimates.checks)
    explain_slopes(slope for estimates in sessions.estimates.values() for slope in estimates.final.values())
