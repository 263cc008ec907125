"""Everything plugged in, and what fieldkit takes it for."""

from __future__ import annotations

from dataclasses import dataclass

from fieldkit.drivers import registry
from fieldkit.drivers.cameras.source import cameras
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.ports import serial_ports

UNKNOWN = "no driver of fieldkit's"


@dataclass(frozen=True, slots=True)
class PluggedIn:
    """One thing on a cable; `drivers` take it for their own, `remark` says why they are not sure."""

    identity: str
    port: str
    title: str
    drivers: tuple[str, ...]
    remark: str = ""


def plugged_in() -> tuple[list[PluggedIn], list[str]]:
    """(instruments, adapters and cameras that are there; problems with drivers that could not be loaded)."""
    drivers, problems = registry.load_all()
    things: dict[tuple[str, str], PluggedIn] = {}
    for driver in drivers:
        for found in driver.find():
            key = (found.identity, found.port)
            before = things.get(key)
            names = (*(before.drivers if before else ()), found.driver)
            remark = "only the instrument's answer tells which" if before else found.doubt
            things[key] = PluggedIn(found.identity, found.port, found.title, names, remark)
    known = {thing.port for thing in things.values()}
    others = [
        *_strangers(cameras(), known, "y16 reads it if it has Y16"),
        *_strangers(serial_ports(), known, UNKNOWN),
    ]
    return [*things.values(), *others], problems


def _strangers(present: list[tuple[str, UsbIdentity]], known: set[str], remark: str) -> list[PluggedIn]:
    everybody = [usb for _, usb in present]
    return [
        PluggedIn(usb.written(everybody), path, usb.title, (), remark)
        for path, usb in present
        if path not in known
    ]
