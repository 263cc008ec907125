"""The device all cameras share: take a buffer, decode it, flag it, stamp it.

What the bytes mean is said by the family's own module, where they come from by a `FrameSource`.
"""

from __future__ import annotations

from collections.abc import Callable

from fieldkit.drivers.cameras.picture import Decode, Picture
from fieldkit.drivers.cameras.watch import Watch
from fieldkit.drivers.records import Rejected
from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer, FrameSource, StreamInfo
from fieldkit.model.errors import DecodeError, DeviceError, DeviceTimeoutError
from fieldkit.model.samples import NO_COUNTER, Frame, Quality

FIRST_PICTURE_S = 5.0
OPTIONS = ("backend", "accuracy", "latency_s")
"""Options that every camera has."""


class ThermalCamera:
    """An opened camera; `run` starts its shutter correction, None for a camera that cannot."""

    def __init__(
        self,
        info: StreamInfo,
        source: FrameSource,
        decode: Decode,
        clock: Clock,
        run: Callable[[], None] | None = None,
    ) -> None:
        self.info = info
        self.source = source
        self.rejected = 0
        self._decode = decode
        self._clock = clock
        self._run = run
        self._watch = Watch()

    def read(self, timeout_s: float) -> Frame | None:
        """The next picture, or None; see `fieldkit.model.device.Device`."""
        buffer = self.source.read(timeout_s)
        if buffer is None:
            return None
        picture = None if buffer.error else self._decode(buffer.data)
        if picture is None or isinstance(picture, Rejected):
            self.rejected += 1
            return None
        picture = self.told(picture, buffer.mono_ns)
        return Frame(
            stream=self.info.name,
            mono_ns=buffer.mono_ns,
            time_ns=self._clock.to_utc_ns(buffer.mono_ns),
            counts=picture.counts,
            metadata_rows=picture.metadata_rows,
            quality=picture.quality | self._watch.look(picture, buffer) | self._scale_doubt(picture),
            device_time=picture.device_time,
            device_seq=_number(picture, buffer),
            fpa_temperature_k=picture.fpa_temperature_k,
        )

    def run_shutter(self) -> bool:
        """Start a shutter correction; False if this camera cannot."""
        if self._run is None:
            return False
        try:
            self._run()
        except DeviceError:
            return False
        self._watch.shutter_runs(self._clock.mono_ns())
        return True

    def skip_until(self, mono_ns: int) -> None:
        """Let pictures go by undecoded until a monotonic time, keeping the stream alive."""
        self.source.skip_until(mono_ns)
        self._watch.restart()

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        self.source.close()

    def told(self, picture: Picture, mono_ns: int) -> Picture:
        """The picture with what a second channel of the camera tells about it; most have none."""
        return picture

    def _scale_doubt(self, picture: Picture) -> Quality:
        """`NO_VALUE` where a picture's own scale is not the one the stream declared."""
        changed = picture.scale != self.info.scale and self.info.law == "linear"
        return Quality.NO_VALUE if changed else Quality.GOOD


def _number(picture: Picture, buffer: Buffer) -> int:
    """The camera's own count of its pictures; the kernel's where the camera keeps none."""
    if picture.device_seq == NO_COUNTER and buffer.sequence >= 0:
        return buffer.sequence
    return picture.device_seq


def first_picture(source: FrameSource, decode: Decode, name: str, clock: Clock) -> Picture:
    """The first picture of a camera that has just been opened; it tells shape and scale.

    Raises `DeviceTimeoutError` if none comes, `DecodeError` if what comes is none; the source is
    closed then.
    """
    try:
        return _first_picture(source, decode, name, clock)
    except DeviceError:
        source.close()
        raise


def _first_picture(source: FrameSource, decode: Decode, name: str, clock: Clock) -> Picture:
    """Some cameras begin with pictures of another kind; what is still wrong after a while is wrong."""
    deadline_ns = clock.mono_ns() + int(FIRST_PICTURE_S * 1e9)
    wrong, raw = "", b""
    while (remaining_ns := deadline_ns - clock.mono_ns()) > 0:
        buffer = source.read(remaining_ns / 1e9)
        if buffer is None:
            break
        picture = decode(buffer.data)
        if not isinstance(picture, Rejected):
            return picture
        wrong, raw = picture.reason, buffer.data[:64]
    if wrong:
        raise DecodeError(
            f"{name}: the camera at {source.port} sends something else: {wrong}",
            raw=raw,
            fix="is it another camera, or in another mode? fieldkit devices shows what is plugged in",
        )
    raise DeviceTimeoutError(
        f"{name}: no picture from {source.port} within {FIRST_PICTURE_S:g} s",
        fix="unplug the camera and plug it into another socket, without a hub",
    )
