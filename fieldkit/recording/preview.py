"""Preview: what the instruments measure now, without recording.

`live` shows samples, minutes and slopes to views as a recording would; `usable_frame` reads one frame; a
recorder that waits for its time shows its instruments by `await_begin`.
"""

from __future__ import annotations

import collections
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.config import Config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.device import Camera, StreamInfo, regions_on
from fieldkit.model.durations import as_seconds
from fieldkit.model.errors import DeviceNotFoundError, DeviceTimeoutError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, Frame, Health, Reading, Sample, StreamHealth, is_showable
from fieldkit.recorder import EstimatorThread, SampleQueue, Sampling, View
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.recorder.estimator_thread import LONGEST_WAIT_S
from fieldkit.recording.last_samples import Included, LastSamples, SampleRing
from fieldkit.recording.opening import Instruments, open_instruments
from fieldkit.recording.record import MinuteView, PreparedRecording, config_of
from fieldkit.recording.recordings import session_path
from fieldkit.recording.running import WAITING_NAME, previewing
from fieldkit.results.result_files import writing
from fieldkit.sessions.lock import SessionLock
from fieldkit.views import frame_image

if TYPE_CHECKING:
    from fieldkit.recording.campaign import Campaign

FRAME_WITHIN_S = 15.0
READERS_END_WITHIN_S = 3.0
QUEUE_SIZE = 512
"""Samples of a stream that may wait; losing some is harmless, because nothing is recorded."""


def live(
    campaign: Campaign | Config | str | Path = ".",
    *,
    duration: str | float | None = None,
    on_minute: Callable[[Minute], None] | None = None,
    views: Sequence[View] = (),
) -> None:
    """Read a campaign's instruments and show samples and slopes, without recording.

    Instruments that are not plugged in are skipped. Ends when a recording of the campaign begins, which may
    include what was shown last (``record(include_last="2m")``). Raises `ConfigError`, `DeviceError`, and
    `RefusedError` while a recording or another preview has the instruments.

    Parameters
    ----------
    campaign
        A campaign, its configuration, or a path in its folder.
    duration
        ``"20m"`` or a number of seconds; by default until interrupted.
    on_minute
        Called with each minute as it closes.
    views
        Receive every sample, event and minute.

    Examples
    --------
    >>> minutes = []
    >>> fieldkit.live(campaign, duration="3m", on_minute=minutes.append)
    >>> minutes[0]
    <Minute 19:00 UTC: b05 ...; ... W/m² direct>
    """
    config, duration_s = config_of(campaign), None if duration is None else as_seconds(duration)
    shown = [*views, *([MinuteView(on_minute)] if on_minute else [])]
    with (
        previewing(config.recordings) as recorder_waits,
        open_instruments(config, duration_s=duration_s, allow_missing=True) as instruments,
    ):
        shown.append(LastSamples(config, instruments))
        LivePreview(config, instruments, shown).run(duration_s, recorder_waits)


def await_begin(
    prepared: PreparedRecording, views: Sequence[View], stopping: threading.Event
) -> PreparedRecording | None:
    """Show the instruments until the recording is to begin, by its time or a trigger.

    They are read all the time: the same readers go on for the recording, so that nothing is lost in between,
    and a trigger's first samples are those of the time before it. None if `stopping` is set before.
    """
    triggers, clock, ring = prepared.triggers, prepared.instruments.clock, SampleRing()
    preview = LivePreview(prepared.config, prepared.instruments, [*views, ring, triggers])

    def is_due() -> bool:
        return triggers.started is not None if prepared.options.on_trigger else prepared.begins_in_s() <= 0.0

    with SessionLock(prepared.path.parent, WAITING_NAME):
        readers = preview.run(None, lambda: stopping.is_set() or is_due(), keeps=is_due)
    if not readers:
        return None
    samples = ring.since(triggers.since_ns) if triggers.started else []
    start_ns = samples[0].mono_ns if samples else clock.mono_ns()
    included = Included(start_ns, chain(samples, preview.left_samples()), readers)
    path = session_path(prepared.config, prepared.options.name, clock.to_utc_ns(start_ns))
    return replace(prepared, included=included, path=path)


def missing_instruments(config: Config, streams: Iterable[StreamInfo]) -> list[str]:
    """Names of configured instruments that have no stream."""
    present = {info.name for info in streams}
    return [device.name for device in config.devices if device.name not in present]


def write_png(path: Path, config: Config, instruments: Instruments) -> None:
    """Write the camera's next usable frame as an image with regions and scale.

    Raises `DeviceNotFoundError` without a camera, `DeviceTimeoutError` if no usable frame arrives,
    `StorageError` if the file cannot be written.
    """
    frame = usable_frame(instruments)
    info = next(info for info in instruments.streams if info.name == frame.stream)
    image = frame_image.png(frame, info, regions_on(info.name, config.regions, instruments.streams))
    with writing(path):
        path.write_bytes(image)


