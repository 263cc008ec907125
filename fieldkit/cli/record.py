"""``fieldkit record``: record a session until the planned end or Ctrl-C."""

from __future__ import annotations

import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import report_interrupted
from fieldkit.cli.types import DURATION, TIME_OF_DAY
from fieldkit.workflows.recordings import sessions_in

if TYPE_CHECKING:
    from datetime import time
    from pathlib import Path

    from fieldkit.config import Config
    from fieldkit.recorder import Summary, View
    from fieldkit.workflows.opening import Instruments
    from fieldkit.workflows.record import PreparedRecording, RecordedSession


@click.command(cls=common.Command)
@click.option("--name", default="", metavar="NAME", help="Part of the file name.")
@click.option("--for", "duration_s", type=DURATION, metavar="TIME", help="Duration: 3h, 90m, 45s.")
@click.option(
    "--until", type=TIME_OF_DAY, metavar="HH:MM", help="Time of day to stop, in the site's time zone."
)
@click.option("--allow-missing", is_flag=True, help="Record without instruments that are not plugged in.")
@click.option(
    "--theme",
    type=click.Choice(["dark", "paper"]),
    default="dark",
    help="Colours; paper is readable in sunlight.",
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    name: str,
    duration_s: float | None,
    until: time | None,
    allow_missing: bool,
    theme: Literal["dark", "paper"],
    settings: tuple[str, ...],
) -> None:
    """Record a session of this campaign; Ctrl-C stops and seals it, a second one stops at once."""
    from fieldkit.workflows.record import prepare

    if duration_s is not None and until is not None:
        raise click.UsageError("give --for or --until, not both")
    config = common.campaign(ctx, settings)
    report_interrupted(sessions_in(config.recordings))
    with prepare(
        config,
        name=name,
        duration_s=duration_s,
        until=until,
        allow_missing=allow_missing,
        notify=common.say_warning,
    ) as prepared:
        common.say(f"recording {prepared.path.stem}     Ctrl-C stops and seals")
        summary = run_until_stopped(prepared, live_views(prepared, theme)).summary
    print_summary(prepared.path, summary)
    if summary.failure is not None:
        raise summary.failure


def run_until_stopped(prepared: PreparedRecording, views: Sequence[View]) -> RecordedSession:
    """Record until the planned end or a signal, which seals the session; a second Ctrl-C stops at once."""
    with stop_on_signals() as stopping:  # from before there is anything that must be sealed
        try:
            return prepared.run(
                views, stopping=stopping, command_line=shlex.join(["fieldkit", *sys.argv[1:]])
            )
        except KeyboardInterrupt:
            common.say(f"\nstopped at once; the journal is kept. next: fieldkit recover {prepared.path}")
            raise


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set; a second Ctrl-C raises `KeyboardInterrupt`."""
    stopping = threading.Event()

    def stop(number: int, frame: object) -> None:
        if number == signal.SIGINT:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        stopping.set()

    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, stop) for number in signals}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def live_views(prepared: PreparedRecording, theme: Literal["dark", "paper"] = "dark") -> list[View]:
    """The live view of a recording on stderr; none with ``--quiet`` or ``--json``."""
    return terminal_views(
        prepared.config, prepared.instruments, prepared.path.stem, prepared.duration_s, theme
    )


def terminal_views(
    config: Config,
    instruments: Instruments,
    title: str,
    duration_s: float | None,
    theme: Literal["dark", "paper"],
) -> list[View]:
    """The live view on stderr, none with ``--quiet`` or ``--json``."""
    from fieldkit.views.terminal_view import terminal_view

    given = common.options()
    if given.quiet or given.json:
        return []
    now_ns = instruments.utc_ns()
    end_ns = None if duration_s is None else now_ns + round(duration_s * 1e9)
    console = common.console(err=True)
    return [
        terminal_view(
            config.site,
            config.regions,
            instruments.streams,
            title=title,
            planned_end_ns=end_ns,
            console=console,
            theme=theme,
        )
    ]


def print_summary(path: Path, summary: Summary) -> None:
    """Print what was recorded, and what to do next."""
    estimates = summary.last_minute.estimates if summary.last_minute else ()
    if common.options().json:
        common.print_json(
            {
                "session": str(path),
                "counts": summary.counts,
                "dropped": summary.dropped,
                "bytes": path.stat().st_size,
                "estimates": [
                    {"region": one.region, "state": one.state.name.lower(), "tilt_deg": one.tilt_deg,
                     "azimuth_deg": one.azimuth_deg}
                    for one in estimates
                ],
            }
        )  # fmt: skip
        return
    counts = ", ".join(f"{count} {stream}" for stream, count in summary.counts.items())
    lost = sum(summary.dropped.values())
    common.say(
        f"sealed {path}   {path.stat().st_size / 1e6:.1f} MB   {counts}" + (f", {lost} lost" if lost else "")
    )
    named = shlex.quote(str(path))
    common.say(f"next: fieldkit check {named}  |  fieldkit report {named}")
