"""The suite of conformance, passed by an instrument that is there."""

from __future__ import annotations

from fieldkit.drivers.conformance import Cable, check_driver
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings, Driver


def conforms(driver: Driver, settings: DeviceSettings, cable: Cable | None = None) -> None:
    """Assert that the driver passes every check, those of unplugging if there is a cable to pull."""
    outcomes = list(check_driver(driver, HostClock(), settings, cable))
    checks = [outcome for outcome in outcomes if cable or outcome.what != "cable"]
    assert {outcome.level for outcome in checks} == {"ok"}, outcomes
