"""The device all meters share: poll, read a record, convert, flag.

A meter's own module defines what its bytes mean; here a record becomes a `Reading` of the stream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_
from typing import NamedTuple

from fieldkit.drivers import options
from fieldkit.drivers.decoding import Channel, Layout
from fieldkit.drivers.framing import Port, Stamped
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, StreamInfo
from fieldkit.model.errors import ConfigError, DecodeError, DeviceTimeoutError
from fieldkit.model.quantities import meaning_of
from fieldkit.model.samples import Quality, Reading

FIRST_RECORD_S = 5.0
SLOW_S = 5.0
"""A meter with a longer interval is waited for, and must not count as silent."""
REPLY_TIMEOUT_S = 1.0
OPTIONS = ("labels", "latency_s", "response_s", "accuracy", "range_max_lx")
"""Options that every meter has; `range_max_lx` is the end of a light meter's range, to flag `overrange`."""


@dataclass(frozen=True, slots=True)
class PollSettings:
    """Poll settings of a meter that sends only on request.

    Some need a `trigger` (without a reply) and `settle_s` before the request.
    """

    request: bytes
    every_s: float
    reply_timeout_s: float = REPLY_TIMEOUT_S
    trigger: bytes = b""
    settle_s: float = 0.0


class Meter:
    """An opened meter; `keys` are its own names of its channels, in order: the stream has the first of them.

    `units` are the channels' own where the stream has more than one. `states` are the states that the meter
    reported with its last values: "hold", "relative", "low_battery". Raises `ConfigError` where the stream
    has more channels.
    """

    def __init__(
        self,
        info: StreamInfo,
        port: Port,
        layout: Layout,
        clock: Clock,
        keys: Sequence[str],
        *,
        units: Sequence[str] = (),
        poll: PollSettings | None = None,
    ) -> None:
        keys, units = keys[: info.shape[0]], units[: info.shape[0]]
        if info.shape != (len(keys),):
            raise ConfigError(
                f"{info.shape[0]} names are given, the meter has {len(keys)} channels",
                place=f"{info.name}.labels",
                fix=f"give at most {len(keys)} labels, in the meter's own order",
            )
        self.info = info
        self._port = port
        self._layout = layout
        self._clock = clock
        self._keys, self._units = tuple(keys), tuple(units) or (info.unit,) * len(keys)
        self.states: tuple[str, ...] = ()
        self._channels: tuple[Channel, ...] = ()
        self._conversion: Conversion | None = None
        self._poll = poll
        self._every_ns = int(poll.every_s * 1e9) if poll else 0
        self._range_max = info.settings.get("range_max_lx") if info.unit == "lx" else None
        self._due_ns = clock.mono_ns()
        self._other_quantity = 0

    @property
    def rejected(self) -> int:
        """Records dropped so far: unreadable, or of another quantity than the stream's."""
        return self._port.framer.rejected + self._other_quantity

    @property
    def rejected_because(self) -> str:
        """Reason why the last unreadable bytes were dropped, empty if none were."""
        return self._port.framer.reason

    def read(self, timeout_s: float) -> Reading | None:
        """The next reading, or None; see `fieldkit.model.device.Device`."""
        poll = self._poll
        if poll is None:
            stamped = self._port.read(self._layout, timeout_s)
        elif self._wait_for_poll(poll, timeout_s):
            timeout_s = poll.reply_timeout_s
            stamped = self._port.read(self._layout, timeout_s, poll.request)
        else:
            return None
        if stamped is None:
            return None
        reading = self._reading(stamped)
        return self._next_after(stamped, timeout_s) if reading is None else reading

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        self._port.close()

    def _next_after(self, stamped: Stamped, timeout_s: float) -> Reading | None:
        """The next reading after a record without values, such as an OK line; waits `timeout_s` again."""
        deadline_ns = stamped.mono_ns + int(timeout_s * 1e9)
        while (left_ns := deadline_ns - self._clock.mono_ns()) > 0:
            behind = self._port.read(self._layout, left_ns / 1e9)
            if behind is None:
                return None
            if reading := self._reading(behind):
                return reading
        return None

    def _wait_for_poll(self, poll: PollSettings, timeout_s: float) -> bool:
        """Wait until the next poll is due; False if that is not within `timeout_s`."""
        now_ns = self._clock.mono_ns()
        if now_ns < self._due_ns:
            wait_s = (self._due_ns - now_ns) / 1e9
            self._clock.sleep(min(wait_s, timeout_s))
            if wait_s > timeout_s:
                return False
            now_ns = self._clock.mono_ns()
        self._due_ns += self._every_ns
        if self._due_ns <= now_ns:
            self._due_ns = now_ns + self._every_ns
        if poll.trigger:
            self._port.write(poll.trigger)
            self._clock.sleep(poll.settle_s)
        return True

    def _reading(self, stamped: Stamped) -> Reading | None:
        # unpacked and positional: attributes and keywords add a fifth to the CPU time of a reading at 10 Hz,
        # more than the goal of benchmarks/drivers_serial.py leaves
        record, raw, mono_ns, bunched = stamped
        _, numbers, channels, _, device_time = record
        if channels is not self._channels:
            self._channels, self._conversion = channels, conversion(channels, self._keys, self._units)
            self.states = tuple(dict.fromkeys(word for channel in channels for word in channel.states))
        if self._conversion is None:
            self._other_quantity += bool(numbers)  # a line without values is not an error
            return None
        steps, quality = self._conversion
        values = tuple([(numbers[place] + add) / by for place, add, by in steps]) if steps else numbers
        if self._range_max is not None and any(value >= self._range_max for value in values):
            quality |= Quality.OVERRANGE
        if bunched:
            quality |= Quality.INTERPOLATED
        time_ns = self._clock.to_utc_ns(mono_ns)
        return Reading(self.info.name, mono_ns, time_ns, values, raw, quality, device_time)


