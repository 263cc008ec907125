"""The device all cameras share: read a buffer, decode it, flag it, stamp it.

The family's own module defines what the bytes mean, a `FrameSource` where they come from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from fieldkit.drivers import options
from fieldkit.drivers.cameras.source import OpenedSource
from fieldkit.drivers.decoding import Decoded, Rejected, Value
from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import Buffer, DeviceSettings, FrameSource, StreamInfo
from fieldkit.model.errors import DecodeError, DeviceError, DeviceTimeoutError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import NO_COUNTER, Frame, Quality
from fieldkit.physics.camera_laws import law_named, linear

# --- one buffer: what its bytes alone give

PLAUSIBLE_K = (200.0, 700.0)
"""Scenes outside are a wrong scale, not weather."""

WORD_ENDS = (0, 0xFFFF)
"""The ends of a pixel's range in most cameras."""

_SATURATED, _NO_VALUE = Quality.SATURATED, Quality.NO_VALUE
"""Looking a flag up in its class would take as long as finding the extremes."""

NO_ROWS = np.empty((0, 0), np.uint16)
_WORD = np.dtype("<u2")  # made once: reading its name takes as long as finding a row


class DecodedFrame(NamedTuple):
    """One frame as decoded from its bytes alone; a tuple, because one is made for every frame.

    Kelvin are ``counts * scale + offset`` if `law` is linear; `scale` is NaN where they are not, or unknown.
    `ends` are the counts of a saturated pixel; `flags` follow from the bytes beside the range of the pixels.
    `shutter` is whether a correction runs or has just run, None where the camera does not report it.
    """

    counts: CountArray
    metadata_rows: CountArray = NO_ROWS
    scale: float = math.nan
    offset: float = 0.0
    law: str = "linear"
    ends: tuple[int, int] = WORD_ENDS
    flags: Quality = Quality.GOOD
    shutter: bool | None = None
    device_time: int = NO_COUNTER
    device_seq: int = NO_COUNTER
    fpa_temperature_k: float = math.nan
    housing_temperature_k: float = math.nan
    gain: str = ""

    @property
    def quality(self) -> Quality:
        """Its `flags`, with `SATURATED` for a pixel at either end, `NO_VALUE` without a plausible scene.

        A scale that puts even the warmest pixel below, or the coldest above, anything on this Earth is wrong.
        A decoder with a law of its own judges the scene itself.
        """
        coldest, hottest = extremes(self.counts)
        low, high = PLAUSIBLE_K
        quality = self.flags
        if coldest <= self.ends[0] or hottest >= self.ends[1]:
            quality |= _SATURATED
        is_scene = hottest * self.scale + self.offset >= low and coldest * self.scale + self.offset <= high
        return quality if is_scene or self.law != "linear" else quality | _NO_VALUE  # NaN is in no range


Decode = Callable[[bytes], DecodedFrame | Rejected]


def pixel_view(data: bytes, shape: tuple[int, int], start: int = 0) -> CountArray:
    """Bytes from `start`, at least as many as that shape needs, as little-endian words, without copying."""
    return np.ndarray(shape, _WORD, data, start)


def extremes(counts: CountArray) -> tuple[float, float]:
    """Coldest and hottest pixel; OpenCV finds both in one pass, numpy in two."""
    import cv2

    coldest, hottest, _, _ = cv2.minMaxLoc(counts)
    return coldest, hottest


def decode_frames(data: bytes, decode: Decode, lengths: tuple[int, ...]) -> Decoded:
    """Explain a file or line of hex as frames of one length.

    `lengths` are those the family has; the one that divides the data is taken, the longest that
    fits otherwise. A frame becomes its minimum, mean and maximum.
    """
    length = _frame_length(len(data), lengths)
    whole = len(data) // length * length if length else 0
    values: list[Value] = []
    rejected: list[Rejected] = []
    notes: list[str] = []
    for start in range(0, whole, length or 1):
        frame = decode(data[start : start + length])
        if isinstance(frame, Rejected):
            rejected.append(Rejected(length, frame.reason, start))
        else:
            values.extend(summary(frame))
            notes.append(_note(frame))
    if whole < len(data):
        sizes = " or ".join(str(length) for length in sorted(lengths))
        notes.append(f"a frame of this family has {sizes} bytes")
    return Decoded(tuple(values), tuple(rejected), len(data) - whole, tuple(notes))


def _note(frame: DecodedFrame) -> str:
    height, width = frame.counts.shape
    parts = [f"frame of {width}x{height}"]
    if frame.gain:
        parts.append(f"gain {frame.gain}")
    if frame.device_seq != NO_COUNTER:
        parts.append(f"counter {frame.device_seq}")
    return ", ".join(parts)


