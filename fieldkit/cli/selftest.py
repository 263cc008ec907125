"""``fieldkit selftest DRIVER``: check that a driver, built in or a plug-in, meets the driver contract."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from fieldkit.cli.common import Command, print_if_json, say
from fieldkit.cli.types import KEY_VALUE
from fieldkit.model.errors import DeviceError

FAILED = DeviceError.exit_code


class CablePrompts:
    """Ask the user to pull the cable and to put it back."""

    def unplug(self) -> None:
        """Ask for the cable to be pulled."""
        say("pull the instrument's cable now")

    def plug(self) -> None:
        """Ask for the cable to be put back."""
        say("put the cable back")


@click.command(cls=Command)
@click.argument("driver")
@click.option("--device", "port", default="", metavar="PORT", help="Port of the instrument to test.")
@click.option(
    "--identity", default="", help="Identity of the instrument to test, as `fieldkit devices` shows it."
)
@click.option("--unplug", is_flag=True, help="Also ask for the cable to be pulled and put back.")
@click.option("--option", "pairs", type=KEY_VALUE, multiple=True, metavar="KEY=VALUE", help="Driver option.")
@click.pass_context
def command(
    ctx: click.Context,
    driver: str,
    port: str,
    identity: str,
    unplug: bool,
    pairs: tuple[tuple[str, Any], ...],
) -> None:
    """Check that a driver meets the driver contract; with --device or --identity, on an instrument too."""
    from fieldkit.drivers import registry
    from fieldkit.drivers.conformance import check_driver, settings_for
    from fieldkit.model.clock import HostClock

    driver_class = registry.get(driver)
    driver_options = dict(pairs)
    instrument = settings_for(driver_class, port, identity, driver_options)
    outcomes = list(check_driver(driver_class, HostClock(), instrument, CablePrompts() if unplug else None))
    passed = all(outcome.level != "fail" for outcome in outcomes)
    checks = list(map(asdict, outcomes))
    if not print_if_json({"driver": driver, "passed": passed, "checks": checks}):
        for check in outcomes:
            click.echo(f"{check.level:<5} {check.what}: {check.text}")
    ctx.exit(0 if passed else FAILED)
