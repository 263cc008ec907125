"""``fieldkit doctor``: check that this computer is ready for a day in the field."""

from __future__ import annotations

from dataclasses import asdict

import click

from fieldkit.cli.common import Command, print_if_json, working_folder
from fieldkit.cli.next_steps import finding_in_commands
from fieldkit.model.errors import DeviceError


@click.command(cls=Command)
@click.option(
    "--udev", is_flag=True, help="Print the udev rules, with names for this campaign's instruments."
)
@click.pass_context
def command(ctx: click.Context, udev: bool) -> None:
    r"""Check that this computer is ready to record; every problem comes with a fix.

    Checks permissions, drivers, clock, disk, power and configuration.

    \b
    fieldkit doctor --udev | sudo tee /etc/udev/rules.d/70-fieldkit.rules
    """
    from fieldkit.recording.doctor import doctor, udev_rules

    folder = working_folder()
    if udev:
        click.echo(udev_rules(folder), nl=False)
        return
    checks = list(map(finding_in_commands, doctor(folder)))
    if not print_if_json({"checks": [asdict(check) for check in checks]}):
        for check in checks:
            click.echo(f"{check.level:<5} {check.what}: {check.text}")
            if check.fix:
                click.echo(f"      fix: {check.fix}")
    ctx.exit(DeviceError.exit_code if any(check.level == "fail" for check in checks) else 0)
