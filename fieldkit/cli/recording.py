"""Shared by the commands that record: the live view on stderr, and signals that stop and seal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from fieldkit.cli import common
from fieldkit.recording.stopping import stop_on_signals

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.recorder import View
    from fieldkit.recording.opening import Instruments
    from fieldkit.recording.record import PreparedRecording, RecordedSession
    from fieldkit.views.terminal_view import ThemeName


def run_until_stopped(prepared: PreparedRecording, views: Sequence[View]) -> RecordedSession:
    """Record until the planned end or a signal, which seals the session; a second one stops at once."""
    from fieldkit.results.result_files import command_line
    from fieldkit.views.service_manager import RecordingReports, is_expected

    if is_expected():
        views = [*views, RecordingReports()]
    with stop_on_signals() as stopping:  # from before there is anything that must be sealed
        try:
            return prepared.run(views, stopping=stopping, command_line=command_line())
        except KeyboardInterrupt:
            common.say(f"\nstopped at once; the journal is kept. next: fieldkit recover {prepared.path}")
            raise


def live_views(prepared: PreparedRecording, theme: ThemeName = "dark") -> list[View]:
    """The live view of a recording on stderr; none with ``--quiet`` or ``--json``."""
    return terminal_views(
        prepared.config, prepared.instruments, prepared.path.stem, prepared.duration_s, theme
    )


def terminal_views(
    config: Config, instruments: Instruments, title: str, duration_s: float | None, theme: ThemeName
) -> list[View]:
    """The live view on stderr, none with ``--quiet`` or ``--json``."""
    from fieldkit.recording.alarms import least_sent
    from fieldkit.views.latest import Latest
    from fieldkit.views.terminal_view import terminal_view

    chosen = common.options()
    if chosen.quiet or chosen.json:
        return []
    end_ns = None if duration_s is None else instruments.utc_ns() + round(duration_s * 1e9)
    latest = Latest(config.site, config.regions, instruments.streams, title, end_ns)
    bell_from = least_sent(config) if config.tables.alarms.bell else None
    return [terminal_view(latest, common.console(err=True), theme=theme, bell_from=bell_from)]