def _frame_length(size: int, lengths: tuple[int, ...]) -> int:
    dividing = [length for length in lengths if size and size % length == 0]
    fitting = [length for length in lengths if length <= size]
    return max(dividing, default=max(fitting, default=0))


def summary(frame: DecodedFrame) -> list[Value]:
    """Minimum, mean and maximum in kelvin, in counts where no temperature is known, and the sensor's own."""
    quality = frame.quality | (Quality.SHUTTER if frame.shutter else Quality.GOOD)
    has_kelvin = frame.law != "linear" or not math.isnan(frame.scale)
    unit = "K" if has_kelvin else "counts"
    image = kelvin(frame) if has_kelvin else frame.counts
    figures = {"minimum": image.min(), "mean": image.mean(dtype=np.float64), "maximum": image.max()}
    values = [Value(float(figure), unit, name, quality) for name, figure in figures.items()]
    sensors = {"fpa": frame.fpa_temperature_k, "housing": frame.housing_temperature_k}
    values += [Value(number, "K", name) for name, number in sensors.items() if not math.isnan(number)]
    return values


def kelvin(frame: DecodedFrame) -> AnyArray:
    """Brightness temperature of a frame, float32."""
    if frame.law != "linear":
        return law_named(frame.law)(frame.counts, frame.metadata_rows, {})
    return linear(frame.counts, frame.scale, frame.offset)


# --- the frames around it: what only a sequence shows

FROZEN_NS = 3_000_000_000  # longer than any shutter correction holds the frame
SETTLING_NS = 10_000_000_000  # levels creep after a correction
REPEATS_OF_A_SHUTTER = 2  # a transport repeats a frame once at most by mistake


class FrameMonitor:
    """Keeps what is needed of the last frames; restart it after frames were skipped."""

    def __init__(self) -> None:
        self._counts: CountArray | None = None
        self._counter = (NO_COUNTER, NO_COUNTER)
        self._sequence = -1
        self._changed_ns = 0
        self._repeats = 0
        self._settled_ns = -(2**63)

    def restart(self) -> None:
        """Frames were skipped on purpose: the gap means nothing.

        The last frame is still remembered: the same one again so much later is a frozen one.
        """
        self._sequence = -1
        self._repeats = 0

    def shutter_started(self, mono_ns: int) -> None:
        """A correction was seen or ordered at `mono_ns`."""
        self._settled_ns = mono_ns + SETTLING_NS

    def update(self, frame: DecodedFrame, buffer: Buffer) -> Quality:
        """Flags that follow from the previous frames."""
        quality = self._gap(buffer.sequence)
        if self._is_repeated(frame):
            self._repeats += 1
            quality |= Quality.DUPLICATE
            if buffer.mono_ns - self._changed_ns > FROZEN_NS:
                quality |= Quality.FROZEN
        else:
            self._repeats = 0
            self._changed_ns = buffer.mono_ns
        self._counts = frame.counts
        self._counter = (frame.device_seq, frame.device_time)
        return quality | self._shutter(frame, buffer.mono_ns)

    def _gap(self, sequence: int) -> Quality:
        lost = self._sequence >= 0 and sequence > self._sequence + 1
        self._sequence = sequence
        return Quality.DROPPED_BEFORE if lost else Quality.GOOD

    def _is_repeated(self, frame: DecodedFrame) -> bool:
        """By the camera's own counter or clock where it has one, else by the pixels."""
        counter = (frame.device_seq, frame.device_time)
        if any(new == old != NO_COUNTER for new, old in zip(counter, self._counter, strict=True)):
            return True
        last, now = self._counts, frame.counts
        if last is None or last.shape != now.shape:
            return False
        middle = len(now) // 2  # noise makes one row enough to tell frames apart
        return np.array_equal(now[middle], last[middle]) and np.array_equal(now, last)

    def _shutter(self, frame: DecodedFrame, mono_ns: int) -> Quality:
        """By the camera's own flag if it has one; else a frame that stands still reveals the shutter."""
        if frame.shutter is None and self._repeats >= REPEATS_OF_A_SHUTTER:
            self.shutter_started(mono_ns)
        return Quality.SHUTTER if frame.shutter or mono_ns < self._settled_ns else Quality.GOOD


