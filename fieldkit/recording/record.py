"""Record a session: open the instruments, check what would spoil it, record until the end.

`record` does all of it; `prepare` stops before the first sample, for those who attach views or need the
streams first.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from datetime import time
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.config import Config, find_campaign, load_config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.channels import with_components
from fieldkit.model.device import StreamInfo, frame_shapes
from fieldkit.model.durations import as_seconds
from fieldkit.model.mark_times import moments_of
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.recorder import Recorder, Summary, View
from fieldkit.recorder.recorder import Shown
from fieldkit.recording.alarms import alarm_watch
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.last_samples import Included, ask_for_last_samples, left_samples
from fieldkit.recording.opening import Instruments, open_instruments
from fieldkit.recording.preflight import Notify, disk_reserve_bytes, log, preflight, sampling_of
from fieldkit.recording.recordings import session_path
from fieldkit.recording.redrawing import Redrawing
from fieldkit.recording.request_reader import RequestReader, StatusServer
from fieldkit.recording.requests import inbox
from fieldkit.recording.running import await_preview_end, only_recorder
from fieldkit.results.minutes import keep_recorded
from fieldkit.results.session import Session, open_session
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.writer import SessionWriter
from fieldkit.views import formatting
from fieldkit.views.feed import Feed, feed_path
from fieldkit.views.latest import Latest
from fieldkit.views.terminal_view import NotebookLine, is_notebook

if TYPE_CHECKING:
    from fieldkit.recording.campaign import Campaign


def record(
    campaign: Campaign | Config | str | Path = ".",
    *,
    duration: str | float | None = None,
    name: str = "",
    include_last: str | float | None = None,
    allow_missing: bool = False,
    on_minute: Callable[[Minute], None] | None = None,
    notify: Notify = log.warning,
) -> Session:
    """Record a session of a campaign and seal it; the session, open for reading.

    In a notebook a line below the cell shows time, slopes and alarms meanwhile.

    An interrupt (Ctrl-C, "stop" of a notebook) ends the recording, which is sealed and returned as at its
    planned end. A second one raises `KeyboardInterrupt` at once and keeps the journal, from which
    ``fieldkit recover`` finishes the session. In a thread, or with a handler of SIGINT of your own, nothing
    is changed: `KeyboardInterrupt` keeps the journal.

    Parameters
    ----------
    campaign
        A campaign, its configuration, or a path in its folder.
    duration
        When to stop: ``"20m"``, ``"2h30"``, or a number of seconds. Without it, until interrupted.
    name
        Part of the file's name.
    include_last
        Begin with what a preview of this campaign (`live`, the field page) has shown last, such as
        ``"2m"``, as far as it still has it.
    allow_missing
        Record without instruments that are not plugged in, or whose driver hangs.
    on_minute
        Called with each minute as it closes, from the recording thread; it must return at once. If it
        raises, it is not called again and the recording goes on.
    notify
        Receives warnings, such as of calibrations that are too old.

    Raises
    ------
    ConfigError
        No instruments are configured, or a region lies outside the frame.
    DeviceError
        An instrument cannot be opened.
    RefusedError
        The campaign is being recorded already.
    StorageError
        The disk is too small, cannot be written, or filled up; in the last case the session is sealed.

    Examples
    --------
    >>> session = fieldkit.record(campaign, duration="2m", name="short")
    >>> session.name, session.count("thermometer")
    ('20160101T190001Z-short', 121)
    """
    config = config_of(campaign)
    options = RecordOptions(
        name=name,
        duration_s=None if duration is None else as_seconds(duration),
        include_last_s=None if include_last is None else as_seconds(include_last),
        allow_missing=allow_missing,
    )
    views: list[View] = [] if on_minute is None else [MinuteView(on_minute)]
    with prepare(config, options, notify) as prepared, _stopped_by_interrupt() as stopping:
        if is_notebook():
            views.append(NotebookLine(prepared.latest()))
        result = prepared.run(views, stopping=stopping)
    if result.summary.failure is not None:
        raise result.summary.failure
    return open_session(result.path)


@contextmanager
def _stopped_by_interrupt() -> Iterator[threading.Event]:
    """An event that the first interrupt sets, where Python alone would raise `KeyboardInterrupt`."""
    stopping = threading.Event()
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield stopping
        return

    def stop(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        stopping.set()

    signal.signal(signal.SIGINT, stop)
    try:
        yield stopping
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """A session that was recorded and sealed: its file, and how the recording went."""

    path: Path
    summary: Summary


@dataclass(frozen=True, slots=True)
class PreparedRecording:
    """A recording that can start: instruments open and checked, the session's path chosen."""

    config: Config
    instruments: Instruments
    path: Path
    name: str = ""
    duration_s: float | None = None
    begins_ns: int | None = None
    included: Included | None = None

    def begins_in_s(self) -> float:
        """Seconds until the time at which the recording is to begin; 0 without one, or once it has come."""
        if self.begins_ns is None:
            return 0.0
        return max(0.0, (self.begins_ns - self.instruments.clock.mono_ns()) / SECOND_NS)

    def latest(self, planned_end_ns: int | None = None) -> Latest:
        """An empty state for views; by default it ends after the planned duration from now."""
        if planned_end_ns is None and self.duration_s is not None:
            planned_end_ns = self.instruments.utc_ns() + round(self.duration_s * SECOND_NS)
        config, streams = self.config, self.instruments.streams
        return Latest(config.site, config.regions, streams, self.path.stem, planned_end_ns)

    def starting_now(self) -> PreparedRecording:
        """The same recording, its path named after the present time: call after waiting for the user."""
        return replace(self, path=session_path(self.config, self.name, self.instruments.utc_ns()))

    def run(
        self, views: Sequence[View] = (), *, stopping: threading.Event | None = None, command_line: str = ""
    ) -> RecordedSession:
        """Record until the planned end or until `stopping` is set, and seal; call once.

        `command_line` goes into the session's provenance. Raises `StorageError` if nothing can be stored;
        a disk that fills up later is in ``summary.failure``.
        """
        config, instruments = self.config, self.instruments
        alarms = alarm_watch(config, instruments.streams)
        start_ns = instruments.clock.mono_ns()
        header = header_of(config, self.name, instruments.streams, command_line)
        included = self.included or Included(start_ns, iter(()))
        writer = SessionWriter(self.path, header, instruments.clock, included.start_ns)
        redrawing = Redrawing(config.regions, frame_shapes(instruments.streams), config.site)
        requests = RequestReader(inbox(self.path), instruments.clock, redrawing)
        estimator = Estimator(config.site, config.regions, instruments.streams, config.estimator_settings())
        end_ns = None if self.duration_s is None else start_ns + round(self.duration_s * SECOND_NS)
        try:
            summary = Recorder(
                devices=instruments.devices,
                reopen=instruments.reopen,
                writer=writer,
                estimator=estimator,
                clock=instruments.clock,
                free_bytes=instruments.free_bytes,
                sampling=sampling_of(config),
                views=(*views, *self._views_of_followers(end_ns, header.title)),
                end_ns=end_ns,
                requests=requests,
                last_requests=requests.close,
                disk_reserve_bytes=disk_reserve_bytes(config),
                alarms=alarms,
                stopping=stopping or threading.Event(),
                earlier=included.samples,
            ).run()
        finally:
            writer.abandon()  # no effect after sealing; otherwise the journal is kept for recovery
        self._keep(estimator)
        return RecordedSession(self.path, summary)

    def _keep(self, estimator: Estimator) -> None:
        """Leave the minutes to the first report or check, which otherwise estimates them again."""
        try:
            keep_recorded(self.path, estimator)
        except Exception as error:  # the session is sealed: nothing may make its recording look failed
            log.info("the recording's own minutes were not kept: %s", error)

    def _views_of_followers(self, end_ns: int | None, title: str) -> list[View]:
        """Views by which other programs follow the recording, as far as they can be opened."""
        latest = self.latest(None if end_ns is None else self.instruments.clock.to_utc_ns(end_ns))
        offered: list[View] = []
        for offer in (
            lambda: Feed(feed_path(journal_path(self.path)), latest),
            lambda: StatusServer(self.path, title, latest),
        ):
            try:
                offered.append(offer())
            except OSError as error:
                log.warning("no other program can follow this recording: %s", error)
        return offered


