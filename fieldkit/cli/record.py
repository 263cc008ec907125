"""``fieldkit record``: preflight, then a session until the planned end or Ctrl-C."""

from __future__ import annotations

import re
import shlex
from datetime import timedelta
from typing import TYPE_CHECKING, Literal

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import offer_recovery, sessions_in
from fieldkit.views import formatting

if TYPE_CHECKING:
    from pathlib import Path

    from fieldkit.cli.recording import Instruments
    from fieldkit.config import Config
    from fieldkit.model.clock import Clock
    from fieldkit.model.site import Site
    from fieldkit.recorder import Summary, View

SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}
BELOW = {"": "s", "m": "s", "h": "m"}
"""The unit of a bare number, by the unit in front of it."""


@click.command(cls=common.Verb)
@click.option("--name", default="", metavar="NAME", help="Goes into the file's name.")
@click.option("--for", "lasting", metavar="TIME", help="How long: 3h, 90m, 45s.")
@click.option("--until", metavar="HH:MM", help="When to stop, in the site's time zone.")
@click.option("--allow-missing", is_flag=True, help="Record without instruments that are not plugged in.")
@click.option(
    "--theme", type=click.Choice(["dark", "paper"]), default="dark", help="paper: readable in the sun."
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    name: str,
    lasting: str | None,
    until: str | None,
    allow_missing: bool,
    theme: Literal["dark", "paper"],
    settings: tuple[str, ...],
) -> None:
    """Record a session of this campaign; Ctrl-C stops and seals it, a second one stops at once."""
    from fieldkit.cli.preflight import preflight
    from fieldkit.cli.recording import instruments, record_session, session_path
    from fieldkit.cli.running import only_recorder

    if lasting and until:
        raise click.UsageError("give --for or --until, not both")
    config = common.campaign(ctx, settings)
    duration_s = None if lasting is None else parse_duration(lasting)
    with (
        only_recorder(config.recordings),
        instruments(config, duration_s=duration_s, allow_missing=allow_missing) as tools,
    ):
        offer_recovery(sessions_in(config.recordings))
        if until is not None:
            duration_s = seconds_until(until, config.site, tools.clock)
        preflight(config, tools, duration_s)
        path = session_path(config, name, tools.clock.to_utc_ns(tools.clock.mono_ns()))
        views = live_views(config, tools, path.stem, duration_s, theme)
        common.say(f"recording {path.stem}     Ctrl-C stops and seals")
        summary = record_session(config, tools, path, title=name, duration_s=duration_s, views=views)
    tell(path, summary)
    if summary.failure is not None:
        raise summary.failure


def live_views(
    config: Config, tools: Instruments, title: str, duration_s: float | None, theme: Literal["dark", "paper"]
) -> list[View]:
    """The live view on stderr, none with ``--quiet`` or ``--json``."""
    from fieldkit.views.terminal_view import terminal_view

    given = common.options()
    if given.quiet or given.json:
        return []
    now_ns = tools.clock.to_utc_ns(tools.clock.mono_ns())
    end_ns = None if duration_s is None else now_ns + round(duration_s * 1e9)
    console = common.console(err=True)
    return [
        terminal_view(
            config.site,
            config.regions,
            tools.streams,
            title=title,
            planned_end_ns=end_ns,
            console=console,
            theme=theme,
        )
    ]


def tell(path: Path, summary: Summary) -> None:
    """What was recorded, and what to do next."""
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


def parse_duration(text: str) -> float:
    """Seconds of ``3h``, ``90m``, ``45s``, ``2h30m`` or ``2h30``; raises `click.UsageError`."""
    if not text or not re.fullmatch(r"(\d+(\.\d+)?[hms])+((?<!s)\d+(\.\d+)?)?", text):
        raise click.UsageError(f"{text!r} is not a valid duration; give it with its unit: 3h, 90m or 45s")
    total, above = 0.0, ""
    for number, unit in re.findall(r"(\d+(?:\.\d+)?)([hms]?)", text):
        total += float(number) * SECONDS[unit or BELOW[above]]
        above = unit
    return total


def seconds_until(text: str, site: Site, clock: Clock) -> float:
    """Seconds from now to the next time the site's clocks show ``HH:MM``; raises `click.UsageError`."""
    now = formatting.local_time(clock.to_utc_ns(clock.mono_ns()), site)
    try:
        hour, minute = (int(part) for part in text.split(":"))
        end = now.replace(hour=hour, minute=minute, second=0, microsecond=0)
    except ValueError as error:
        raise click.UsageError(f"{text!r} is no time of day; write one like 15:05") from error
    if end <= now:
        end += timedelta(days=1)
    return end.timestamp() - now.timestamp()  # what clocks show differs by an hour when they are changed
