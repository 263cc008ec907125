"""``fieldkit demo``: run the whole experiment on simulated devices, then write its report."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.recording import live_views, run_until_stopped
from fieldkit.cli.slope_table import explain_slopes, print_slopes
from fieldkit.cli.types import PATH
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.slope import final_estimates
from fieldkit.views import formatting

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.estimation.estimator import Minute
    from fieldkit.model.site import Region

SCENE_S = 3 * 3600.0
PACE = 900
"""Scene seconds per real second at most, to watch; ``--fast`` runs as fast as the computer can."""


@click.command(cls=common.Command)
@click.option("--fast", is_flag=True, help="Run as fast as possible; the numbers do not change.")
@click.option("--fault", type=click.Choice([kind.value for kind in FaultKind]), help="Simulate a fault.")
@click.option("-o", "--out", type=PATH, default=Path("demo"), show_default=True, help="Campaign folder.")
def command(fast: bool, fault: str | None, out: Path) -> None:
    """Run the whole experiment on simulated devices under one measured day of weather, then report."""
    from fieldkit.recording.background import RecordOptions
    from fieldkit.recording.record import MinuteView, prepare
    from fieldkit.recording.simulate import demo_campaign
    from fieldkit.results.report import report as write_report

    began = time.monotonic()
    folder = (common.options().directory or Path()) / out
    config = demo_campaign(folder, speed="max" if fast else PACE, fault=fault)
    _introduce(config, fault)
    minutes: list[Minute] = []
    with prepare(config, RecordOptions(name="demo", duration_s=SCENE_S), common.say_warning) as prepared:
        path = run_until_stopped(prepared, [*live_views(prepared), MinuteView(minutes.append)]).path
    common.say("writing the report")
    report = write_report(path, config.reports / f"{path.stem}.html", notify=common.say_warning).path
    _conclude(path, report, minutes, config.regions, time.monotonic() - began)


def _introduce(config: Config, fault: str | None) -> None:
    beds = "   ".join(f"{region.name} {formatting.given_slope(region)}" for region in config.regions)
    drivers = "   ".join(f"{device.name} {device.driver}" for device in config.devices)
    seed = config.tables.simulation.seed if config.tables.simulation else 0
    common.say(
        f"fieldkit demo: sand slopes under the sky of Alamosa, 2016-01-01, on simulated devices (seed {seed})"
    )
    common.say(f"  {drivers}\n  site {formatting.place(config.site)}   beds  {beds}")
    if fault is not None:
        common.say(f"  with a fault: {fault}")


def _conclude(
    path: Path, report: Path, minutes: Sequence[Minute], regions: Sequence[Region], took_s: float
) -> None:
    from fieldkit.results.estimate import as_document, estimate, estimates_of
    from fieldkit.views.report.assessment import mean_error, truths_held
    from fieldkit.views.report.series import series

    slopes, columns = final_estimates(estimates_of(minutes), regions), series(minutes, regions)
    error_deg = mean_error(columns)
    by_name = {region.name: region for region in regions}
    documents = [as_document(slope, by_name[name]) for name, slope in slopes.items()]
    files = {"session": str(path), "report": str(report)}
    if common.print_if_json({**files, "slopes": documents, "mean_tilt_error_deg": error_deg}):
        return
    common.say(f"done in {took_s:.0f} s")
    learnt = minutes[-1].learnt if minutes else None
    print_slopes(slopes, regions, learnt, estimate(path).checks)
    explain_slopes(slopes.values())
    click.echo(truths_held(columns))
    click.echo(f"session  {path}\nreport   {report}")
    quoted_path = shlex.quote(str(path))
    common.say(
        f"next: fieldkit show {quoted_path}  |  fieldkit replay {quoted_path}  |  fieldkit init my-campaign"
    )
