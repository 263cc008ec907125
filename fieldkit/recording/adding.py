"""Connected instruments, written into ``fieldkit.toml``: what nothing shows is asked for, once.

What is on a serial port is recognised by what it sends or replies, and proposed. Each instrument is opened as
by a recording, so that its stream states what it measures. One that is configured already is left alone.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fieldkit.config import Config, edit, load_config
from fieldkit.drivers import registry
from fieldkit.drivers.connections import connect, is_address
from fieldkit.drivers.discovery import ConnectedDevice, discover, is_device
from fieldkit.drivers.framing import Line
from fieldkit.drivers.meters.modbus import TCP_PORT
from fieldkit.drivers.ports import SerialDriver, serial_ports
from fieldkit.drivers.recognition import Match, recognise
from fieldkit.model.channels import radiation_components
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceError, DeviceNotFoundError
from fieldkit.model.next_step import Action
from fieldkit.model.quantities import COMPONENTS
from fieldkit.recording.opening import SIMULATED, open_in_time
from fieldkit.recording.preflight import STATE_UNIT, UNKNOWN_UNIT

SKIP = "skip"
_NAMES = {"illuminance": "lux", "temperature": "thermometer"}
"""Tables of ``fieldkit.toml`` by quantity; for others, and for second ones, it is ``[device.NAME]``."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question about an instrument: `key` is ``driver``, ``measures`` or an option of its driver.

    `received` is what it sent, in words; `proposal` is one of the choices, or empty.
    """

    device: ConnectedDevice
    stated: str
    key: str
    choices: Sequence[str]
    received: str = ""
    proposal: str = ""

    def __str__(self) -> str:
        places = ", ".join(dict.fromkeys((id_of(self.device), self.device.port)))
        return f"{self.key} of {self.stated or 'the instrument'} on {places}{self.received}"

    def accept(self) -> str:
        """The proposal; without one raises `ConfigError` with the argument that states it."""
        if self.proposal:
            return self.proposal
        options = {"driver": self.stated, self.key: "X"}  # the driver is the key where it is not known
        fix = Action.ADD_DEVICES(stated={id_of(self.device): options})
        raise ConfigError("not known", place=str(self), fix=fix + f", where X is {', '.join(self.choices)}")


Ask = Callable[[Question], str]
"""Returns one of the choices."""
Stated = Mapping[str, Mapping[str, Any]]
"""By identity or port: ``driver`` (or `SKIP`), its options, what its radiation ``measures``."""


@dataclass(frozen=True, slots=True)
class AddedDevice:
    """An instrument that was written into ``fieldkit.toml``; `name` is that of its stream."""

    name: str
    driver: str
    identity: str
    port: str
    quantity: str
    unit: str
    options: Mapping[str, Any] = field(default_factory=dict)
    received: str = ""
    """The values by which it was recognised."""
    not_recorded: str = ""
    """Its channels of other quantities than the stream's."""


@dataclass(frozen=True, slots=True, repr=False)
class AddedDevices:
    """Result of `add_devices`; `configured` are names by identity, `failures` what kept others out."""

    added: list[AddedDevice] = field(default_factory=list)
    configured: dict[str, str] = field(default_factory=dict)
    skipped: list[ConnectedDevice] = field(default_factory=list)
    failures: list[ConfigError | DeviceError] = field(default_factory=list)

    def __repr__(self) -> str:
        names = ", ".join(device.name for device in self.added) or "none"
        return f"<AddedDevices: {names}; {len(self.configured)} configured, {len(self.failures)} failed>"


def add_devices(
    file: Path, stated: Stated | None = None, ask: Ask = Question.accept, addresses: Sequence[str] = ()
) -> AddedDevices:
    """Write what is connected, or what is at `addresses`, into a ``fieldkit.toml``, whose comments stay.

    Parameters
    ----------
    file
        The campaign's ``fieldkit.toml``.
    stated
        What is on a cable, by identity: ``{"10c4:ea60:A7": {"driver": "modbus", "map": "kipp-smp"}}``.
    ask
        Called for what neither the instrument nor `stated` shows. By default what was recognised for certain
        is taken, and anything else is a failure.
    addresses
        Hosts, addresses of serial adapters, or paths of ports; then nothing else is looked for.

    Raises
    ------
    ConfigError
        The configuration is invalid, or its instruments are simulated.
    """
    devices, unmatched = AddedDevices(), dict(stated or {})
    named = dict.fromkeys((*addresses, *filter(is_address, unmatched)))
    for connected in named or discover()[0]:
        config = _config(file)
        try:
            device = at_address(connected) if isinstance(connected, str) else connected
            _add(config, device, {**unmatched.pop(id_of(device), {})}, ask, devices)
        except (ConfigError, DeviceError) as error:
            devices.failures.append(error)
    devices.failures.extend(map(_not_connected, unmatched))
    return devices


def _not_connected(identity: str) -> DeviceNotFoundError:
    fix = Action.FIND_DEVICES() + " shows the identities of what is connected"
    return DeviceNotFoundError("no such instrument is connected", place=identity, fix=fix)


