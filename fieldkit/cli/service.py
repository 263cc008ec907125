"""``fieldkit service``: the page of a campaign, and if wanted its recording, from boot on."""

from __future__ import annotations

import shlex

import click

from fieldkit.cli import common

_SYSTEM = click.option("--system", is_flag=True, help="A service of the system, for which sudo is needed.")


@click.group(cls=common.CommandGroup)
def command() -> None:
    """Run the page of a campaign, and if wanted its recording, from boot on (systemd)."""


@command.command("install")
@_SYSTEM
@click.option("--record", is_flag=True, help="Begin a recording at every start.")
@click.option("--address", metavar="ADDRESS", help="As for fieldkit page.")
@click.option("--port", type=click.IntRange(1, 65535), metavar="PORT", help="As for fieldkit page.")
@click.option("--print", "only_print", is_flag=True, help="Print the unit and change nothing.")
def install(system: bool, record: bool, address: str | None, port: int | None, only_print: bool) -> None:
    r"""Start fieldkit page for this campaign now and at every boot, after recovering what was interrupted.

    A service of the user by default. It is started again when it fails, or when its recording makes no
    progress for a minute.

    \b
    fieldkit service install --record --address 192.168.4.1
    sudo ~/fieldkit/bin/fieldkit service install --system --record
    """
    from fieldkit.recording.service import install_service, unit_of

    page = [*(["--address", address] if address else []), *(["--port", str(port)] if port else [])]
    unit = unit_of(common.campaign(), system=system, record=record, page=page)
    if only_print:
        click.echo(unit.text(), nl=False)
        return
    file = install_service(unit, common.say_warning)
    if common.print_if_json({"unit": str(file), "campaign": str(unit.campaign)}):
        return
    link = ["fieldkit", "page", "--link", "control", "-C", str(unit.campaign), *page]
    click.echo(f"installed {file}\n  link: {shlex.join(link)}")
    click.echo(f"  status: systemctl {'' if system else '--user '}status {file.stem}")


@command.command("remove")
@_SYSTEM
def remove(system: bool) -> None:
    """Stop the service and remove it; a recording is sealed, the campaign stays as it is."""
    from fieldkit.recording.service import remove_service

    campaign = remove_service(system=system)
    common.print_if_json({"removed": str(campaign)})
    common.say(f"removed the service of {campaign}")