FIRST_FRAME_S = 5.0
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
        self.rejected: int = 0
        self._decode = decode
        self._clock = clock
        self._run = run
        self._monitor = FrameMonitor()

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame, or None; see `fieldkit.model.device.Device`."""
        buffer = self.source.read(timeout_s)
        if buffer is None:
            return None
        frame = None if buffer.error else self._decode(buffer.data)
        if frame is None or isinstance(frame, Rejected) or not self._fits(frame):
            self.rejected += 1
            return None
        frame = self.with_housekeeping(frame, buffer.mono_ns)
        return Frame(
            stream=self.info.name,
            mono_ns=buffer.mono_ns,
            time_ns=self._clock.to_utc_ns(buffer.mono_ns),
            counts=frame.counts,
            metadata_rows=frame.metadata_rows,
            quality=frame.quality | self._monitor.update(frame, buffer) | self._scale_quality(frame),
            device_time=frame.device_time,
            device_seq=_number(frame, buffer),
            fpa_temperature_k=frame.fpa_temperature_k,
        )

    def run_shutter(self) -> bool:
        """Start a shutter correction; False if this camera cannot."""
        if self._run is None:
            return False
        try:
            self._run()
        except DeviceError:
            return False
        self._monitor.shutter_started(self._clock.mono_ns())
        return True

    def skip_until(self, mono_ns: int) -> None:
        """Skip frames undecoded until a monotonic time, keeping the stream alive."""
        self.source.skip_until(mono_ns)
        self._monitor.restart()

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        self.source.close()

    def with_housekeeping(self, frame: DecodedFrame, mono_ns: int) -> DecodedFrame:
        """The frame with what a second channel of the camera reports; most have none."""
        return frame

    def _fits(self, frame: DecodedFrame) -> bool:
        """True for a frame as declared; one of another size is of a camera that has to be opened again."""
        rows = frame.metadata_rows
        declared = self.info.metadata_shape
        same_rows = rows.shape == declared or not (rows.size or declared[0])
        return frame.counts.shape == self.info.shape and same_rows

    def _scale_quality(self, frame: DecodedFrame) -> Quality:
        """`NO_VALUE` where a frame's own scale is not the one the stream declared."""
        changed = frame.scale != self.info.scale and self.info.law == "linear"
        return Quality.NO_VALUE if changed else Quality.GOOD


def _number(frame: DecodedFrame, buffer: Buffer) -> int:
    """The camera's own count of its frames; the kernel's where the camera keeps none."""
    if frame.device_seq == NO_COUNTER and buffer.sequence >= 0:
        return buffer.sequence
    return frame.device_seq


def describe(
    settings: DeviceSettings,
    handle: OpenedSource,
    first: DecodedFrame,
    facts: Mapping[str, Any],
    *,
    vendor: str = "",
    rate_hz: float = 0.0,
) -> StreamInfo:
    """The stream of a camera, from its configuration and its first frame.

    `facts` are what the camera reports of itself: `model`, `serial_number` and `firmware` have places of
    their own, the others are kept as settings. A frame's law other than ``linear`` gives temperatures.
    """
    facts = {"backend": handle.source.backend, **facts}
    has_kelvin = first.law != "linear" or not math.isnan(first.scale)
    return StreamInfo(
        name=settings.name,
        quantity="brightness_temperature" if has_kelvin else "counts",
        unit="K" if has_kelvin else "counts",
        shape=first.counts.shape,
        scale=first.scale,
        offset=first.offset,
        law=first.law,
        metadata_shape=first.metadata_rows.shape if first.metadata_rows.size else (0, 0),
        rate_hz=rate_hz,
        driver=settings.driver,
        vendor=vendor,
        model=str(facts.pop("model", "")) or handle.usb.title,
        serial_number=str(facts.pop("serial_number", "")) or handle.usb.serial,
        firmware=str(facts.pop("firmware", "")),
        port=handle.source.port,
        identity=handle.identity,
        latency_s=options.number(settings, "latency_s", 0.0, options.POSITIVE),
        accuracy=options.number(settings, "accuracy", math.nan, options.POSITIVE),
        settings=facts,
    )


def first_frame(source: FrameSource, decode: Decode, name: str, clock: Clock) -> DecodedFrame:
    """The first frame of a camera that has just been opened; it has shape and scale.

    Some cameras begin with frames of another kind, so a wrong one is an error only after a while. Raises
    `DeviceTimeoutError` if none comes, `DecodeError` if what comes is none.
    """
    wrong, raw = "", b""
    for left_s in time_left(clock, FIRST_FRAME_S):
        buffer = source.read(left_s)
        if buffer is None:
            break
        frame = decode(buffer.data)
        if isinstance(frame, Rejected):
            wrong, raw = frame.reason, buffer.data[:64]
        elif not buffer.error:  # a damaged one would declare shape and scale of the whole recording
            return frame
    if wrong:
        raise DecodeError(
            f"the camera at {source.port} sends something else: {wrong}",
            raw=raw,
            place=name,
            fix="is it another camera, or in another mode? " + Action.FIND_DEVICES() + " shows it",
        )
    raise DeviceTimeoutError(
        f"no frame from {source.port} within {FIRST_FRAME_S:g} s",
        place=name,
        fix="unplug the camera and plug it into another socket, without a hub",
    )
