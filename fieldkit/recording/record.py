"""Record a session: open the instruments, check what would spoil it, record until the end.

`record` does all of it; `prepare` stops before the first sample, for those who attach views or need the
streams first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, time
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.config import Config, find_campaign, load_config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.channels import with_components
from fieldkit.model.device import StreamInfo
from fieldkit.model.durations import as_seconds, rounded_duration, times_of_day
from fieldkit.model.errors import ConfigError, DeviceAccessError
from fieldkit.model.mark_times import moments_of
from fieldkit.model.next_step import Action
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.recorder import Recorder, Summary, View
from fieldkit.recorder.fail_safe import FailSafe
from fieldkit.recorder.recorder import Shown
from fieldkit.recorder.triggers import Triggers
from fieldkit.recording.alarms import alarm_watch
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.last_samples import Included, ask_for_last_samples, left_samples, reach_s
from fieldkit.recording.opening import Instruments, open_instruments
from fieldkit.recording.preflight import Notify, disk_reserve_bytes, log, preflight, sampling_of
from fieldkit.recording.recordings import session_path
from fieldkit.recording.redrawing import Redrawing
from fieldkit.recording.regions import camera_views
from fieldkit.recording.request_reader import RequestReader
from fieldkit.recording.requests import inbox
from fieldkit.recording.running import PREVIEW_ENDS_WITHIN_S, PREVIEW_LOCK_NAME, only_recorder
from fieldkit.recording.status import reported_status
from fieldkit.recording.status_request import feed_path
from fieldkit.recording.stopping import stopped_by_interrupt
from fieldkit.recording.triggers import triggers_of
from fieldkit.results.minutes import keep_recorded
from fieldkit.results.session import Session, open_session
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.lock import await_unlocked
from fieldkit.sessions.writer import SessionWriter
from fieldkit.views import formatting
from fieldkit.views.feed import Feed
from fieldkit.views.latest import Latest
from fieldkit.views.metrics import MetricsFile
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
    split: str = "",
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
    split
        When a session ends and the next begins, without a lost sample: ``"1d"`` at each midnight of the
        site, ``"6h"``, or a time of day such as ``"09:00"``. By default as ``[record]`` has it. What is
        returned is the last session.
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
        split=split,
    )
    views: list[View] = [] if on_minute is None else [MinuteView(on_minute)]
    with prepare(config, options, notify) as prepared, stopped_by_interrupt() as stopping:
        if is_notebook():
            views.append(NotebookLine(prepared.latest()))
        result = prepared.run(views, stopping=stopping)
    result.raise_failure()
    return open_session(result.path)


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """A session that was recorded and sealed: its file, and how the recording went.

    `earlier` are those that came before it in a recording that was split; `was_stopped` if it was asked to
    end, and did not end as planned or by a trigger.
    """

    path: Path
    summary: Summary
    earlier: tuple[RecordedSession, ...] = ()
    was_stopped: bool = False

    def raise_failure(self) -> None:
        """Raise the error that ended the recording, if one did."""
        if self.summary.failure is not None:
            raise self.summary.failure


@dataclass(frozen=True, slots=True)
class PreparedRecording:
    """A recording that can start: instruments open and checked, the session's path chosen."""

    config: Config
    instruments: Instruments
    path: Path
    options: RecordOptions = field(default_factory=RecordOptions)
    duration_s: float | None = None
    begins_ns: int | None = None
    included: Included | None = None
    triggers: Triggers = field(default_factory=Triggers)
    fail_safe: FailSafe | None = None

    def own_views(self) -> Iterator[View]:
        """Views that a recording has besides those that show it."""
        yield self.triggers
        if self.fail_safe is not None:
            yield self.fail_safe
        if path := self.config.tables.record.metrics:
            yield MetricsFile(self.config.directory / Path(path).expanduser(), self.latest())

    def begins_in_s(self) -> float:
        """Seconds until the time at which the recording is to begin; 0 without one, or once it has come."""
        if self.begins_ns is None:
            return 0.0
        return max(0.0, (self.begins_ns - self.instruments.clock.mono_ns()) / SECOND_NS)

    def latest(self) -> Latest:
        """An empty state for views; it ends after the planned duration from now."""
        end_ns = None
        if self.duration_s is not None:
            end_ns = self.instruments.utc_ns() + round(self.duration_s * SECOND_NS)
        return Latest(self.config.site, self.config.regions, self.instruments.streams, self.path.stem, end_ns)

    def starting_now(self) -> PreparedRecording:
        """The same recording, its path named after the present time: call after waiting for the user."""
        return replace(self, path=session_path(self.config, self.options.name, self.instruments.utc_ns()))

    def run(
        self, views: Sequence[View] = (), *, stopping: threading.Event | None = None, command_line: str = ""
    ) -> RecordedSession:
        """Record until the planned end or until `stopping` is set, and seal; call once.

        `command_line` goes into the session's provenance. Raises `StorageError` if nothing can be stored;
        a disk that fills up later is in ``summary.failure``.
        """
        start_ns = self.instruments.clock.mono_ns()
        end_ns = None if self.duration_s is None else start_ns + round(self.duration_s * SECOND_NS)
        stopping = stopping or threading.Event()
        series = _Series(self, views, stopping, command_line, end_ns)
        included = self.included or Included(start_ns, ())
        session = series.begin(self.path, included.start_ns, included)
        # a session is sealed, which takes minutes after a long day, while the next one is recorded
        with ThreadPoolExecutor(thread_name_prefix="seal") as sealing:
            earlier = []
            while session.recorder.record():
                following = series.follow(session)
                sealed = sealing.submit(session.finish, following.path.stem)
                sealed.add_done_callback(following.recorder.note_failure)
                earlier.append(sealed)
                session = following
            last = session.finish()
        all_before = tuple(before.result() for before in earlier)
        return replace(last, earlier=all_before, was_stopped=stopping.is_set())


