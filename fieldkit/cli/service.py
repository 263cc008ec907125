"""``fieldkit service``: the page of a campaign, and if wanted its recording, from boot on."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common

if TYPE_CHECKING:
    from fieldkit.recording.service import ServiceStatus

_SYSTEM = click.option("--system", is_flag=True, help="A service of the system, for which sudo is needed.")
STATES = {
    "active": "running",
    "reloading": "running",
    "activating": "starting",
    "deactivating": "stopping",
    "inactive": "stopped",
    "failed": "failed",
}
"""Words for systemd's states of a unit."""
RESULTS = {
    "watchdog": "no progress for a minute",
    "exit-code": "it ended with an error",
    "signal": "it was killed",
    "core-dump": "it was killed",
    "oom-kill": "memory ran out",
    "timeout": "it took too long",
    "protocol": "it never reported that it was ready",
    "start-limit-hit": "it failed too often",
}
"""Words for systemd's reasons why a service ended."""


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
    _print([install_service(unit, common.say_warning)])


@command.command("remove")
@_SYSTEM
def remove(system: bool) -> None:
    """Stop the service and remove it; a recording is sealed, the campaign stays as it is."""
    from fieldkit.recording.service import remove_service

    campaign = remove_service(system=system)
    if common.options().json:
        common.print_json({"removed": str(campaign)})
    common.say(f"removed the service of {campaign}")


@command.command("status")
def status() -> None:
    """Show whether the service is installed and running, what it reports, and the last line of its log."""
    from fieldkit.recording.service import service_status

    _print(service_status())


def _print(found: list[ServiceStatus]) -> None:
    if common.options().json:
        common.print_json({"services": [asdict(service) for service in found]})
        return
    if not found:
        click.echo("no service is installed; to install one: fieldkit service install")
    for service in found:
        click.echo("\n".join(_lines(service)))


def _lines(status: ServiceStatus) -> list[str]:
    kind, unit = ("system", "--unit") if status.is_system else ("user", "--user-unit")
    lines = [f"{_state(status)}  {status.campaign}", f"  {kind} service, {status.unit}"]
    lines.append(f"  starts at {'boot' if status.starts_at_boot else 'login only'}")
    if status.reports:
        lines.append(f"  {status.reports}")
    if status.restarts:
        lines.append(f"  restarted {status.restarts} times since the last boot")
    if status.last_log is not None:
        lines.append(f"  last log line, {_local(status.last_log.time_ns)}: {status.last_log.text}")
    link = ["fieldkit", "page", "--link", "control", "-C", str(status.campaign), *status.page]
    return [*lines, f"  whole log: journalctl {unit} {status.unit.stem}", f"  link: {shlex.join(link)}"]


def _state(status: ServiceStatus) -> str:
    word = (
        "waits to start again"
        if status.substate == "auto-restart"
        else STATES.get(status.state, status.state)
    )
    reason = RESULTS.get(status.result, "")
    since = f" since {_local(status.since_ns)}" if status.since_ns else ""
    return word + since + (f" ({reason})" if reason else "")


def _local(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns // 10**9).astimezone().strftime("%Y-%m-%d %H:%M:%S %Z")