def usable_frame(instruments: Instruments) -> Frame:
    """The camera's next frame without a flag that makes it unfit to show."""
    camera = next((device for device in instruments.devices if isinstance(device, Camera)), None)
    if camera is None:
        raise DeviceNotFoundError("no camera is configured or plugged in", fix=Action.FIND_DEVICES())
    with instruments.clock.taking_part():
        end_ns = instruments.clock.mono_ns() + round(FRAME_WITHIN_S * 1e9)
        while instruments.clock.mono_ns() < end_ns:
            frame = camera.read(0.5)
            if frame is not None and is_showable(frame.quality):
                return frame
    raise DeviceTimeoutError(
        f"no usable frame arrived within {FRAME_WITHIN_S:.0f} s",
        place=camera.info.name,
        fix="unplug the camera and plug it in again",
    )


class LivePreview:
    """Reads opened instruments and shows samples and slopes to views; nothing is stored."""

    def __init__(self, config: Config, instruments: Instruments, views: Sequence[View]) -> None:
        self.instruments = instruments
        self.views = views
        self._queue = SampleQueue({info.name: QUEUE_SIZE for info in instruments.streams})
        self.measure(config)
        self._next_health_ns = 0

    def run(
        self,
        duration_s: float | None,
        is_over: Callable[[], bool] = lambda: False,
        keeps: Callable[[], bool] = lambda: False,
    ) -> list[DeviceReader]:
        """Show until the duration or the preview is over, the instruments end, or an interrupt.

        If `keeps` is true then, the readers that are returned go on, for a recording; else all have ended.
        """
        readers = self._readers(duration_s)
        self.instruments.clock.hold_until(self._queue.is_settled)
        try:
            with self.instruments.clock.taking_part():
                for reader in readers:
                    reader.start()
                for reader in readers:
                    reader.ready.wait()
            while not is_over() and (any(reader.is_running for reader in readers) or self._is_unfinished()):
                self._process_next()
                self._show_health(readers)
        finally:
            self._estimating.close()
            for view in self.views:  # first, to give the terminal back: a reader may need a moment to end
                view.close()
            if not keeps():
                self._end(readers)
                readers = []
        return readers

    def left_samples(self) -> Iterator[Sample]:
        """What was read and is not shown any more."""
        while (item := self._queue.get(0.0)) is not None:
            if isinstance(item, Frame | Reading):
                yield item
            self._queue.finish(item)

    def _is_unfinished(self) -> bool:
        """True if samples or minutes are still to be shown, unless estimating takes too long."""
        return self._queue.is_busy() and self._estimating.waited_s() < LONGEST_WAIT_S

    def measure(self, config: Config) -> None:
        """Estimate with other regions or settings from now on; safe from any thread."""
        streams = self.instruments.streams
        estimator = Estimator(config.site, config.regions, streams, config.estimator_settings())
        self._estimating = EstimatorThread(estimator, self._queue)

    def _readers(self, duration_s: float | None) -> list[DeviceReader]:
        clock, reopen = self.instruments.clock, self.instruments.reopen
        end_ns = None if duration_s is None else clock.mono_ns() + round(duration_s * 1e9)
        return [
            DeviceReader(device, partial(reopen, device.info.name), self._queue, clock, Sampling(), end_ns)
            for device in self.instruments.devices
        ]

    def _process_next(self) -> None:
        item = self._queue.get(0.1)
        if item is None:
            return
        if isinstance(item, Future):
            self._show_minute(item.result())
        else:
            self._show(item)
            if not isinstance(item, Event):
                self._estimating.add(item)
        self._queue.finish(item)

    def _show_minute(self, minute: Minute) -> None:
        for notice in minute.events:
            self._show(notice)
        self._show(minute)

    def _show(self, item: Sample | Event | Minute | Health) -> None:
        for view in self.views:
            view.show(item)

    def _show_health(self, readers: Sequence[DeviceReader]) -> None:
        now_ns = self.instruments.clock.mono_ns()
        if now_ns >= self._next_health_ns:
            self._next_health_ns = now_ns + 1_000_000_000
            for reader in readers:
                reader.count_second()
            self._show(self._health(now_ns, readers))

    def _health(self, now_ns: int, readers: Sequence[DeviceReader]) -> Health:
        streams = tuple(
            StreamHealth(
                reader.info.name,
                reader.received,
                self._queue.dropped[reader.info.name],
                0,
                rejected=reader.rejected,
                implausible=reader.implausible,
            )
            for reader in readers
        )
        return Health(
            now_ns, self.instruments.clock.to_utc_ns(now_ns), streams, self.instruments.free_bytes()
        )

    def _end(self, readers: Sequence[DeviceReader]) -> None:
        for reader in readers:
            reader.stop()
        collections.deque(self.left_samples(), maxlen=0)  # or they wait for a simulated clock that is held
        deadline = time.monotonic() + READERS_END_WITHIN_S
        for reader in readers:
            reader.join(max(0.0, deadline - time.monotonic()))
