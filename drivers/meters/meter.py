"""The device all meters share: ask if it must be asked, take a record, convert, flag.

What a meter's bytes mean is said by its own module; here a record becomes a `Reading` of the stream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fieldkit.clock import Clock
from fieldkit.device import DeviceSettings, StreamInfo
from fieldkit.drivers import options
from fieldkit.drivers.framing import Port, Stamped
from fieldkit.drivers.meters.units import convert
from fieldkit.drivers.records import GOOD, Layout, Record
from fieldkit.errors import DecodeError, DeviceTimeoutError
from fieldkit.samples import NO_COUNTER, Quality, Reading

FIRST_RECORD_S = 5.0
ANSWER_S = 1.0
OPTIONS = ("labels", "latency_s", "response_s", "accuracy", "range_max_lx")
"""Options that every meter has; `range_max_lx` is the end of a light meter's range, to flag `overrange`."""


@dataclass(frozen=True, slots=True)
class Asking:
    """How to ask a meter that speaks only when spoken to.

    Some must be told to measure (`trigger`, unanswered) and given `settle_s` before they are asked.
    """

    request: bytes
    every_s: float
    answer_s: float = ANSWER_S
    trigger: bytes = b""
    settle_s: float = 0.0


class Meter:
    """An opened meter; `keys` are its own names of the stream's channels, in order.

    `units` are the channels' own where the stream has more than one.
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
        asking: Asking | None = None,
    ) -> None:
        self.info = info
        self._port = port
        self._layout = layout
        self._clock = clock
        self._columns = {key: column for column, key in enumerate(keys)}
        self._units = tuple(units) or (info.unit,) * len(keys)
        self._asking = asking
        self._range_max = info.settings.get("range_max_lx", math.inf) if info.unit == "lx" else math.inf
        self._due_ns = clock.mono_ns()
        self._foreign = 0

    @property
    def rejected(self) -> int:
        """Records dropped so far: unreadable, or of another quantity than the stream's."""
        return self._port.framer.rejected + self._foreign

    def read(self, timeout_s: float) -> Reading | None:
        """The next reading, or None; see `fieldkit.device.Device`."""
        if self._asking is not None:
            if not self._ask(self._asking, timeout_s):
                return None
            timeout_s = self._asking.answer_s
        started_ns = self._clock.mono_ns()
        remaining_s = timeout_s
        while found := self._port.read(self._layout, remaining_s):
            reading = self._reading(found)
            if reading is not None:
                return reading
            remaining_s = timeout_s - (self._clock.mono_ns() - started_ns) / 1e9
        return None

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        self._port.close()

    def _ask(self, asking: Asking, timeout_s: float) -> bool:
        """Wait for the next turn and send the request; False if the turn is not within `timeout_s`."""
        wait_s = (self._due_ns - self._clock.mono_ns()) / 1e9
        self._clock.sleep(min(wait_s, timeout_s))
        if wait_s > timeout_s:
            return False
        every_ns = max(int(asking.every_s * 1e9), 1)
        missed = (self._clock.mono_ns() - self._due_ns) // every_ns
        self._due_ns += every_ns * (1 + max(missed, 0))
        if asking.trigger:
            self._port.write(asking.trigger)
            self._clock.sleep(asking.settle_s)
        self._port.discard()
        self._port.write(asking.request)
        return True

    def _reading(self, found: Stamped) -> Reading | None:
        converted = self._convert(found.record)
        if converted is None:
            self._foreign += bool(found.record.values)  # a line without values is not wrong
            return None
        values, quality = converted
        record = found.record
        return Reading(
            stream=self.info.name,
            mono_ns=found.mono_ns,
            time_ns=self._clock.to_utc_ns(found.mono_ns),
            values=values,
            raw=found.raw,
            quality=quality,
            device_time=NO_COUNTER if record.device_time is None else record.device_time,
        )

    def _convert(self, record: Record) -> tuple[tuple[float, ...], Quality] | None:
        """Values of the stream's channels and what to think of them; None if none is the stream's."""
        values = [math.nan] * len(self._columns)
        quality = GOOD
        mine = known = False
        for value in record.values:
            column = self._columns.get(value.channel)
            number = None if column is None else convert(value.value, value.unit, self._units[column])
            if column is None or number is None:
                continue
            mine = True
            values[column] = number
            known |= number == number
            if value.quality is not GOOD:
                quality |= value.quality & ~Quality.NO_VALUE  # one open probe does not spoil the others
            if number >= self._range_max:
                quality |= Quality.OVERRANGE
        if not known:
            quality |= Quality.NO_VALUE
        return (tuple(values), quality) if mine else None


def first_record(port: Port, layout: Layout, name: str, hint: str, timeout_s: float | None = None) -> Stamped:
    """The first record of a meter that has just been opened, within `FIRST_RECORD_S` unless told.

    Raises `DeviceTimeoutError` if nothing is heard, `DecodeError` if what is heard is no record;
    the port is closed then.
    """
    timeout_s = FIRST_RECORD_S if timeout_s is None else timeout_s
    found = port.read(layout, timeout_s)
    if found is not None:
        return found
    port.close()
    if port.framer.received:
        raise DecodeError(
            f"{name}: {port.framer.received} bytes from {port.path}, none of them a record",
            raw=port.framer.unread,
            fix="check driver and line settings; fieldkit decode DRIVER HEX says what bytes mean",
        )
    raise DeviceTimeoutError(f"{name}: nothing heard from {port.path} in {timeout_s:g} s", fix=hint)


def describe(
    settings: DeviceSettings,
    port: Port,
    layout: Layout,
    quantity: str,
    unit: str,
    channels: Sequence[str],
    model: str = "",
    latency_s: float = 0.0,
) -> StreamInfo:
    """The stream of a meter, with what configuration and port say about it."""
    facts = dict(port.facts)
    if "range_max_lx" in settings.options:
        facts["range_max_lx"] = options.number(settings, "range_max_lx", math.inf)
    return StreamInfo(
        name=settings.name,
        quantity=quantity,
        unit=unit,
        shape=(len(channels),),
        channels=tuple(channels),
        driver=settings.driver,
        model=model,
        port=port.path,
        identity=settings.identity or port.identity,
        latency_s=options.number(settings, "latency_s", latency_s),
        wire_time_s=layout.longest * port.byte_ns / 1e9,
        response_s=options.number(settings, "response_s", 0.0),
        accuracy=options.number(settings, "accuracy", math.nan),
        raw_bytes=layout.longest,
        settings=facts,
    )
