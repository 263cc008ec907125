"""``fieldkit devices``: list connected instruments, their drivers, and the identity to configure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, options, print_json, print_table, say

if TYPE_CHECKING:
    from fieldkit.drivers.discovery import ConnectedDevice


@click.command(cls=Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """List connected instruments and the identity to write into fieldkit.toml.

    An identity is vendor:product with the serial number, or with the USB socket for devices without one; it
    does not change when the computer numbers its ports differently.
    """
    from fieldkit.drivers import registry
    from fieldkit.drivers.discovery import discover

    things, problems = discover()
    drivers, _ = registry.load_all()
    if options(ctx).json:
        known = [{"name": one.name, "title": one.title, "quantity": one.quantity} for one in drivers]
        print_json({"devices": [_row(thing) for thing in things], "drivers": known, "problems": problems})
        return
    if things:
        rows = [
            [thing.identity, thing.port, thing.title, _names(thing.drivers), thing.note] for thing in things
        ]
        print_table(["identity", "at", "what", "driver", "remark"], rows)
    else:
        say("no instrument is plugged in")
    click.echo()
    print_table(["driver", "for"], [[one.name, one.title] for one in drivers])
    for problem in problems:
        say(f"warning: {problem}")


def _row(device: ConnectedDevice) -> dict[str, Any]:
    return {
        "identity": device.identity, "port": device.port, "title": device.title,
        "drivers": device.drivers, "remark": device.note,
    }  # fmt: skip


def _names(drivers: tuple[str, ...]) -> str:
    return " or ".join(drivers) if len(drivers) < 4 else f"{drivers[0]} ... {drivers[-1]}"