@dataclass(frozen=True, slots=True)
class _OpenSession:
    """A session while it is recorded, and what exists as long as it does."""

    path: Path
    recorder: Recorder
    requests: RequestReader
    followers: Sequence[View]

    def finish(self, next_session: str = "") -> RecordedSession:
        """Seal it; raises `StorageError`."""
        writer = self.recorder.writer
        try:
            summary = self.recorder.finish(next_session)
        finally:
            writer.abandon()  # no effect after sealing; otherwise the journal is kept for recovery
        try:
            # the first report or check would otherwise estimate the minutes again
            keep_recorded(self.path, self.recorder.estimator)
        except Exception as error:  # the session is sealed: nothing may make its recording look failed
            log.info("the recording's own minutes were not kept: %s", error)
        return RecordedSession(self.path, summary)


class _Series:
    """The sessions of one recording: one, or one after the other where it is split by the time of day.

    Instruments, views and alarms are those of all; regions go on as they were redrawn. Each session has an
    estimator of its own, so that its minutes are those of any later estimate of it.
    """

    def __init__(
        self,
        prepared: PreparedRecording,
        views: Sequence[View],
        stopping: threading.Event,
        command_line: str,
        end_ns: int | None,
    ) -> None:
        config, instruments = prepared.config, prepared.instruments
        self._prepared, self._stopping, self._end_ns = prepared, stopping, end_ns
        self._views = (*views, *prepared.own_views())
        self._header = header_of(config, prepared.options.name, instruments.streams, command_line)
        self._alarms = alarm_watch(config, instruments.streams)
        self._redrawing = Redrawing(config.regions, camera_views(config, instruments.streams), config.site)

    def follow(self, session: _OpenSession) -> _OpenSession:
        """The session that takes over; requests sent to the one before are carried out in it."""
        start_ns = session.recorder.split_ns
        assert start_ns is not None
        prepared = self._prepared
        prepared.instruments.clock.take_anchor()
        time_ns = prepared.instruments.clock.to_utc_ns(start_ns)
        path = session_path(prepared.config, prepared.options.name, time_ns)
        following = self.begin(path, start_ns, previous=session.recorder)
        following.recorder.carry_out(session.requests.close())
        for view in session.followers:  # whose readers look for the session that is recorded
            view.close()
        return following

    def begin(
        self,
        path: Path,
        start_ns: int,
        included: Included | None = None,
        previous: Recorder | None = None,
    ) -> _OpenSession:
        """A session from a time on (monotonic); raises as `SessionWriter`."""
        config, instruments = self._prepared.config, self._prepared.instruments
        regions, clock, triggers = self._redrawing.regions, instruments.clock, self._prepared.triggers
        writer = SessionWriter(path, replace(self._header, regions=regions), clock, start_ns)
        requests = RequestReader(inbox(path), clock, self._redrawing)
        followers = self._followers(path)
        recorder = Recorder(
            devices=instruments.devices,
            reopen=instruments.reopen,
            writer=writer,
            estimator=Estimator(config.site, regions, instruments.streams, config.estimator_settings()),
            clock=clock,
            free_bytes=instruments.free_bytes,
            sampling=sampling_of(config),
            views=(*self._views, *followers),
            end_ns=self._end_ns,
            requests=lambda: chain(requests(), triggers.events()),
            last_requests=lambda: chain(requests.close(), triggers.events()),
            disk_reserve_bytes=disk_reserve_bytes(config),
            alarms=self._alarms,
            stopping=self._stopping,
            earlier=included.samples if included else (),
            readers=included.readers if included else (),
            since_ns=start_ns,
            # by an anchor of its own a session may begin a little before the time of day at which it does
            split_ns=self._split_ns(max(start_ns, clock.mono_ns()) + (MINUTE_NS // 2 if previous else 0)),
            previous=previous,
        )
        triggers.end = recorder.end
        return _OpenSession(path, recorder, requests, followers)

    def _split_ns(self, mono_ns: int) -> int | None:
        """When the next session takes over from one that records now (monotonic); None if none does."""
        clock, config = self._prepared.instruments.clock, self._prepared.config
        utc_ns = clock.to_utc_ns(mono_ns)
        now = formatting.local_time(utc_ns, config.site)
        split = self._prepared.options.split or config.tables.record.split
        waits_ns = [ns_until(moment, now) for moment in times_of_day(split)]
        if not waits_ns:
            return None
        seconds = round((utc_ns + min(waits_ns)) / SECOND_NS)  # local times have microseconds
        split_ns = mono_ns + seconds * SECOND_NS - utc_ns
        return None if self._end_ns is not None and split_ns >= self._end_ns else split_ns

    def _followers(self, path: Path) -> list[View]:
        """Views by which other programs follow the recording, as far as they can be opened."""
        prepared, title = self._prepared, self._header.title
        end_ns = None if self._end_ns is None else prepared.instruments.clock.to_utc_ns(self._end_ns)
        streams, regions = prepared.instruments.streams, self._redrawing.regions
        latest = Latest(prepared.config.site, regions, streams, path.stem, end_ns)
        try:
            return [Feed(feed_path(path), latest, partial(reported_status, path, title, latest))]
        except OSError as error:  # FAT and some network folders have no sockets; requests are files
            log.warning("no other program can follow this recording: %s", error)
            return []


@contextmanager
def prepare(
    config: Config, options: RecordOptions, notify: Notify = log.warning
) -> Iterator[PreparedRecording]:
    """Open a campaign's instruments, check that recording can start, and choose the session's path.

    The settings of `options` are in the configuration already. `notify` receives warnings, also if there are
    no samples of a preview. Raises as `record`.
    """
    duration_s = options.duration_s
    if duration_s == 0.0:
        raise ConfigError("a recording of 0 s holds nothing", fix="choose a duration such as 3h or 90m")
    with ExitStack() as opened:
        if options.include_last_s is not None:
            ask_for_last_samples(config.recordings)
        opened.enter_context(only_recorder(config.recordings))
        await_unlocked(config.recordings, PREVIEW_LOCK_NAME, PREVIEW_ENDS_WITHIN_S)
        left = opened.enter_context(left_samples(config.recordings))
        # a simulated field goes on while its recorder waits
        scene_s = None if options.at or options.on_trigger else duration_s
        instruments = opened.enter_context(
            open_instruments(
                config,
                duration_s=scene_s,
                allow_missing=options.allow_missing,
                simulated_from_ns=left.end_ns if left else None,
            )
        )
        now_ns, now = instruments.clock.mono_ns(), formatting.local_time(instruments.utc_ns(), config.site)
        wait_ns = 0 if options.at is None else ns_until(options.at, now)
        if options.until is not None:
            duration_s = ns_until(options.until, now, wait_ns) / SECOND_NS
        preflight(config, instruments, duration_s, notify)
        last_s = options.include_last_s
        included = left.include(instruments, last_s, notify) if left and last_s else None
        if last_s and included is None:
            notify("no preview of this campaign was running: the recording begins now")
        start_ns = now_ns + wait_ns if included is None else included.start_ns
        path = session_path(config, options.name, instruments.clock.to_utc_ns(start_ns))
        begins_ns = None if options.at is None else now_ns + wait_ns
        triggers = triggers_of(config, instruments.streams, notify)
        if options.on_trigger:
            _check_start(triggers, instruments.streams, notify)
        yield PreparedRecording(
            config, instruments, path, options, duration_s, begins_ns, included, triggers,
            _fail_safe(config, opened),
        )  # fmt: skip


def _check_start(triggers: Triggers, streams: Sequence[StreamInfo], notify: Notify) -> None:
    """Raise `ConfigError` without a trigger that starts; name what memory holds of the time before it."""
    if not triggers.starts:
        fix = 'write [trigger.bright] with do = "start", channel = "lux", above = 20000.0'
        raise ConfigError("no trigger starts a recording", place="trigger", fix=fix)
    reach, longest_s = reach_s(streams), max(trigger.before_s for trigger in triggers.starts)
    if reach < longest_s:
        held = f"memory holds {rounded_duration(reach)} of these instruments"
        notify(f"{held}: a trigger cannot include the {rounded_duration(longest_s)} before it")


def _fail_safe(config: Config, opened: ExitStack) -> FailSafe | None:
    """The fail-safe output, until `opened` ends; raises `DeviceAccessError`."""
    table = config.tables.fail_safe
    if not (table.line or table.command):
        return None
    try:
        return opened.enter_context(closing(FailSafe(table.line, table.command)))
    except OSError as error:
        problem = f"cannot be held: {error}"
        raise DeviceAccessError(problem, place="fail_safe.line", fix=Action.DOCTOR()) from error


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


def ns_until(time_of_day: time, now: datetime, after_ns: int = 0) -> int:
    """Nanoseconds from `after_ns` after now, to the next time at which clocks show `time_of_day`.

    `now` has the zone of the clocks.
    """
    # by timestamps: local times differ by an hour more or less where clocks change in between
    begin_s = now.timestamp() + after_ns / SECOND_NS
    moments = moments_of(time_of_day, datetime.fromtimestamp(begin_s, now.tzinfo))
    return round(next(s for moment in moments if (s := moment.timestamp() - begin_s) > 0.0) * SECOND_NS)


def header_of(config: Config, title: str, streams: Sequence[StreamInfo], command_line: str) -> SessionHeader:
    """Header of the session, known before its first sample."""
    campaign, sampling = config.tables.campaign, sampling_of(config)
    burst_frames = sampling.burst_frames if sampling.every_s else 0
    declared = [with_components(info, config.tables.irradiance.measures) for info in streams]
    return SessionHeader(
        title=title or campaign.title,
        site=config.site,
        streams=tuple(replace(info, burst_frames=burst_frames * info.is_camera) for info in declared),
        regions=config.regions,
        config_toml=config.to_toml(),
        command_line=command_line,
        operator=campaign.operator,
        description=campaign.description,
        license=campaign.license,
        references=campaign.references,
    )
