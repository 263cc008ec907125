"""``fieldkit record``: record a session until the planned end or Ctrl-C."""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.page import LOOPBACK, page_beside
from fieldkit.cli.recording import live_views, run_until_stopped, terminal_views
from fieldkit.cli.session_paths import report_interrupted
from fieldkit.cli.types import DURATION, HOUR
from fieldkit.model.durations import rounded_duration
from fieldkit.recording.recordings import sessions_in
from fieldkit.recording.stopping import stop_on_signals
from fieldkit.results.json_document import learnt_document

if TYPE_CHECKING:
    from datetime import time

    from fieldkit.config import Config
    from fieldkit.recording.background import RecordOptions
    from fieldkit.recording.record import PreparedRecording, RecordedSession
    from fieldkit.views.terminal_view import ThemeName


# all options but --detach, --page and --theme are fields of `RecordOptions`
@click.command(cls=common.Command)
@click.option("--name", default="", metavar="NAME", help="Part of the file name.")
@click.option("--for", "duration_s", type=DURATION, metavar="TIME", help="Duration: 3h, 90m, 45s.")
@click.option(
    "--at",
    type=HOUR,
    metavar="TIME",
    help="Time of day to begin, such as 11:30, in the site's zone; until then the instruments are shown.",
)
@click.option(
    "--until",
    type=HOUR,
    metavar="TIME",
    help="Time of day to stop, such as 15:05, in the site's zone.",
)
@click.option(
    "--include-last",
    "include_last_s",
    type=DURATION,
    help="Begin with what fieldkit live or the field page has shown last, such as 2m, as far as it has it.",
)
@click.option(
    "--on-trigger",
    is_flag=True,
    help="Wait for a trigger of fieldkit.toml to start, and after it for the next.",
)
@click.option("--detach", is_flag=True, help="Record in the background, beyond the end of this terminal.")
@click.option(
    "--split",
    default="",
    metavar="WHEN",
    help="End a session and begin the next every 1d or 6h from the site's midnight on, or at 09:00.",
)
@click.option(
    "--allow-missing", is_flag=True, help="Record without instruments that are not plugged in or hang."
)
@click.option(
    "--page",
    "page_address",
    is_flag=False,
    flag_value=LOOPBACK,
    metavar="[ADDRESS]",
    help=f"Show the recording on the field page, at this address [{LOOPBACK}], not in this terminal.",
)
@click.option("--options", "as_json", hidden=True, help="All of these as one JSON object.")
@common.theme_option
@common.set_option
def command(
    detach: bool, page_address: str | None, as_json: str | None, theme: ThemeName, **stated: Any
) -> None:
    """Record a session of this campaign; Ctrl-C stops and seals it, a second one stops at once."""
    from fieldkit.recording.background import RecordOptions

    options = RecordOptions(**stated) if as_json is None else RecordOptions.model_validate_json(as_json)
    if options.duration_s is not None and options.until is not None:
        raise click.UsageError("give --for or --until, not both")
    if options.include_last_s is not None and options.at is not None:
        raise click.UsageError("give --at or --include-last, not both; an earlier --at records the same")
    if options.on_trigger and (options.at or options.include_last_s):
        raise click.UsageError(
            "--on-trigger begins at its time and with what was before: omit the other option"
        )
    config = common.campaign(options.settings)
    report_interrupted(sessions_in(config.recordings))
    if detach and page_address is not None:
        raise click.UsageError("--page ends with this terminal; fieldkit page shows a detached recording")
    if detach:
        _detach(config, options)
        return
    record = partial(_record, config, options, theme, page_address, as_json is not None)
    session = record()
    while session and options.on_trigger and not (session.was_stopped or session.summary.failure):
        print_summary(session)
        session = record(again=True)
    if session is None:
        common.say("called off: nothing more was recorded")
        return
    print_summary(session)
    session.raise_failure()


def _record(
    config: Config, options: RecordOptions, theme: ThemeName, page: str | None, log: bool, again: bool = False
) -> RecordedSession | None:
    """Record a session, `again` only after the trigger's condition was over; None if that was called off.

    With `log` its messages go to a file beside it.
    """
    from fieldkit.recording.background import keep_messages
    from fieldkit.recording.record import prepare

    with prepare(config, options, common.say_warning) as prepared:
        if again:
            prepared.triggers.rearm()
        if options.at is not None or options.on_trigger:
            begun = _wait(prepared, options.at, theme)
            if begun is None:
                return None
            prepared = begun
        if log:
            keep_messages(prepared.path)
        common.say(f"recording {prepared.path.stem}     Ctrl-C stops and seals")
        views = [] if page else live_views(prepared, theme)  # whose screen would hide the links
        with page_beside(config, page, options.settings):
            return run_until_stopped(prepared, views)


def _wait(prepared: PreparedRecording, at: time | None, theme: ThemeName) -> PreparedRecording | None:
    """Show the instruments until the recording is to begin; None if that was called off."""
    from fieldkit.recording.last_samples import reach_s
    from fieldkit.recording.preview import await_begin

    held = rounded_duration(reach_s(prepared.instruments.streams))
    causes = " or ".join(trigger.text for trigger in prepared.triggers.starts)
    moment = f"at {at:%H:%M}" if at else f"with {causes}; memory holds the last {held}"
    wait_s, title = prepared.begins_in_s() if at else None, f"waiting, not recorded; begins {moment}"
    common.say(f"the instruments are ready; recording begins {moment}     Ctrl-C calls it off")
    views = terminal_views(prepared.config, prepared.instruments, title, wait_s, theme)
    with stop_on_signals() as stopping:
        return await_begin(prepared, views, stopping)


def _detach(config: Config, options: RecordOptions) -> None:
    """Begin a recording in a process of its own, and return once it records or waits for its time."""
    from fieldkit.recording.background import BackgroundRecording

    recorder = BackgroundRecording(config.directory, options)
    try:
        session = recorder.await_start(config)
        for line in recorder.warnings():
            common.say(line)
    finally:
        recorder.forget()
    common.print_if_json({"session": None if session is None else str(session), "process": recorder.pid})
    what = "waits for its time or trigger" if session is None else f"recording {session.stem}"
    common.say(f"{what} in the background (process {recorder.pid})")
    common.say("next: fieldkit status  |  fieldkit page  |  fieldkit stop")


def print_summary(session: RecordedSession) -> None:
    """Print what was recorded, and what to do next."""
    from fieldkit.results.estimate import as_document
    from fieldkit.views import formatting

    path, summary = session.path, session.summary
    estimates = summary.last_minute.estimates if summary.last_minute else ()
    learnt = summary.last_minute.learnt if summary.last_minute else None
    if common.print_if_json(
        {
            "session": str(path),
            "earlier_sessions": [str(earlier.path) for earlier in session.earlier],
            "counts": summary.counts,
            "dropped": summary.dropped,
            "bytes": path.stat().st_size,
            "estimates": [as_document(slope) for slope in estimates],
            "learnt": learnt_document(learnt),
        }
    ):
        return
    for part in (*session.earlier, session):
        counts = ", ".join(f"{count} {stream}" for stream, count in part.summary.counts.items())
        lost = sum(part.summary.dropped.values())
        size = f"{part.path.stat().st_size / 1e6:.1f} MB"
        common.say(f"sealed {part.path}   {size}   {counts}" + (f", {lost} lost" if lost else ""))
    if words := formatting.findings(estimates):
        common.say(words)
    quoted_path = shlex.quote(str(path))
    common.say(f"next: fieldkit check {quoted_path}  |  fieldkit report {quoted_path}")
