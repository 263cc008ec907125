"""``fieldkit selftest DRIVER``: does a driver, ours or a plug-in's, do what every driver must?"""

from __future__ import annotations

from dataclasses import asdict

import click

from fieldkit.commands.common import Verb, options, print_json
from fieldkit.commands.decode import parse_option
from fieldkit.errors import DeviceError

FAILED = DeviceError.exit_code


@click.command(cls=Verb)
@click.argument("driver")
@click.option("--port", default="", help="Port of the instrument to try.")
@click.option(
    "--identity", default="", help="Identity of the instrument to try, as `fieldkit devices` shows it."
)
@click.option("-o", "--option", "pairs", multiple=True, metavar="KEY=VALUE", help="An option of the driver.")
@click.pass_context
def command(ctx: click.Context, driver: str, port: str, identity: str, pairs: tuple[str, ...]) -> None:
    """Run the conformance suite on a driver; with an instrument at hand, on that too."""
    from fieldkit.clock import HostClock
    from fieldkit.drivers import registry
    from fieldkit.drivers.conformance import check_driver, settings_for

    found = registry.get(driver)
    given = dict(parse_option(pair) for pair in pairs)
    outcomes = list(check_driver(found, HostClock(), settings_for(found, port, identity, given)))
    passed = all(outcome.level != "fail" for outcome in outcomes)
    if options(ctx).json:
        print_json({"driver": driver, "passed": passed, "checks": [asdict(one) for one in outcomes]})
    else:
        for one in outcomes:
            click.echo(f"{one.level:<5} {one.what}: {one.text}")
    ctx.exit(0 if passed else FAILED)
