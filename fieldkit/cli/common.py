"""Shared by all commands: the common options, printing, the campaign.

stdout carries data, stderr carries messages. Human output may change from version to
version; what ``--json`` prints carries ``"schema": 1``.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from fieldkit.cli.next_steps import RUNNING, in_commands
from fieldkit.model.next_step import Text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from fieldkit.config import Config


PIPE_COLS = 160
"""Rows of a table must not be cut in a pipe or a file."""


@dataclass(frozen=True)
class Options:
    """Values of the common options."""

    directory: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: int = 0
    no_color: bool = False
    no_input: bool = False


def _common_options() -> list[click.Parameter]:
    folder = click.Path(exists=True, file_okay=False, path_type=Path)
    return [
        click.Option(
            ["-C", "directory"], type=folder, metavar="DIR", help="Campaign folder [default: search upwards]."
        ),
        click.Option(["--json", "json"], is_flag=True, help="Print one JSON document instead of text."),
        click.Option(["-q", "--quiet"], is_flag=True, help="Print no messages, only data and errors."),
        click.Option(["-v", "--verbose"], count=True, help="More output; -vv for debug."),
        click.Option(
            ["--no-color"], is_flag=True, help="No colours; NO_COLOR in the environment does the same."
        ),
        click.Option(["--no-input"], is_flag=True, help="Never ask; fail instead."),
    ]


class Command(click.Command):
    """A command that takes the common options and keeps them as `Options` in ``ctx.obj``."""

    def __init__(self, name: str | None = None, **settings: Any) -> None:
        params = [*(settings.pop("params", None) or []), *_common_options()]
        super().__init__(name, params=params, **settings)
        # docstrings are raw, so click's mark for "keep these lines" arrives as two letters
        self.help: str | None = self.help and self.help.replace("\\b\n", "\b\n")

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments of the command that is running now."""
        ctx.meta[RUNNING] = self
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command with its own parameters; the common ones become ``ctx.obj``."""
        names = [option.name for option in _common_options() if option.name]
        # of the root too, which explains failures
        ctx.find_root().obj = ctx.obj = Options(**{name: ctx.params.pop(name) for name in names})
        _configure_logging(ctx.obj)
        return super().invoke(ctx)


class CommandGroup(click.Group):
    """A command with subcommands, such as ``roi add``; each of them takes the common options."""

    command_class = Command


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

set_option: Decorator = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Use another value for a key of fieldkit.toml, e.g. --set surface.albedo=0.25.",
)
"""``--set KEY=VALUE`` for commands that read the configuration; pass `settings` to `campaign`."""


theme_option: Decorator = click.option(
    "--theme",
    type=click.Choice(["dark", "paper"]),
    default="dark",
    help="Colours; paper is readable in sunlight.",
)
"""``--theme`` for commands with a live view."""


present_option: Decorator = click.option(
    "--campaign", "present", is_flag=True, help="Use the campaign's fieldkit.toml as it is now, regions too."
)
"""``--campaign`` for commands that estimate recorded sessions; pass `present` to `config_for`."""


def options_together(*single: Decorator) -> Decorator:
    """Options that several commands share, as one decorator."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        return reduce(lambda inner, option: option(inner), reversed(single), command)

    return decorate


workers_options: Decorator = options_together(
    click.option(
        "-j",
        "--jobs",
        type=click.IntRange(min=1),
        metavar="N",
        help="Processes [default: one per core].",
    ),
    click.option(
        "--address", metavar="ADDRESS", help="Dask scheduler whose workers to use: tcp://10.0.0.5:8786."
    ),
)
"""``-j`` and ``--address`` for commands over many sessions: `fieldkit.results.executors.workers`."""


def campaign_file() -> Path:
    """The ``fieldkit.toml`` of the campaign that ``-C`` names, or of the one around the current folder.

    Raises `ConfigError` if there is none.
    """
    from fieldkit.config import find_campaign

    return find_campaign(working_folder())


def campaign(settings: Sequence[str] = ()) -> Config:
    """The configuration of that campaign, with the ``KEY=VALUE`` of ``--set``.

    Raises `ConfigError` if there is no campaign, or with all mistakes in its configuration.
    """
    from fieldkit.config import load_config

    return load_config(campaign_file(), settings=settings)


def recordings() -> Path:
    """``recordings/`` of that campaign; its configuration is not read. Raises `ConfigError` without one."""
    return campaign_file().parent / "recordings"


def working_folder() -> Path:
    """The folder that ``-C`` names, or the current one."""
    return options().directory or Path.cwd()


def options() -> Options:
    """The common options of the running command; the defaults outside a command line."""
    ctx = click.get_current_context(silent=True)
    parent_options = ctx.find_object(Options) if ctx else None
    return parent_options or Options()


def is_interactive() -> bool:
    """True if the running command may ask: on a terminal, without ``--no-input``."""
    return sys.stdin.isatty() and not options().no_input


def to_stderr(text: str) -> None:
    """Print on stderr; where that leads nowhere any more, what the command does goes on without."""
    try:
        click.echo(text, err=True)
    except OSError:
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Discard what was and will be written to a stream."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def say(text: Text) -> None:
    """Print a message on stderr, unless ``--quiet``."""
    if not options().quiet:
        to_stderr(in_commands(text))


def say_warning(text: Text) -> None:
    """Print a warning on stderr, unless ``--quiet``."""
    say("warning: " + text)


def print_json(document: Mapping[str, Any], *, on_one_line: bool = False) -> None:
    """Print a JSON document on stdout, with ``"schema": 1`` in front; on one line where many follow."""
    click.echo(json_text(document, None if on_one_line else 2))


def print_if_json(document: Mapping[str, Any], *, on_one_line: bool = False) -> bool:
    """Print a JSON document if ``--json`` asks for it; True if it does."""
    if options().json:
        print_json(document, on_one_line=on_one_line)
    return options().json


def json_text(document: Mapping[str, Any], indent: int | None = None) -> str:
    """A JSON document, without an indent on one line; NaN becomes null."""
    from fieldkit.results.json_document import to_json

    return _encodable(to_json(document, indent=indent))


def _encodable(text: str) -> str:
    """JSON as it is, or escaped where stdout's encoding lacks a letter: data are never replaced."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return "".join(letter if letter.isascii() else json.dumps(letter)[1:-1] for letter in text)
    return text


def console(*, err: bool = False) -> Console:
    """A rich console on stdout (or stderr), plain in a pipe or with colours off."""
    from rich.console import Console

    class Piped(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError(errno.EPIPE, "closed")  # instead of rich's exit with 1: `failure` decides

    console = Piped(
        stderr=err, no_color=options().no_color or None, highlight=False, emoji=False, markup=False
    )
    if not console.is_terminal:
        console.width = PIPE_COLS
    return console


def print_table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print rows under column headings on stdout; numbers should come formatted."""
    from rich.table import Table

    table = Table(*columns, box=None, header_style="bold", pad_edge=False)
    for row in rows:
        table.add_row(*(str(cell) for cell in row))
    console().print(table)


def progress() -> Progress:
    """A progress bar on stderr, silent with ``--quiet``, ``--json`` or without a terminal."""
    from rich.progress import Progress

    screen, chosen = console(err=True), options()
    is_silent = chosen.quiet or chosen.json or not screen.is_terminal
    return Progress(console=screen, disable=is_silent, transient=True)


def _configure_logging(options: Options) -> None:
    levels = {0: logging.WARNING, 1: logging.INFO}
    level = logging.ERROR if options.quiet else levels.get(options.verbose, logging.DEBUG)
    logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s", force=True)
