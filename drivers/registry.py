"""The drivers: fieldkit's own in a table, those of other packages by entry point.

A driver is loaded when it is needed, never before. An entry point of group `fieldkit.drivers`
names a class like the ones in the table. A name that two packages claim is an error,
and a driver that cannot be loaded is reported without stopping the others.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from fieldkit.drivers.decoding import Decoded, Decodes
from fieldkit.drivers.opening import open_with
from fieldkit.drivers.options import decoding_settings, reject_unknown
from fieldkit.model.clock import Clock
from fieldkit.model.device import Device, DeviceSettings, Driver
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.installation import DISTRIBUTION
from fieldkit.model.next_step import Action
from fieldkit.model.spelling import nearest

GROUP = "fieldkit.drivers"

BUILT_IN: Mapping[str, str] = {
    "purethermal": "fieldkit.drivers.cameras.purethermal:PureThermal",
    "p2pro": "fieldkit.drivers.cameras.p2pro:P2Pro",
    "boson": "fieldkit.drivers.cameras.boson:Boson",
    "ht301": "fieldkit.drivers.cameras.ht301:Ht301",
    "thermal-master": "fieldkit.drivers.cameras.thermal_master:ThermalMaster",
    "tc002c": "fieldkit.drivers.cameras.tc002c:Tc002c",
    "tcam": "fieldkit.drivers.cameras.tcam:TCam",
    "htpa": "fieldkit.drivers.cameras.htpa:Htpa",
    "mlx90640": "fieldkit.drivers.cameras.mlx90640:Mlx90640",
    "genicam": "fieldkit.drivers.cameras.genicam:Genicam",
    "y16": "fieldkit.drivers.cameras.y16:Y16",
    "konica-minolta": "fieldkit.drivers.meters.konica_minolta:KonicaMinolta",
    "lutron": "fieldkit.drivers.meters.lutron:Lutron",
    "center-309": "fieldkit.drivers.meters.center:Center309",
    "center-303": "fieldkit.drivers.meters.center:Center303",
    "modbus": "fieldkit.drivers.meters.modbus:Modbus",
    "pce-174": "fieldkit.drivers.meters.pce_174:Pce174",
    "ut325": "fieldkit.drivers.meters.ut325:Ut325",
    "nmea": "fieldkit.drivers.meters.nmea:Nmea",
    "gpsd": "fieldkit.drivers.meters.gpsd:Gpsd",
    "text": "fieldkit.drivers.meters.text:Text",
}


def names() -> list[str]:
    """Every driver's name: ours in the order of the table, then those of other packages."""
    return [*BUILT_IN, *sorted({point.name for point in _plugins(tuple(sys.path))} - set(BUILT_IN))]


def get(name: str) -> Driver:
    """The driver called `name`.

    Raises `ConfigError` if there is none, if two packages claim the name, or if it cannot be loaded.
    """
    plugins = [point for point in _plugins(tuple(sys.path)) if point.name == name]
    owners = ([DISTRIBUTION] if name in BUILT_IN else []) + sorted(_package(point) for point in plugins)
    if not owners:
        near = nearest(name, names())
        hint = f"did you mean {near}?" if near else Action.FIND_DEVICES() + " lists the drivers"
        raise ConfigError(f"no such driver; available: {', '.join(names())}", place=name, fix=hint)
    if len(owners) > 1:
        raise ConfigError(
            f"two drivers have this name: one of {owners[0]}, one of {owners[1]}",
            place=name,
            fix=f"uninstall one of them: pip uninstall {owners[-1]}",
        )
    target = BUILT_IN[name] if name in BUILT_IN else plugins[0].value
    return _load(name, target, owners[0])


def open_device(settings: DeviceSettings, clock: Clock) -> Device:
    """Open the instrument that `settings` names; raises `ConfigError` or `DeviceError`."""
    driver = get(settings.driver)
    reject_unknown(settings, driver)
    device = open_with(driver, settings, clock)
    if settings.limits:
        device.info = replace(device.info, limits=settings.limits)
    return device


def needs(name: str) -> Mapping[str, Sequence[str]]:
    """Options that state what the driver's stream measures where its bytes do not show it; see `Driver`."""
    options: Mapping[str, Sequence[str]] = getattr(get(name), "needs", {})
    return options


def noise_k(name: str) -> float:
    """Noise of a pixel in one frame of the driver's camera, by its maker's figure, K; NaN without."""
    with suppress(ConfigError):  # of a driver that is not installed here
        return float(getattr(get(name), "noise_k", math.nan))
    return math.nan


def decode(name: str, data: bytes, given: Mapping[str, Any]) -> Decoded:
    """Decode `data` with the driver called `name` and the options `given`; raises `ConfigError`."""
    driver = get(name)
    if not isinstance(driver, Decodes):
        raise ConfigError("this driver cannot decode without its instrument", place=name, fix=Action.RECORD())
    reject_unknown(decoding_settings(name, given), driver)
    return driver.decode(data, given)


def load_all() -> tuple[list[Driver], list[str]]:
    """Every driver that can be loaded, and what is wrong with the others."""
    drivers: list[Driver] = []
    problems: list[str] = []
    for name in names():
        try:
            drivers.append(get(name))
        except ConfigError as error:
            problems.append(error.message)
    return drivers, problems


@cache
def _plugins(search_path: tuple[str, ...]) -> list[EntryPoint]:
    """Drivers of other packages, looked for once on each search path: that reads every installed package."""
    return list(entry_points(group=GROUP))


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist else point.value


def _load(name: str, target: str, owner: str) -> Driver:
    module, _, attribute = target.partition(":")
    try:
        driver = getattr(importlib.import_module(module), attribute)()
    except Exception as error:  # another package's code may fail in any way
        raise ConfigError(
            f"the driver of {owner} cannot be loaded: {type(error).__name__}: {message_of(error)}",
            place=name,
            fix=f"pip install --upgrade {owner}, or pip uninstall {owner}",
        ) from error
    return cast(Driver, driver)
