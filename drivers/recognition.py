"""Recognition of an instrument on a serial port or at an address, by what it sends or what it replies.

Drivers of serial instruments state how they are recognised (`fieldkit.drivers.ports.Probe`). A port is first
listened to, at one speed after the other while something comes that no driver reads; where it is silent, the
requests of those that only reply are sent. The result is a proposal: registers mean something by every map.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from typing import Any, NamedTuple

from fieldkit.drivers import registry
from fieldkit.drivers.connections import has_line
from fieldkit.drivers.decoding import Layout, Parsed, Record, Value
from fieldkit.drivers.framing import Line
from fieldkit.drivers.ports import Probe, SerialDriver, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError
from fieldkit.model.quantities import meaning_of
from fieldkit.model.samples import Quality

BAUDS = (115_200, 9600, 57_600, 4800, 19_200, 38_400)
"""Speeds at which a port is listened to, the usual ones first."""
SILENT_S = 5  # boards restart when their port is opened, and print every few seconds
LISTEN_S = 2
LONGEST_S = 8  # where the first lines tell too little: messages of a board that starts, one sensor of several
REPLY_S = 0.4
_LONGEST = 1 << 16
_RAW = Layout(lambda _: None, _LONGEST)
_SHOWN = 4
Probes = Sequence[tuple[SerialDriver, Probe]]


class Match(NamedTuple):
    """A driver with its options that reads what came, and the values; `refused` bytes were no record."""

    driver: str
    options: Mapping[str, Any]
    values: Sequence[Value] = ()
    refused: int = 0
    is_certain: bool = True

    def __str__(self) -> str:
        """As ``--instrument`` takes it: ``text,sensor=bh1750``."""
        return ",".join((self.driver, *(f"{key}={value}" for key, value in self.options.items())))

    @property
    def shown(self) -> str:
        """The first value of each channel, with those that cannot be."""
        first = {value.channel: value for value in reversed(self.values)}
        return ", ".join(map(_shown, list(reversed(first.values()))[:_SHOWN]))


class Recognition(NamedTuple):
    """What reads a port, the likeliest first, and the bytes that came from it."""

    matches: Sequence[Match]
    received: bytes = b""


def recognise(port: str, clock: Clock) -> Recognition:
    """What is on a port or at an address; raises `DeviceError` if it cannot be opened."""
    settings = DeviceSettings(port, "", port)
    drivers = [driver for driver in registry.load_all()[0] if isinstance(driver, SerialDriver)]
    probes = [(driver, probe) for driver in drivers for probe in driver.probes]
    talking = [(driver, probe) for driver, probe in probes if not probe.request]
    for baud in BAUDS if has_line(port) else BAUDS[:1]:
        found = _listen(settings, Line(baud), clock, talking)
        if found.matches or not found.received or _is_text(found.received):
            break
    if found.received:
        return found
    return _ask(settings, clock, [(driver, probe) for driver, probe in probes if probe.request])


def _listen(settings: DeviceSettings, line: Line, clock: Clock, probes: Probes) -> Recognition:
    """What reads the bytes that come at a speed."""
    matches, received, listened_s = list[Match](), b"", 0
    with closing(open_port(settings, line, clock)) as port:
        for second in range(1, LONGEST_S + 1):
            port.read(_RAW, 1.0)
            received = port.framer.left
            listened_s += bool(received)
            if listened_s >= LISTEN_S:
                matches = _readers(probes, received, line if has_line(settings.port) else None)
                if any(value.unit for match in matches for value in match.values) or not _is_text(received):
                    break
            elif not received and second >= SILENT_S:
                break
    return Recognition(matches, received)


def _readers(probes: Probes, data: bytes, line: Line | None) -> list[Match]:
    """What reads most of the bytes, at least half; `line` may be unknown.

    What is made for these lines may refuse a quarter more: others read a part of them as something else.
    """
    ranked: list[tuple[int, int, int, Match]] = []
    for driver, probe in probes:
        other = {} if line is None or line.baud == probe.line.baud else {"baud": line.baud}
        if not other or "baud" in driver.options:
            match = _match(driver, {**probe.options, **other}, data)
            if match and 2 * match.refused < len(data):
                lead = len(data) // 4 if probe.options else 0
                ranked.append((match.refused - lead, -len(match.values), len(ranked), match))
    return [min(ranked)[-1]] if ranked else []


def _ask(settings: DeviceSettings, clock: Clock, probes: Probes) -> Recognition:
    """Whatever replies to the requests of a line; the lines behind it are not tried then."""
    if not has_line(settings.port):
        return _replies(settings, Line(), clock, probes)
    for line in dict.fromkeys(probe.line for _, probe in probes):
        of_line = [(driver, probe) for driver, probe in probes if probe.line == line and not probe.is_tcp]
        with suppress(DeviceAccessError):  # not every adapter has every line
            if (found := _replies(settings, line, clock, of_line)).received:
                return found
    return Recognition(())


def _replies(settings: DeviceSettings, line: Line, clock: Clock, probes: Probes) -> Recognition:
    matches, received = [], b""
    with closing(open_port(settings, line, clock)) as port:
        for driver, probe in probes:

            def parse(buffer: bytes, driver: SerialDriver = driver, probe: Probe = probe) -> Parsed:
                return Record(len(buffer)) if _reply(driver, probe, buffer) else None

            stamped = port.read(Layout(parse, _LONGEST), REPLY_S, probe.request)
            raw = stamped.raw if stamped else port.framer.left
            match = _reply(driver, probe, raw)
            matches += [match] if match else []
            received += raw.removeprefix(probe.request)
    return Recognition(sorted(matches, key=lambda match: match.refused), received)


def _reply(driver: SerialDriver, probe: Probe, data: bytes) -> Match | None:
    """The driver, if it reads a reply; some adapters send the request back before it."""
    return _match(driver, probe.options, data.removeprefix(probe.request), is_reply=True)


def _match(
    driver: SerialDriver, options: Mapping[str, Any], data: bytes, *, is_reply: bool = False
) -> Match | None:
    """The driver, if it reads values; of a reply those that can be, or none at all."""
    decoded = driver.decode(data, options)
    is_empty = is_reply and decoded.notes and not decoded.values
    if not (is_empty or any(not is_reply or _is_possible(value) for value in decoded.values)):
        return None
    return Match(
        driver.name, options, decoded.values, decoded.refused, options.keys().isdisjoint(driver.needs)
    )


def _is_possible(value: Value) -> bool:
    meaning = meaning_of(value.unit, value.channel)
    if Quality.NO_VALUE in value.quality or meaning is None:
        return Quality.NO_VALUE not in value.quality
    return meaning.quantity.limit.low <= meaning.in_stream_unit(value.value) <= meaning.quantity.limit.high


def _shown(value: Value) -> str:
    if Quality.NO_VALUE in value.quality:
        return f"{value.channel} without a value"
    text = f"{value.channel} = {value.value:.7g} {value.unit}".rstrip()
    return text if _is_possible(value) else f"{text} (impossible)"


def _is_text(data: bytes) -> bool:
    """True if nearly all characters are those of lines; at a wrong speed they are not."""
    text = (
        letter for letter in data.decode("utf-8", "ignore") if letter in "\t\r\n\x1b" or letter.isprintable()
    )
    return len("".join(text).encode()) > 0.97 * len(data)
