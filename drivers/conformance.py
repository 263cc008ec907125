"""The conformance suite: what every driver, ours or a plug-in's, must do.

Four groups. *Metadata*: name, title, quantity, and discovery that raises nothing. *Bytes*: if the driver
decodes, any bytes give values or reasons, never an exception. *Device*: if an instrument is given, it opens,
keeps its identity, meets its deadline, delivers what it declared, closes twice and opens again. *Cable*: when
it is unplugged, the loss is reported, and the instrument returns as the same one.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from fieldkit.drivers.decoding import Decodes
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import Device, DeviceSettings, DiscoveredDevice, Driver, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.quantities import COMPONENTS, POWER
from fieldkit.model.samples import Frame, Reading

SECONDS = 10.0
DEADLINE_S = 0.5
SLACK_S = 1.0
HAND_S = 60.0  # a person crawls under the table
RETRY_S = 0.2
ABSENT_IDENTITY = "ffff:ffff:absent"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one check: `level` ok, fail or skip."""

    level: str
    what: str
    text: str


class Cable(Protocol):
    """Means of unplugging the instrument: a person, or a relay."""

    def unplug(self) -> None:
        """Pull it, or ask for it; it may take `HAND_S` until it is done."""

    def plug(self) -> None:
        """Put it back, or ask for it."""


class CheckError(Exception):
    """A failed check."""


class SkipError(Exception):
    """Reason why a check was skipped."""


def check_driver(
    driver: Driver, clock: Clock, settings: DeviceSettings | None = None, cable: Cable | None = None
) -> Iterator[Outcome]:
    """Run the suite; `settings` names an instrument to open, `cable` unplugs it; None skips that part."""
    yield _outcome("it describes itself", lambda: _describes(driver))
    yield _outcome("it finds instruments", lambda: _finds(driver))
    yield _outcome("any bytes give values or reasons", lambda: _bytes(driver))
    yield _outcome("a missing instrument is reported as missing", lambda: _missing(driver, clock))
    if settings is None:
        yield Outcome("skip", "device", "no instrument was named")
        return
    yield from _device(driver, clock, settings, cable)


def _outcome(what: str, check: Callable[[], str]) -> Outcome:
    try:
        return Outcome("ok", what, check())
    except CheckError as failure:
        return Outcome("fail", what, str(failure))
    except SkipError as skipped:
        return Outcome("skip", what, str(skipped))
    except Exception as error:  # a driver may fail in any way; reporting how, and what to do, is the point
        return Outcome("fail", what, f"{type(error).__name__}: {error}")


def _need(fact: bool, message: str) -> None:
    if not fact:
        raise CheckError(message)


def _describes(driver: Driver) -> str:
    for attribute in ("name", "title", "quantity"):
        text = getattr(driver, attribute, None)
        _need(isinstance(text, str) and bool(text), f"{attribute} is {text!r}, not a text")
    return f"{driver.name}: {driver.title}"


def _finds(driver: Driver) -> str:
    devices: object = driver.find()
    if not isinstance(devices, list) or not all(isinstance(device, DiscoveredDevice) for device in devices):
        raise CheckError("find() gives no list of DiscoveredDevice")
    strange = [device.driver for device in devices if device.driver != driver.name]
    _need(not strange, f"find() returns devices of {strange}")
    return f"{len(devices)} connected"


def _bytes(driver: Driver) -> str:
    if not isinstance(driver, Decodes):
        raise SkipError("the driver has no decode()")
    dice = random.Random(1)
    samples = [
        b"",
        bytes(64),
        b"\xff" * 64,
        b"\x02" * 97,
        *(dice.randbytes(dice.randrange(1, 700)) for _ in range(200)),
    ]
    for data in samples:
        decoded = driver.decode(data, {})
        covered = sum(part.length for part in decoded.rejected) + decoded.rest
        _need(covered <= len(data) + 1, f"{covered} of {len(data)} bytes are rejected or left over")
        _need(
            bool(decoded.values or decoded.rejected or decoded.rest or decoded.notes or not data),
            "bytes vanish",
        )
    return f"{len(samples)} byte strings"


def _missing(driver: Driver, clock: Clock) -> str:
    try:
        device = open_with(driver, DeviceSettings("selftest", driver.name, identity=ABSENT_IDENTITY), clock)
    except DeviceNotFoundError as error:
        _need(bool(error.fix), f"no fix is named: {error.message}")
        return error.message
    except (DeviceError, ConfigError) as error:
        return f"rejected before searching: {error.message}"
    device.close()
    raise CheckError(f"it opened an instrument of identity {ABSENT_IDENTITY}")