@contextmanager
def prepare(
    config: Config, options: RecordOptions, notify: Notify = log.warning
) -> Iterator[PreparedRecording]:
    """Open a campaign's instruments, check that recording can start, and choose the session's path.

    The settings of `options` are in the configuration already. `notify` receives warnings, also if there are
    no samples of a preview. Raises as `record`.
    """
    duration_s = options.duration_s
    with ExitStack() as opened:
        if options.include_last_s is not None:
            ask_for_last_samples(config.recordings)
        opened.enter_context(only_recorder(config.recordings))
        await_preview_end(config.recordings)
        left = opened.enter_context(left_samples(config.recordings))
        scene_s = None if options.at else duration_s  # a simulated field goes on while its recorder waits
        instruments = opened.enter_context(
            open_instruments(
                config,
                duration_s=scene_s,
                allow_missing=options.allow_missing,
                simulated_from_ns=left.end_ns if left else None,
            )
        )
        now_ns, utc_ns = instruments.clock.mono_ns(), instruments.utc_ns()
        wait_ns = 0 if options.at is None else ns_until(options.at, config.site, utc_ns)
        if options.until is not None:
            duration_s = ns_until(options.until, config.site, utc_ns + wait_ns) / SECOND_NS
        preflight(config, instruments, duration_s, notify)
        last_s = options.include_last_s
        included = left.include(instruments, last_s, notify) if left and last_s else None
        if last_s and included is None:
            notify("no preview of this campaign was running: the recording begins now")
        start_ns = now_ns + wait_ns if included is None else included.start_ns
        path = session_path(config, options.name, instruments.clock.to_utc_ns(start_ns))
        begins_ns = None if options.at is None else now_ns + wait_ns
        yield PreparedRecording(config, instruments, path, options.name, duration_s, begins_ns, included)


