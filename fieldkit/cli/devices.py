"""``fieldkit devices``: list connected instruments and their drivers, or write them into fieldkit.toml."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, campaign_file, is_interactive, print_if_json, print_table, say
from fieldkit.cli.next_steps import in_commands
from fieldkit.cli.types import INSTRUMENT

if TYPE_CHECKING:
    from fieldkit.drivers.discovery import ConnectedDevice
    from fieldkit.recording.adding import AddedDevices, Question


@click.command(cls=Command)
@click.argument("addresses", metavar="[ADDRESS]...", nargs=-1)
@click.option("--add", "is_adding", is_flag=True, help="Write what is connected into fieldkit.toml.")
@click.option(
    "--instrument",
    "stated",
    type=INSTRUMENT,
    multiple=True,
    help="With --add: what is on a cable and its options, instead of a question; DRIVER skip: nothing.",
)
def command(
    addresses: tuple[str, ...], is_adding: bool, stated: tuple[tuple[str, dict[str, Any]], ...]
) -> None:
    r"""List connected instruments, or write them into fieldkit.toml.

    An identity is vendor:product with the serial number, or with the USB socket for devices without one; it
    does not change when the computer numbers its ports differently.

    With --add each instrument is opened once. What is on a serial port is recognised by what it sends or
    replies, and proposed with the values that were read; what neither it nor --instrument shows is asked for:
    a register map, a unit, what radiation it is. Those configured already stay.

    An ADDRESS is a camera in the network (HOST), a serial adapter there (HOST:PORT, socket://, rfc2217:// or
    esphome://) or the path of a port; with any, only these are added.

    \b
    fieldkit devices --add
    fieldkit devices --add 192.168.4.1
    fieldkit devices --add --no-input --instrument 10c4:ea60:A7=modbus,map=kipp-smp
    """
    if (stated or addresses) and not is_adding:
        raise click.UsageError("--instrument needs --add" if stated else "ADDRESS needs --add")
    if is_adding:
        add_connected(campaign_file(), dict(stated), addresses)
    else:
        _list()


def add_connected(file: Path, stated: dict[str, dict[str, Any]], addresses: tuple[str, ...] = ()) -> None:
    """Write what is connected into a fieldkit.toml and print it; raises `ConfigError` or `DeviceError`."""
    from fieldkit.recording.adding import Question, add_devices
    from fieldkit.recording.opening import together

    additions = add_devices(file, stated, _answer if is_interactive() else Question.accept, addresses)
    failures = [
        {"message": in_commands(failure.explanation), "fix": in_commands(failure.fix or "") or None}
        for failure in additions.failures
    ]
    added, skipped = list(map(asdict, additions.added)), list(map(_row, additions.skipped))
    lists = {"added": added, "skipped": skipped, "failures": failures}
    print_if_json({"config": str(file), "configured": additions.configured, **lists})
    _report(file, additions)
    if additions.failures:
        raise together(additions.failures)


def _answer(question: Question) -> str:
    proposal = question.proposal or None
    answer: str = click.prompt(str(question), proposal, type=click.Choice(question.choices), err=True)
    return answer


def _report(file: Path, additions: AddedDevices) -> None:
    from fieldkit.recording.preflight import NOT_RECORDED

    for added in additions.added:
        quantity = f"{added.quantity} in {added.unit}"
        driver = ",".join((added.driver, *(f"{key}={value}" for key, value in added.options.items())))
        read = f"; read: {added.received}" if added.received else ""
        read += f"; {NOT_RECORDED}: {added.not_recorded}" if added.not_recorded else ""
        say(f"added {added.name} to {file}: {driver}, {quantity}, {added.identity or added.port}{read}")
    for identity, name in additions.configured.items():
        say(f"{identity} is configured already, as {name}")
    for device in additions.skipped:
        say(f"skipped {device.identity or device.port}: {device.note}")
    if not (additions.added or additions.configured or additions.skipped or additions.failures):
        say("no instrument is plugged in; next: fieldkit doctor")


def _list() -> None:
    from fieldkit.drivers import registry
    from fieldkit.drivers.discovery import discover
    from fieldkit.results.json_document import attributes

    devices, problems = discover()
    drivers, _ = registry.load_all()
    driver_rows = [attributes(driver, "name", "title", "quantity") for driver in drivers]
    if print_if_json({"devices": list(map(_row, devices)), "drivers": driver_rows, "problems": problems}):
        return
    if devices:
        rows = [
            [device.identity, device.port, device.title, _names(device.drivers), device.note]
            for device in devices
        ]
        print_table(["identity", "at", "what", "driver", "remark"], rows)
    else:
        say("no instrument is plugged in")
    click.echo()
    print_table(["driver", "for"], [[driver.name, driver.title] for driver in drivers])
    for problem in problems:
        say(f"warning: {problem}")


def _row(device: ConnectedDevice) -> dict[str, Any]:
    row = asdict(device)
    return {**row, "remark": row.pop("note")}


def _names(drivers: tuple[str, ...]) -> str:
    return " or ".join(drivers) if len(drivers) < 4 else f"{drivers[0]} ... {drivers[-1]}"