def _device(driver: Driver, clock: Clock, settings: DeviceSettings, cable: Cable | None) -> Iterator[Outcome]:
    devices: list[Device] = []

    def opens() -> str:
        device = open_with(driver, settings, clock)
        devices.append(device)
        _need(isinstance(device, Device), "open() does not return a Device")
        return _check_declaration(device.info, settings)

    yield (first := _outcome("it opens and declares its stream", opens))
    if first.level != "ok":
        return
    info = devices[0].info
    yield _outcome("it meets its deadline", lambda: _deadline(devices[0], clock))
    yield _outcome("it delivers what it declared", lambda: _delivers(devices[0], clock))
    yield _outcome("it closes, twice", lambda: _closes(devices[0]))
    yield _outcome("it opens again as the same instrument", lambda: _again(driver, clock, settings, info))
    if cable is None:
        yield Outcome("skip", "cable", "not tested")
        return
    yield _outcome("it reports being unplugged", lambda: _lost(driver, clock, settings, cable))
    cable.plug()
    yield _outcome("it returns as the same instrument", lambda: _back(driver, clock, settings, info))


def _check_declaration(info: StreamInfo, settings: DeviceSettings) -> str:
    _need(info.name == settings.name, f"the stream is called {info.name}, not {settings.name}")
    _need(bool(info.quantity and info.unit and info.shape), "quantity, unit or shape is missing")
    _need(info.is_camera or len(info.channels) == info.shape[0], f"{info.channels} for shape {info.shape}")
    fits = not info.measures or (info.unit == POWER.stored and len(info.measures) == info.shape[0])
    _need(fits and set(info.measures) <= {"", *COMPONENTS}, f"{info.measures} cannot be measured")
    return f"{info.quantity} in {info.unit}, shape {'x'.join(str(size) for size in info.shape)}"


def _deadline(device: Device, clock: Clock) -> str:
    start_ns = clock.mono_ns()
    device.read(DEADLINE_S)
    took_s = (clock.mono_ns() - start_ns) / 1e9
    _need(took_s <= DEADLINE_S + SLACK_S, f"read({DEADLINE_S}) took {took_s:.1f} s")
    return f"read({DEADLINE_S}) took {took_s:.2f} s"


def _delivers(device: Device, clock: Clock) -> str:
    deadline_ns = clock.mono_ns() + int(SECONDS * 1e9)
    before_ns = 0
    for number in range(3):
        sample = None
        while sample is None and clock.mono_ns() < deadline_ns:
            sample = device.read(1.0)
        _need(sample is not None, f"{number} samples in {SECONDS:g} s")
        assert sample is not None
        _fits(sample, device.info)
        _need(sample.mono_ns >= before_ns, "stamps go backwards")
        _need(sample.mono_ns <= clock.mono_ns(), "a stamp lies in the future")
        before_ns = sample.mono_ns
    return "3 samples"


def _fits(sample: Frame | Reading, info: StreamInfo) -> None:
    _need(sample.stream == info.name, f"a sample of stream {sample.stream}")
    if isinstance(sample, Frame):
        _need(sample.counts.shape == info.shape, f"a frame of {sample.counts.shape}, declared {info.shape}")
        _need(sample.counts.dtype == "uint16", f"counts are {sample.counts.dtype}")
    else:
        _need(len(sample.values) == info.shape[0], f"{len(sample.values)} values, declared {info.shape[0]}")
        _need(len(sample.raw) <= info.raw_bytes, f"{len(sample.raw)} raw bytes, declared {info.raw_bytes}")


def _closes(device: Device) -> str:
    device.close()
    device.close()
    return "no error"


def _again(driver: Driver, clock: Clock, settings: DeviceSettings, before: StreamInfo) -> str:
    device = open_with(driver, settings, clock)
    try:
        for name in ("identity", "serial_number", "shape", "unit"):
            old, new = getattr(before, name), getattr(device.info, name)
            _need(old == new, f"{name} was {old!r}, is {new!r}")
        _delivers(device, clock)
    finally:
        device.close()
    return before.identity or before.port


def _lost(driver: Driver, clock: Clock, settings: DeviceSettings, cable: Cable) -> str:
    device = open_with(driver, settings, clock)
    cable.unplug()
    try:
        for _ in time_left(clock, HAND_S):
            device.read(DEADLINE_S)
    except DeviceLostError as error:
        _need(bool(error.fix), f"no fix is named: {error.message}")
        return error.message
    finally:
        _closes(device)
    raise CheckError(f"{HAND_S:g} s without its cable, and read() raised no DeviceLostError")


def _back(driver: Driver, clock: Clock, settings: DeviceSettings, before: StreamInfo) -> str:
    deadline_ns = clock.mono_ns() + int(HAND_S * 1e9)
    while True:
        try:
            return _again(driver, clock, settings, before)
        except DeviceError as error:  # not there yet, or still starting
            _need(clock.mono_ns() < deadline_ns, f"not back after {HAND_S:g} s: {error.message}")
            clock.sleep(RETRY_S)


def settings_for(driver: Driver, port: str, identity: str, options: dict[str, Any]) -> DeviceSettings | None:
    """The instrument to test: the one named, or the only one connected; None otherwise."""
    if port or identity:
        return DeviceSettings("selftest", driver.name, port=port, identity=identity, options=options)
    try:
        devices = [device for device in driver.find() if not device.caveat]
    except Exception:  # the suite itself reports it
        return None
    if len(devices) != 1:
        return None
    return DeviceSettings("selftest", driver.name, identity=devices[0].identity, options=options)