def config_of(campaign: Campaign | Config | str | Path) -> Config:
    """The configuration of a campaign given as an object or as a path in its folder."""
    if isinstance(campaign, str | Path):
        return load_config(find_campaign(Path(campaign)))
    return campaign if isinstance(campaign, Config) else campaign.config


class MinuteView:
    """A view that calls a function with every minute that closes."""

    def __init__(self, on_minute: Callable[[Minute], None]) -> None:
        self._on_minute = on_minute

    def show(self, item: Shown) -> None:
        """Pass a minute on; ignore anything else."""
        if isinstance(item, Minute):
            self._on_minute(item)

    def close(self) -> None:
        """Nothing to close."""


def ns_until(time_of_day: time, site: Site, utc_ns: int) -> int:
    """Nanoseconds from a time to the next one at which the site's clocks show `time_of_day`."""
    now = formatting.local_time(utc_ns, site)
    # by timestamps: local times differ by an hour more or less where clocks change in between
    left_s = [moment.timestamp() - now.timestamp() for moment in moments_of(time_of_day, now)]
    return round(next(wait_s for wait_s in left_s if wait_s > 0.0) * SECOND_NS)


def header_of(config: Config, title: str, streams: Sequence[StreamInfo], command_line: str) -> SessionHeader:
    """Header of the session, known before its first sample."""
    campaign = config.campaign
    return SessionHeader(
        title=title or campaign.title,
        site=config.site,
        streams=tuple(with_components(info, config.tables.irradiance.measures) for info in streams),
        regions=config.regions,
        config_toml=config.to_toml(),
        command_line=command_line,
        operator=campaign.operator,
        description=campaign.description,
        license=campaign.license,
        references=campaign.references,
    )