class Conversion(NamedTuple):
    """Rules from a record to the stream's values: for each the number's place, what to add and divide by.

    Without steps its numbers are the values.
    """

    steps: tuple[tuple[int, float, float], ...]
    quality: Quality


def conversion(channels: Sequence[Channel], keys: Sequence[str], units: Sequence[str]) -> Conversion | None:
    """From the channels of a record; None if none of them is a channel of the stream.

    Missing channels are NaN; the reading is flagged `no_value` only if all are.
    """
    steps, quality_flags = [], []
    for key, unit in zip(keys, units, strict=True):
        step = (0, math.nan, 1.0)
        for place, channel in enumerate(channels):
            if channel.name == key and (law := _conversion(channel, unit)):
                step = (place, *law)
                quality_flags.append(channel.quality)
        steps.append(step)
    if not quality_flags:
        return None
    missing = reduce(and_, quality_flags) & Quality.NO_VALUE
    if steps == [(place, 0.0, 1.0) for place in range(len(channels))]:
        steps = []
    return Conversion(tuple(steps), reduce(or_, quality_flags) & ~Quality.NO_VALUE | missing)


def _conversion(channel: Channel, unit: str) -> tuple[float, float] | None:
    """Addend of a channel's values and divisor of the sum, for a stream's unit; None for another."""
    if channel.unit == unit or Quality.NO_VALUE in channel.quality:  # OL has no unit
        return 0.0, 1.0
    meaning = meaning_of(channel.unit, channel.name)
    return meaning.unit[2:4] if meaning and meaning.quantity.units.stored == unit else None


def first_reply(port: Port, request: bytes, layout: Layout, name: str, hint: str) -> Stamped:
    """The first reply of a meter that has just been opened; raises as `first_record`."""
    return _require(port.read(layout, REPLY_TIMEOUT_S, request), port, name, hint, REPLY_TIMEOUT_S)


def first_record(port: Port, layout: Layout, name: str, hint: str, every_s: float = 1.0) -> Stamped:
    """The first record of a meter that has just been opened, within `FIRST_RECORD_S`.

    A slow one, which sends every `every_s` seconds, has two of them. Raises `DeviceTimeoutError` if nothing
    arrives, `DecodeError` if what arrives is not a record.
    """
    within_s = 2.0 * every_s if every_s > SLOW_S else FIRST_RECORD_S
    return _require(port.read(layout, within_s), port, name, hint, within_s)


def _require(stamped: Stamped | None, port: Port, name: str, hint: str, timeout_s: float) -> Stamped:
    if stamped is not None:
        return stamped
    if port.framer.received:
        raise DecodeError(
            f"{port.framer.received} bytes from {port.path}, none of them a record"
            f": {port.framer.reason or repr(port.framer.unread[:60])[1:]}",
            raw=port.framer.unread,
            place=name,
            fix="check driver and line settings",
        )
    raise DeviceTimeoutError(
        f"nothing received from {port.path} within {timeout_s:g} s", place=name, fix=hint
    )


def describe(
    settings: DeviceSettings,
    port: Port,
    layout: Layout,
    quantity: str,
    unit: str,
    labels: Sequence[str],
    model: str = "",
    latency_s: float = 0.0,
) -> StreamInfo:
    """The stream of a meter, from its configuration and port; `labels` are its channels' own names."""
    facts, channels = dict(port.facts), options.labels(settings, labels)
    if "range_max_lx" in settings.options:
        facts["range_max_lx"] = options.number(settings, "range_max_lx", math.inf, options.POSITIVE)
    return StreamInfo(
        name=settings.name,
        quantity=quantity,
        unit=unit,
        shape=(len(channels),),
        channels=channels,
        rate_hz=1.0 / settings.every_s if settings.every_s > SLOW_S else 0.0,
        driver=settings.driver,
        model=model,
        port=port.path,
        identity=settings.identity or port.identity,
        latency_s=options.number(settings, "latency_s", latency_s, options.POSITIVE),
        wire_time_s=layout.longest * port.byte_ns / 1e9,
        response_s=options.number(settings, "response_s", 0.0, options.POSITIVE),
        accuracy=options.number(settings, "accuracy", math.nan, options.POSITIVE),
        raw_bytes=layout.longest,
        settings=facts,
    )
