"""``fieldkit page``: serve the field page, for phones and laptops."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.model.errors import ConfigError, RefusedError, StorageError, os_errors_as
from fieldkit.model.installation import install_extra
from fieldkit.model.next_step import Argument
from fieldkit.views.service_manager import is_expected

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.page.viewer import Role

PORT = 8765
LOOPBACK = "127.0.0.1"
WILDCARDS = ("0.0.0.0", "::")
ENDS_WITHIN_S = 5.0


@click.command(cls=common.Command)
@click.option(
    "--address",
    default=LOOPBACK,
    show_default=True,
    metavar="ADDRESS",
    help="Address to serve on: this computer's in the local network, or 0.0.0.0 for all of them.",
)
@click.option(
    "--port", type=click.IntRange(1, 65_535), default=PORT, show_default=True, metavar="PORT", help="Port."
)
@click.option(
    "--link", "role", type=click.Choice(["view", "control"]), help="Print one more link for the running page."
)
@click.option("--key", is_flag=True, help="Print a key with which a program may read /metrics for a year.")
@click.option("--record", is_flag=True, help="Begin a recording at once, and again when it fails.")
@common.set_option
def command(
    address: str, port: int, role: Role | None, key: bool, record: bool, settings: tuple[str, ...]
) -> None:
    r"""Serve the field page: frame, regions, slopes, start, marks and alarms in a browser.

    Without a recording it shows the instruments live. A recording that is started there goes on when the page
    ends. Each link works once and makes one browser known for a day.

    \b
    fieldkit page                       on this computer only
    fieldkit page --address 192.168.4.1 for phones in that network
    fieldkit page --link view           one more link, to look only
    """
    config = common.campaign(settings)
    if key:
        from fieldkit.page.keys import Keys

        click.echo(Keys(config.recordings).new_program())
        return
    if role is not None:
        link = _link(config, address, port, role)
        _show_qr_code(link)
        click.echo(link)
        return
    _serve(config, address, port, settings, record=record)


def _serve(config: Config, address: str, port: int, settings: tuple[str, ...], *, record: bool) -> None:
    try:
        from fieldkit.page.server import Page, listening, server
    except ModuleNotFoundError as error:
        raise ConfigError("needed by the page", place=error.name, fix=install_extra("page")) from error
    fix = "try another " + Argument("port") + " or " + Argument("address")
    with os_errors_as(RefusedError, "cannot serve here", place=f"{address}:{port}", fix=fix):
        listener = listening(address, port)
    with listener:
        _print_links(config, address, port, "Ctrl-C ends the page")
        server(Page(config, port, settings, record=record)).run(sockets=[listener])
    common.say("\nthe page has ended; a recording goes on: fieldkit status, fieldkit stop")


@contextmanager
def page_beside(config: Config, address: str | None, settings: Sequence[str]) -> Iterator[None]:
    """Serve the page in a process of its own meanwhile; nothing without an address.

    The process is in a session of its own, nobody waits for it to begin, and one that hangs is killed: the
    recording that it shows does not depend on it.
    """
    process = None if address is None else _begun(config, address, settings)
    try:
        yield
    finally:
        if process is not None:
            _end(process)


def _begun(config: Config, address: str, settings: Sequence[str]) -> subprocess.Popen[bytes] | None:
    """The process of a page, its links printed; None with a warning if there can be none."""
    words = [*(sys.executable, "-P", "-m", "fieldkit", "page", "-C", str(config.directory), "--quiet")]
    words += ["--address", address, *(word for setting in settings for word in ("--set", setting))]
    environment = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
    try:
        process = subprocess.Popen(
            words,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        _print_links(config, address, PORT, "The page ends with the recording")
    except (OSError, StorageError) as error:
        common.say_warning(f"the recording has no page: {error}")
        return None
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _show_qr_code(link: str) -> None:
    """A link for a phone, in a terminal."""
    if common.console(err=True).is_terminal:
        for line in qr_lines(link):
            common.say(line)


def _print_links(config: Config, address: str, port: int, end: str) -> None:
    if is_expected():  # a log must not contain keys
        common.say(f"the page listens on {address}:{port}; a link to it: fieldkit page --link control")
        return
    control, view = (_link(config, address, port, role) for role in ("control", "view"))
    _show_qr_code(control)
    common.say(f"control  {control}")
    common.say(f"look     {view}")
    common.say(f"each link works once; more: fieldkit page --link control. {end}.")


def _link(config: Config, address: str, port: int, role: Role) -> str:
    """An address with a key after ``#``, which browsers do not send and no log contains."""
    from fieldkit.page.keys import Keys

    host = socket.gethostname() if address in WILDCARDS else f"[{address}]" if ":" in address else address
    return f"http://{host}:{port}/#{Keys(config.recordings).new_link(role)}"


WHITE_ON_BLACK, PLAIN = "\x1b[38;5;231;48;5;16m", "\x1b[0m"
"""Fixed colours of the 256-colour cube: many phones do not read a code in a light theme's inverse colours."""


def qr_lines(text: str) -> list[str]:
    """Lines of half blocks that show `text` as a QR code, the same on dark and light themes.

    An address with a key of 128 bits takes 19 lines of 37 characters, quiet zone included. Raises
    `ImportError` without the library of ``fieldkit-slope[page]``.
    """
    import segno

    code = StringIO()
    segno.make_qr(text).terminal(code, compact=True)
    return [f"{WHITE_ON_BLACK}{line}{PLAIN}" for line in code.getvalue().splitlines()]
