"""``fieldkit live``: the picture and all values as they are now, without recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import click

from fieldkit.cli import common
from fieldkit.cli.record import live_views, parse_duration
from fieldkit.cli.recording import Instruments, instruments
from fieldkit.config import Config
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.device import Camera
from fieldkit.model.errors import DeviceNotFoundError, DeviceTimeoutError, StorageError
from fieldkit.model.samples import Event, Frame, Health, Sample, StreamHealth, is_showable
from fieldkit.recorder import SampleQueue, Sampling, View
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.views import frame_image

PICTURE_WITHIN_S = 15.0
READERS_END_WITHIN_S = 3.0
ROOM = 512
"""Samples of a stream that may wait; what does not fit is not missed, for nothing is recorded."""


@click.command(cls=common.Verb)
@click.option(
    "--png", type=click.Path(path_type=Path), metavar="FILE", help="Write one picture with regions and end."
)
@click.option("--for", "lasting", metavar="TIME", help="How long: 3h, 90m, 45s.")
@click.option(
    "--theme", type=click.Choice(["dark", "paper"]), default="dark", help="paper: readable in the sun."
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    png: Path | None,
    lasting: str | None,
    theme: Literal["dark", "paper"],
    settings: tuple[str, ...],
) -> None:
    """Show what the campaign's instruments see now, without recording; Ctrl-C ends it."""
    config = common.campaign(ctx, settings)
    duration_s = None if lasting is None else parse_duration(lasting)
    with instruments(config, duration_s=duration_s, allow_missing=True) as tools:
        _say_missing(config, tools)
        if png is not None:
            write_png(png, config, tools)
            click.echo(png)
            _say_enlarged(tools)
            return
        views = live_views(config, tools, "live, not recorded", duration_s, theme)
        try:
            LivePreview(config, tools, views).run(duration_s)
        except KeyboardInterrupt:
            common.say("nothing was recorded; to record: fieldkit record")


def _say_missing(config: Config, tools: Instruments) -> None:
    there = {info.name for info in tools.streams}
    if missing := [one.name for one in config.devices if one.name not in there]:
        common.say(f"not plugged in: {', '.join(missing)}")


def _say_enlarged(tools: Instruments) -> None:
    """States that the image is enlarged: its axes count the camera's pixels, not the file's."""
    rows, cols = next(info.shape for info in tools.streams if info.is_camera)
    factor = frame_image.enlargement((rows, cols))
    common.say(f"{cols} x {rows} pixels, enlarged {factor} times; the axes count camera pixels, as roi does")


def write_png(path: Path, config: Config, tools: Instruments) -> None:
    """Write one picture with regions and scale.

    Raises `DeviceNotFoundError` without a camera, `DeviceTimeoutError` if no picture without
    doubts comes, `StorageError` if the file cannot be written.
    """
    frame = good_frame(tools)
    info = next(info for info in tools.streams if info.name == frame.stream)
    try:
        path.write_bytes(frame_image.png(frame, info, config.regions))
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}", fix="name another file") from error


def good_frame(tools: Instruments) -> Frame:
    """The camera's next picture that no flag speaks against."""
    camera = next((device for device in tools.devices if isinstance(device, Camera)), None)
    if camera is None:
        raise DeviceNotFoundError("no camera is configured or plugged in", fix="fieldkit devices")
    with tools.clock.taking_part():
        end_ns = tools.clock.mono_ns() + round(PICTURE_WITHIN_S * 1e9)
        while tools.clock.mono_ns() < end_ns:
            frame = camera.read(0.5)
            if frame is not None and is_showable(frame.quality):
                return frame
    raise DeviceTimeoutError(
        f"no picture came from the camera within {PICTURE_WITHIN_S:.0f} s",
        fix="unplug the camera and plug it in again",
    )


class LivePreview:
    """Reads the instruments and shows samples and slopes; nothing is stored."""

    def __init__(self, config: Config, tools: Instruments, views: Sequence[View]) -> None:
        self.tools, self.views = tools, views
        self._inbox = SampleQueue({info.name: ROOM for info in tools.streams})
        self._estimator = Estimator(config.site, config.regions, tools.streams, config.estimator_settings())
        self._next_health_ns = 0

    def run(self, duration_s: float | None) -> None:
        """Show until the time is over, the instruments end, or Ctrl-C."""
        feeds = self._feeds(duration_s)
        self.tools.clock.hold_until(self._inbox.settled)
        try:
            with self.tools.clock.taking_part():
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
        clock = self.tools.clock
        end_ns = None if duration_s is None else clock.mono_ns() + round(duration_s * 1e9)
        return [
            DeviceReader(
                device, partial(self.tools.reopen, device.info.name), self._inbox, clock, Sampling(), end_ns
            )
            for device in self.tools.devices
        ]

    def _take(self) -> None:
        item = self._inbox.get(0.1)
        if item is None:
            return
        self._show(item)
        if not isinstance(item, Event):
            for minute in self._estimator.add(item):
                for notice in minute.notices:
                    self._show(notice)
                self._show(minute)
        self._inbox.done(item)

    def _show(self, item: Sample | Event | Minute | Health) -> None:
        for view in self.views:
            view.show(item)

    def _look_around(self, feeds: Sequence[DeviceReader]) -> None:
        now_ns = self.tools.clock.mono_ns()
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
        return Health(now_ns, self.tools.clock.to_utc_ns(now_ns), streams, self.tools.free_bytes())

    def _end(self, feeds: Sequence[DeviceReader]) -> None:
        """Give the terminal back first: a reader may need a moment."""
        for view in self.views:
            view.close()
        for feed in feeds:
            feed.stop()
        deadline = time.monotonic() + READERS_END_WITHIN_S
        for feed in feeds:
            feed.join(max(0.0, deadline - time.monotonic()))
