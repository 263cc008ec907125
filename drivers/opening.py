"""Opening an instrument: if that fails, every port or source that the driver had opened is closed here."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from contextvars import ContextVar

from fieldkit.model.clock import Clock
from fieldkit.model.device import Device, DeviceSettings, Driver

_opened: ContextVar[ExitStack | None] = ContextVar("opened", default=None)


def open_with(driver: Driver, settings: DeviceSettings, clock: Clock) -> Device:
    """The instrument as `driver` opens it; raises as `Driver.open`, and then nothing is left open."""
    with ExitStack() as stack:
        token = _opened.set(stack)
        try:
            device = driver.open(settings, clock)
        finally:
            _opened.reset(token)
        stack.pop_all()
        return device


def close_on_failure(close: Callable[[], None]) -> None:
    """Have a port or source, just opened, closed again if its driver cannot open the instrument after all."""
    if (opened := _opened.get()) is not None:
        opened.callback(close)
