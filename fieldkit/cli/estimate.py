"""``fieldkit estimate``: slopes of one recorded session or of many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_sessions
from fieldkit.cli.slope_table import explain_slopes, print_slopes
from fieldkit.cli.types import FACET, SITE
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import WITH_SLOPE, final_estimates
from fieldkit.workflows.estimate import as_document

if TYPE_CHECKING:
    from fieldkit.model.slope import SlopeEstimate
    from fieldkit.workflows.estimates import Estimates


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    metavar="BASE",
    help="Write every minute's slopes to BASE.csv.",
)
@common.present_option
@common.workers_options
@click.option("--site", type=SITE, help="Where a table was measured.")
@click.option(
    "--reference",
    type=FACET,
    default=(0.0, 0.0),
    help="Slope of a table's reference.  [default: horizontal]",
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    sessions: tuple[Path, ...],
    out: Path | None,
    present: bool,
    jobs: int | None,
    kind: str,
    address: str | None,
    site: Site | None,
    reference: tuple[float, float],
    settings: tuple[str, ...],
) -> None:
    """Estimate the slopes of recorded SESSIONS or folders of them, as configured or with --set.

    A single table FILE.csv with --site works as well: columns time (ISO 8601 with its zone), reference_k,
    one NAME_k for each target (or _c), irradiance_w_m2 (direct normal), ghi_w_m2 (global horizontal) or
    illuminance_lx, flags if any.

    With -o all of them go into one table, BASE.csv (and BASE.parquet with fieldkit[lab]), and BASE.json
    says what made it: code, parameters, checksums of the sessions, command line.
    """
    if len(sessions) == 1 and sessions[0].suffix.lower() == ".csv":
        if out is not None:
            raise click.UsageError("-o is for sessions; the slopes of a table are printed: --json > FILE")
        if present or jobs is not None or address is not None:
            raise click.UsageError("--campaign and workers are for sessions; a table takes --site and --set")
        _estimate_table(sessions[0], site, reference, settings)
        return
    _estimate_sessions(find_sessions(ctx, sessions), out, (kind, address, jobs), settings, present=present)


def _estimate_sessions(
    paths: Sequence[Path],
    out: Path | None,
    workers: tuple[str, str | None, int | None],
    settings: Sequence[str],
    *,
    present: bool,
) -> None:
    from fieldkit.cli import batch
    from fieldkit.workflows.batch import run_of
    from fieldkit.workflows.provenance import provenance
    from fieldkit.workflows.sweep import names_of

    base = None if out is None else batch.base_of(out)
    sources, failures = batch.look_at(paths, present=present)
    runs = [run_of(source, settings) for source in sources]
    found: dict[Path, Estimates] = {}
    with batch.workers(*workers, len(runs)) as executor:
        for outcome in batch.carried_out(runs, executor, failures):
            found[outcome.run.source.path] = outcome.estimates
    sources = [source for source in sources if source.path in found]
    names = names_of(sources)
    slopes = {names[source.path]: found[source.path] for source in sources}
    if base is not None and slopes:
        about = {
            **provenance(sources, failures),
            "settings": list(settings),
            "campaign": present,
        }
        written = batch.write_results(base, minute_table(slopes), about)
        common.say(f"wrote {', '.join(map(str, written))}")
    answers = {name: final_estimates(estimates, estimates.regions) for name, estimates in slopes.items()}
    if slopes:
        _print({names[source.path]: str(source.path) for source in sources}, slopes, answers)
    batch.complain(failures, paths)
    _refuse_silence([one for of_session in answers.values() for one in of_session.values()])


def _estimate_table(
    path: Path, site: Site | None, reference: tuple[float, float], settings: Sequence[str]
) -> None:
    """Slopes of a table, over the whole of it unless a window is set."""
    from fieldkit.config import config_from_text
    from fieldkit.workflows.temperature_table import estimate_table

    if site is None:
        raise click.UsageError("a table needs --site LAT,LON,ALT: where it was measured")
    text = f"[site]\nlatitude_deg = {site.latitude_deg}\nlongitude_deg = {site.longitude_deg}\n"
    text += f"elevation_m = {site.elevation_m}\n"
    config = config_from_text(text, path, settings=settings)
    if config.tables.estimator.azimuth == "known":
        raise ConfigError(
            f"{path}: a table names no azimuths, so they cannot be known", fix="leave estimator.azimuth out"
        )
    slopes = estimate_table(path, config.site, config.estimator_settings(), reference_slope_deg=reference)
    if common.options().json:
        common.print_json({"table": str(path), "slopes": [as_document(one) for one in slopes]})
    else:
        targets = [Region(one.region, RegionKind.TARGET, ()) for one in slopes]
        print_slopes({one.region: one for one in slopes}, targets)
        explain_slopes(slopes)
    _refuse_silence(slopes)


def minute_table(slopes: Mapping[str, Estimates]) -> dict[str, list[Any]]:
    """The estimates of several sessions below each other, the session's name in front."""
    table: dict[str, list[Any]] = {}
    for name, estimates in slopes.items():
        columns = estimates.columns()
        for column, values in {"session": [name] * len(estimates), **columns}.items():
            table.setdefault(column, []).extend(values)
    return table


def _print(
    paths: Mapping[str, str],
    slopes: Mapping[str, Estimates],
    answers: Mapping[str, Mapping[str, SlopeEstimate]],
) -> None:
    if common.options().json:
        documents = [_document(paths[name], slopes[name], answers[name]) for name in slopes]
        common.print_json(documents[0] if len(documents) == 1 else {"sessions": documents})
        return
    for name, estimates in slopes.items():
        if len(slopes) > 1:
            click.echo(name)
        print_slopes(answers[name], estimates.regions)
    explain_slopes(one for of_session in answers.values() for one in of_session.values())


def _document(path: str, estimates: Estimates, answers: Mapping[str, SlopeEstimate]) -> dict[str, Any]:
    regions = {region.name: region for region in estimates.regions}
    slopes = [as_document(one, regions[name]) for name, one in answers.items()]
    return {"session": path, "minutes": estimates.minutes, "slopes": slopes}


def _refuse_silence(answers: Sequence[SlopeEstimate]) -> None:
    if not any(one.state in WITH_SLOPE for one in answers):
        reasons = {one.reason or one.state.name.lower() for one in answers} or {"no targets"}
        raise NoAnswerError(f"no slope could be estimated: {', '.join(sorted(reasons))}")