def at_address(address: str) -> ConnectedDevice:
    """What may be at a host, at the address of a serial adapter, or on the port at a path.

    Raises `DeviceNotFoundError` where a host is none of an instrument's.
    """
    drivers = registry.load_all()[0]
    serial = tuple(driver.name for driver in drivers if isinstance(driver, SerialDriver))
    for driver in drivers:
        port = getattr(driver, "host_port", 0)
        if port and (address.endswith(f":{port}") or not (is_address(address) or address.startswith("/"))):
            settings = DeviceSettings(driver.name, driver.name, address)
            with suppress(ConfigError, DeviceError), closing(open_in_time(settings, HostClock())):
                return ConnectedDevice("", address, driver.title, (driver.name,))
    if is_address(address) or address.startswith("/"):
        present = serial_ports()
        usb = next((usb for path, usb in present if path == os.path.realpath(address)), None)
        identity = usb.as_text([usb for _, usb in present]) if usb else ""
        return ConnectedDevice(identity, address, "serial port", serial)
    settings = DeviceSettings(address, "", f"{address}:{TCP_PORT}")
    with suppress(DeviceError), closing(connect(settings, Line(), HostClock())):
        return ConnectedDevice("", settings.port, "Modbus TCP", serial)
    fix = "check the address; a serial adapter needs its port too, HOST:PORT"
    raise DeviceNotFoundError("no known instrument replies", place=address, fix=fix)


def id_of(device: ConnectedDevice) -> str:
    """Identity of an instrument, or its port if it has none."""
    return device.identity or device.port


def _config(file: Path) -> Config:
    config = load_config(file)
    if any(device.port == SIMULATED for device in config.devices):
        raise ConfigError("its instruments are simulated", place=file, fix="create a campaign for them")
    return config


def _add(
    config: Config, device: ConnectedDevice, stated: dict[str, Any], ask: Ask, done: AddedDevices
) -> None:
    """Add one instrument, unless it is configured or skipped; raises `ConfigError` or `DeviceError`."""
    name = next((configured.name for configured in config.devices if is_device(device, configured)), None)
    driver, received = stated.pop("driver", ""), ""
    if not (driver or name):
        driver, recognised, received = _driver(device, ask)
        stated = {**recognised, **stated}
    if name is not None:
        done.configured[id_of(device)] = name
    elif driver == SKIP:
        done.skipped.append(device)
    else:
        component = stated.pop("measures", "")
        port = "" if device.identity else device.port  # an identity survives a replug, a port does not
        declared = DeviceSettings(driver, driver, port, device.identity, options=stated)
        settings, info = _declaration(device, declared, ask, f" ({received})" if received else "")
        if "" in radiation_components(info, {}):
            component = component or ask(Question(device, driver, "measures", COMPONENTS))
        done.added.append(_write(config, settings, info, component, received))


def _driver(device: ConnectedDevice, ask: Ask) -> tuple[str, Mapping[str, Any], str]:
    """Driver, options and values of an instrument: by its only driver, or by recognition and a question."""
    if len(device.drivers) < 2:
        return device.drivers[0] if device.drivers else SKIP, {}, ""
    matches, data = recognise(device.port, HostClock())
    by_label = {str(match): match for match in matches}
    received = "; ".join(f"{label}: {match.shown}" for label, match in by_label.items())
    rejected = registry.decode("text", data, {}).rejected
    sent = f"no driver reads what it sent, {rejected[-1].reason if rejected else repr(data[:60])}"
    unread = sent if data else "it sends and replies nothing"
    proposal = next((str(match) for match in matches[:1] if len(matches) == 1 and match.is_certain), "")
    choices = tuple(dict.fromkeys((*by_label, *device.drivers, SKIP)))
    answer = ask(Question(device, "", "driver", choices, f" ({received or unread})", proposal))
    match = by_label.get(answer, Match(answer, {}))
    return match.driver, match.options, match.shown


def _declaration(
    device: ConnectedDevice, settings: DeviceSettings, ask: Ask, received: str
) -> tuple[DeviceSettings, StreamInfo]:
    """The stream that an instrument declares, with the options that it needs for that."""
    driver = settings.driver
    needs = {key: values for key, values in registry.needs(driver).items() if key not in settings.options}
    try:
        with closing(open_in_time(settings, HostClock())) as opened:
            info = opened.info
    except ConfigError:
        if not needs:
            raise
    else:
        if info.unit:
            return settings, info
        if not needs:
            raise ConfigError(UNKNOWN_UNIT, place=f"{driver} on {id_of(device)}", fix=STATE_UNIT)
    options = {key: ask(Question(device, driver, key, values, received)) for key, values in needs.items()}
    return _declaration(device, replace(settings, options={**settings.options, **options}), ask, received)


def _write(
    config: Config, settings: DeviceSettings, info: StreamInfo, component: str, received: str
) -> AddedDevice:
    """Write an instrument that is open no more; raises `ConfigError` if it cannot be configured so."""
    driver = settings.driver
    kind = str(settings.options.get("sensor", driver))
    path = _path(info, kind, {device.name for device in config.devices})
    rows, cols = info.shape if path == ("camera",) else (0, 0)
    table = {
        "driver": driver, "identity": settings.identity, "port": settings.port,
        "width_px": cols, "height_px": rows, "options": dict(settings.options),
    }  # fmt: skip
    with edit.editing(config.path) as draft:
        edit.add_instrument(draft, path, {key: value for key, value in table.items() if value})
        if component:
            measures = {**config.tables.irradiance.measures, path[-1]: component}
            edit.set_key(draft, "irradiance", "measures", measures)
    place = (settings.identity, info.port, info.quantity, info.unit)
    others = str(info.settings.get("not_recorded", ""))
    return AddedDevice(path[-1], driver, *place, settings.options, received, others)


def _path(info: StreamInfo, kind: str, taken: set[str]) -> tuple[str, ...]:
    """The table of an instrument: ``[camera]``, ``[lux]``, ``[thermometer]`` while free, else its own."""
    name = "camera" if info.is_camera else _NAMES.get(info.quantity, "")
    if name and name not in taken:
        return (name,)
    numbered = (kind, *(f"{kind}-{number}" for number in range(2, len(taken) + 3)))
    return ("device", next(name for name in numbered if name not in taken))
