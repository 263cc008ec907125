"""Show what the instruments measure now, without recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from fieldkit.config import Config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.device import Camera
from fieldkit.model.errors import DeviceNotFoundError, DeviceTimeoutError, StorageError
from fieldkit.model.samples import Event, Frame, Health, Sample, StreamHealth, is_showable
from fieldkit.recorder import SampleQueue, Sampling, View
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.views import frame_image
from fieldkit.workflows.record import Instruments

FRAME_WITHIN_S = 15.0
READERS_END_WITHIN_S = 3.0
QUEUE_SIZE = 512
"""Samples of a stream that may wait; what does not fit is not missed, for nothing is recorded."""


def missing_instruments(config: Config, instruments: Instruments) -> list[str]:
    """Names of configured instruments that are not open."""
    present = {info.name for info in instruments.streams}
    return [one.name for one in config.devices if one.name not in present]


def write_png(path: Path, config: Config, instruments: Instruments) -> None:
    """Write one picture with regions and scale.

    Raises `DeviceNotFoundError` without a camera, `DeviceTimeoutError` if no picture without
    doubts comes, `StorageError` if the file cannot be written.
    """
    frame = good_frame(instruments)
    info = next(info for info in instruments.streams if info.name == frame.stream)
    try:
        path.write_bytes(frame_image.png(frame, info, config.regions))
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}", fix="name another file") from error


def good_frame(instruments: Instruments) -> Frame:
    """The camera's next picture that no flag speaks against."""
    camera = next((device for device in instruments.devices if isinstance(device, Camera)), None)
    if camera is None:
        raise DeviceNotFoundError("no camera is configured or plugged in", fix="fieldkit devices")
    with instruments.clock.taking_part():
        end_ns = instruments.clock.mono_ns() + round(FRAME_WITHIN_S * 1e9)
        while instruments.clock.mono_ns() < end_ns:
            frame = camera.read(0.5)
            if frame is not None and is_showable(frame.quality):
                return frame
    raise DeviceTimeoutError(
        f"no picture came from the camera within {FRAME_WITHIN_S:.0f} s",
        fix="unplug the camera and plug it in again",
    )


class LivePreview:
    """Reads the instruments and shows samples and slopes; nothing is stored."""

    def __init__(self, config: Config, instruments: Instruments, views: Sequence[View]) -> None:
        self.instruments, self.views = instruments, views
        self._inbox = SampleQueue({info.name: QUEUE_SIZE for info in instruments.streams})
        self._estimator = Estimator(
            config.site, config.regions, instruments.streams, config.estimator_settings()
        )
        self._next_health_ns = 0

    def run(self, duration_s: float | None) -> None:
        """Show until the time is over, the instruments end, or Ctrl-C."""
        feeds = self._feeds(duration_s)
        self.instruments.clock.hold_until(self._inbox.settled)
        try:
            with self.instruments.clock.taking_part():
                for feed in feeds:
                    feed.start()
                for feed in feeds:
                    feed.ready.wait()
            while any(feed.is_running for feed in feeds) or self._inbox.is_busy():
                self._take()
                self._look_around(feeds)
        finally:
            self._end(feeds)

    def _feeds(self, duration_s: float | None) -> list[DeviceReader]:
        clock = self.instruments.clock
        end_ns = None if duration_s is None else clock.mono_ns() + round(duration_s * 1e9)
        return [
            DeviceReader(
                device,
                partial(self.instruments.reopen, device.info.name),
                self._inbox,
                clock,
                Sampling(),
                end_ns,
            )
            for device in self.instruments.devices
        ]

    def _take(self) -> None:
        item = self._inbox.get(0.1)
        if item is None:
            return
        self._show(item)
        if not isinstance(item, Event):
            for minute in self._estimator.add(item):
                for notice in minute.events:
                    self._show(notice)
                self._show(minute)
        self._inbox.done(item)

    def _show(self, item: Sample | Event | Minute | Health) -> None:
        for view in self.views:
            view.show(item)

    def _look_around(self, feeds: Sequence[DeviceReader]) -> None:
        now_ns = self.instruments.clock.mono_ns()
        if now_ns >= self._next_health_ns:
            self._next_health_ns = now_ns + 1_000_000_000
            self._show(self._health(now_ns, feeds))

    def _health(self, now_ns: int, feeds: Sequence[DeviceReader]) -> Health:
        streams = tuple(
            StreamHealth(
                feed.info.name, feed.received, self._inbox.dropped[feed.info.name], 0, rejected=feed.rejected
            )
            for feed in feeds
        )
        return Health(
            now_ns, self.instruments.clock.to_utc_ns(now_ns), streams, self.instruments.free_bytes()
        )

    def _end(self, feeds: Sequence[DeviceReader]) -> None:
        """Give the terminal back first: a reader may need a moment."""
        for view in self.views:
            view.close()
        for feed in feeds:
            feed.stop()
        deadline = time.monotonic() + READERS_END_WITHIN_S
        for feed in feeds:
            feed.join(max(0.0, deadline - time.monotonic()))
